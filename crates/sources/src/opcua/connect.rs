//! Asks a server for its endpoints, takes the one that the configuration wants, and makes a
//! session there.

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use futures_util::StreamExt;
use futures_util::stream::BoxStream;
use opcua_client::transport::{Connector, TransportPollResult};
use opcua_client::{
    ClientBuilder, ClientConfig, ConnectionSource, IdentityToken, Session, SessionBuilder, SessionPollResult,
};
use opcua_core::ResponseMessage;
use opcua_crypto::SecurityPolicy;
use opcua_types::{
    DateTime, EndpointDescription, Error, GetEndpointsRequest, MessageSecurityMode, RequestHeader, StatusCode,
    UserTokenPolicy, UserTokenType,
};
use tokio::time::timeout;

use super::capped::{Dialler, LONGEST_CHUNK};
use super::error::ListenError;
use super::trust::{Pinned, Trust};
use super::{OpcUa, Security, address};

/// Longest message, as the endpoints of a server with their certificates (bytes).
const LONGEST_MESSAGE: usize = 8 * LONGEST_CHUNK;
/// The server keeps a session whose client is gone for so many data deadlines.
const SESSION_DEADLINES: u32 = 4;
/// Keys of a connection hold for so long (ms): RSA is at work only when they change.
const CHANNEL_MS: u32 = 600_000;
/// The end of a session or connection is waited for so long.
pub(super) const CLOSING: Duration = Duration::from_secs(1);

/// What a session goes through.
pub(super) type Events = BoxStream<'static, Result<SessionPollResult, StatusCode>>;

impl ConnectionSource for Dialler {
    type Builder = Self;

    fn get_connector(&self, _: &EndpointDescription) -> Result<Self, Error> {
        Ok(self.clone())
    }
}

/// A session that is made as its events are polled.
pub(super) async fn session(
    config: &OpcUa,
    trust: &Trust,
    token: IdentityToken,
    deadline: Duration,
) -> Result<(Arc<Session>, Events), ListenError> {
    let late = |what| move |_| ListenError::Late { within: deadline, what };
    let client = client(config, deadline);
    let address = address(&config.endpoint).ok_or(ListenError::Ended)?;
    let dialler = Dialler { address, url: config.endpoint.clone() };
    let asked = endpoints(&dialler, &client, trust, deadline);
    let offered = timeout(deadline, asked).await.map_err(late("to the question for endpoints"))?;
    let offered = offered.map_err(|e| match e.status() {
        StatusCode::BadNotConnected => ListenError::NotThere(e),
        _ => ListenError::NoServer(e),
    })?;
    let endpoint = config.choose(offered, trust.pinned.as_ref())?;
    let (session, events) = SessionBuilder::new(&client)
        .with_connector(dialler)
        .connect_to_endpoint_directly(endpoint)
        .and_then(|builder| builder.user_identity_token(token).build(trust.store.clone()))
        .map_err(ListenError::NoServer)?;
    Ok((session, events.enter().boxed()))
}

fn client(config: &OpcUa, deadline: Duration) -> ClientConfig {
    let keeps = (deadline * SESSION_DEADLINES).as_millis();
    ClientBuilder::new()
        .application_name("gearwatch")
        .application_uri(&config.application_uri)
        .product_uri("urn:gearwatch")
        .session_name("gearwatch")
        // The service opens a lost source again itself.
        .session_retry_limit(0)
        .recreate_subscriptions(false)
        .request_timeout(deadline)
        .session_timeout(u32::try_from(keeps).unwrap_or(u32::MAX))
        .channel_lifetime(CHANNEL_MS)
        // A server's clock may be wrong; no time of it is used.
        .ignore_clock_skew(true)
        .max_incoming_chunk_size(LONGEST_CHUNK)
        .max_message_size(LONGEST_MESSAGE)
        .max_chunk_count(LONGEST_MESSAGE / LONGEST_CHUNK)
        .into_config()
}

/// What a server offers, by its answer over a connection without protection.
async fn endpoints(
    dialler: &Dialler,
    client: &ClientConfig,
    trust: &Trust,
    deadline: Duration,
) -> Result<Vec<EndpointDescription>, Error> {
    let channel = SessionBuilder::new(client)
        .connect_to_endpoint_directly(dialler.default_endpoint())?
        .build_channel(trust.store.clone())?;
    let mut transport = channel.connect_no_retry(dialler).await?;
    let request = GetEndpointsRequest {
        request_header: RequestHeader {
            timestamp: DateTime::now(),
            request_handle: channel.request_handle(),
            ..RequestHeader::default()
        },
        endpoint_url: dialler.url.as_str().into(),
        locale_ids: None,
        profile_uris: None,
    };
    let mut answer = pin!(channel.send(request, deadline));
    let answer = loop {
        tokio::select! {
            answer = &mut answer => break answer?,
            polled = transport.poll() => if let TransportPollResult::Closed(status) = polled {
                return Err(Error::new(status, "it has closed the connection"));
            },
        }
    };
    channel.close_channel().await;
    let closed = async { while !matches!(transport.poll().await, TransportPollResult::Closed(_)) {} };
    let _ = timeout(CLOSING, closed).await;
    match answer {
        ResponseMessage::GetEndpoints(answer) if answer.response_header.service_result.is_good() => {
            Ok(answer.endpoints.unwrap_or_default())
        }
        ResponseMessage::GetEndpoints(answer) => {
            Err(Error::new(answer.response_header.service_result, "the list of its endpoints is missing"))
        }
        _ => Err(Error::new(StatusCode::BadUnknownResponse, "the list of its endpoints is missing")),
    }
}

impl Security {
    fn mode(self) -> MessageSecurityMode {
        match self {
            Self::None => MessageSecurityMode::None,
            Self::Sign => MessageSecurityMode::Sign,
            Self::SignAndEncrypt => MessageSecurityMode::SignAndEncrypt,
        }
    }

    /// What may protect messages, the best first. Policies with SHA-1 are out of date.
    fn policies(self) -> &'static [SecurityPolicy] {
        match self {
            Self::None => &[SecurityPolicy::None],
            Self::Sign | Self::SignAndEncrypt => &[
                SecurityPolicy::Aes256Sha256RsaPss,
                SecurityPolicy::Aes128Sha256RsaOaep,
                SecurityPolicy::Basic256Sha256,
            ],
        }
    }
}

/// `Basic256Sha256 sign_and_encrypt`, as in the configuration.
fn shown(policy: SecurityPolicy, mode: MessageSecurityMode) -> String {
    match mode {
        MessageSecurityMode::Sign => format!("{policy} \"sign\""),
        MessageSecurityMode::SignAndEncrypt => format!("{policy} \"sign_and_encrypt\""),
        _ => "\"none\"".to_owned(),
    }
}

impl OpcUa {
    /// The endpoint that is protected as wanted, with the one way to log in that is used.
    fn choose(
        &self,
        mut offered: Vec<EndpointDescription>,
        pinned: Option<&Pinned>,
    ) -> Result<EndpointDescription, ListenError> {
        let policy = |endpoint: &EndpointDescription| SecurityPolicy::from_uri(endpoint.security_policy_uri.as_ref());
        // Other transports than that of opc.tcp.
        offered.retain(|endpoint| endpoint.endpoint_url.as_ref().starts_with("opc.tcp:"));
        let (mode, policies) = (self.security.mode(), self.security.policies());
        let place = |endpoint: &EndpointDescription| policies.iter().position(|p| *p == policy(endpoint));
        let elsewhere = |endpoint: &EndpointDescription| path(endpoint.endpoint_url.as_ref()) != path(&self.endpoint);
        let best = offered
            .iter()
            .filter(|endpoint| endpoint.security_mode == mode)
            .filter_map(|endpoint| place(endpoint).map(|place| ((elsewhere(endpoint), place), endpoint)))
            .min_by_key(|(order, _)| *order);
        let Some((_, best)) = best else {
            let wanted = match self.security {
                Security::None => "security \"none\"".to_owned(),
                _ => shown(SecurityPolicy::Basic256Sha256, mode),
            };
            let mut found: Vec<_> =
                offered.iter().map(|endpoint| shown(policy(endpoint), endpoint.security_mode)).collect();
            found.sort();
            found.dedup();
            return Err(ListenError::Endpoint { wanted, found });
        };
        let mut chosen = best.clone();
        if let Some(pinned) = pinned
            && chosen.server_certificate != pinned.certificate.as_byte_string()
        {
            let found = opcua_crypto::X509::from_byte_string(&chosen.server_certificate);
            return Err(ListenError::OtherCertificate {
                file: pinned.file.display().to_string(),
                expected: Pinned::thumbprint(&pinned.certificate),
                found: found.map_or_else(|_| "no certificate".to_owned(), |found| Pinned::thumbprint(&found)),
            });
        }
        chosen.user_identity_tokens = Some(vec![self.login(&chosen)?]);
        // The host name in a server's own list is often unknown elsewhere.
        chosen.endpoint_url = self.endpoint.as_str().into();
        Ok(chosen)
    }

    /// The way to log in; a password is encrypted where the server can decrypt it.
    fn login(&self, endpoint: &EndpointDescription) -> Result<UserTokenPolicy, ListenError> {
        let (kind, wanted) = match self.username {
            None => (UserTokenType::Anonymous, "without a user"),
            Some(_) => (UserTokenType::UserName, "with user and password"),
        };
        let all = endpoint.user_identity_tokens.as_deref().unwrap_or_default();
        let protection = |login: &UserTokenPolicy| match login.security_policy_uri.as_ref() {
            "" => SecurityPolicy::from_uri(endpoint.security_policy_uri.as_ref()),
            uri => SecurityPolicy::from_uri(uri),
        };
        let usable = all.iter().filter(|login| login.token_type == kind);
        let known = usable.filter(|login| {
            !matches!(
                protection(login),
                SecurityPolicy::Unknown | SecurityPolicy::Basic128Rsa15 | SecurityPolicy::Basic256
            )
        });
        let readable = |login: &UserTokenPolicy| protection(login) == SecurityPolicy::None;
        let Some(login) = known.min_by_key(|login| readable(login)) else {
            let found = all.iter().map(|login| format!("{:?}", login.token_type)).collect();
            return Err(ListenError::LoginKind { wanted, found });
        };
        Ok(login.clone())
    }
}

/// What follows host and port.
fn path(url: &str) -> &str {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    rest.split_once('/').map_or("", |(_, path)| path.trim_end_matches('/'))
}
