//! Subscribes to the nodes, and listens until the server is lost.
//!
//! A server tells a value when it changes, and otherwise that it is still there. So a value holds while the server speaks, however old it is; when it has been silent for the
//! data deadline all values are unknown. A value that the server itself does not call good is unknown.

use std::time::Duration;

use futures_util::StreamExt;
use gearwatch_core::block::Packet;
use opcua_client::{
    ClientBuilder, DataChangeCallback, IdentityToken, Session, SessionPollResult, SubscriptionActivity,
};
use opcua_types::{
    DataValue, EndpointDescription, MessageSecurityMode, MonitoredItemCreateRequest, MonitoringMode,
    MonitoringParameters, NodeId, ReadValueId, TimestampsToReturn, UserTokenPolicy, Variant,
};
use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

use super::{Node, OpcUa};
use crate::source::readings::Readings;
use crate::source::{Feed, Sender, SourceContext, SourceError, now_unix_ns};

/// Values that wait to be read.
const WAITING: usize = 256;
/// The server forgets a subscription whose client was silent for so many intervals. OPC UA asks for three at least.
const LIFETIME_COUNT: u32 = 60;
/// No message with a few numbers is longer.
const LONGEST_MESSAGE: usize = 1 << 20;

/// Opens the source.
pub(super) fn open(config: &OpcUa, context: &SourceContext) -> Result<Feed, SourceError> {
    let token = match (&config.username, &config.password_file) {
        (None, _) => IdentityToken::Anonymous,
        (Some(user), None) => IdentityToken::UserName(user.clone(), String::new().into()),
        (Some(user), Some(path)) => {
            let path = context.resolve(path);
            let password = gearwatch_io::text::read_text(&path).map_err(|source| SourceError::Io { path, source })?;
            IdentityToken::UserName(user.clone(), password.trim_end().to_owned().into())
        }
    };
    let (config, readings) = (config.clone(), context.readings.clone());
    let deadline = context.data_deadline;
    Ok(Feed::Push(Box::new(move |sender| {
        Box::pin(async move {
            let result = config.listen(token, &readings, &sender, deadline).await;
            // Whatever ended it: what it said holds no longer.
            readings.forget(config.nodes.iter().map(|node| node.quantity));
            let _ = sender.send(Packet::OperatingPoint(readings.point(now_unix_ns()))).await;
            result.map_err(|message| SourceError::Peer { peer: config.endpoint, message })
        })
    })))
}

/// What the connection tells.
enum Heard {
    /// The value of a node, by its place in the configuration.
    Value(usize, DataValue),
    /// All that has changed was told.
    Alive,
}

impl Node {
    /// The physical value; why there is none.
    fn value(&self, told: &DataValue) -> Result<f64, String> {
        if let Some(status) = told.status.filter(|status| !status.is_good()) {
            return Err(format!("the server calls its value {status}"));
        }
        let number = match &told.value {
            Some(Variant::Double(v)) => *v,
            Some(Variant::Float(v)) => f64::from(*v),
            Some(Variant::SByte(v)) => f64::from(*v),
            Some(Variant::Byte(v)) => f64::from(*v),
            Some(Variant::Int16(v)) => f64::from(*v),
            Some(Variant::UInt16(v)) => f64::from(*v),
            Some(Variant::Int32(v)) => f64::from(*v),
            Some(Variant::UInt32(v)) => f64::from(*v),
            Some(Variant::Int64(v)) => *v as f64,
            Some(Variant::UInt64(v)) => *v as f64,
            Some(other) => return Err(format!("expected a number, found {:?}", other.type_id())),
            None => return Err("it has no value".to_owned()),
        };
        Ok(self.linear().of(number))
    }
}

impl OpcUa {
    /// Listens until the service stops or the server is lost.
    async fn listen(
        &self,
        token: IdentityToken,
        readings: &Readings,
        sender: &Sender,
        deadline: Duration,
    ) -> Result<(), String> {
        let late = |_| format!("no answer within {:.1} s", deadline.as_secs_f64());
        // No folder of certificates is made or read: messages are neither signed nor encrypted.
        let mut client = ClientBuilder::new()
            .application_name("gearwatch")
            .application_uri("urn:gearwatch")
            .product_uri("urn:gearwatch")
            .session_name("gearwatch")
            .create_sample_keypair(false)
            .session_retry_limit(0)
            .request_timeout(deadline)
            .publish_timeout(deadline)
            .recreate_subscriptions(false)
            .max_message_size(LONGEST_MESSAGE)
            .client()
            .map_err(|problems| problems.join(", "))?;
        let endpoint: EndpointDescription =
            (self.endpoint.as_str(), "None", MessageSecurityMode::None, UserTokenPolicy::anonymous()).into();
        let connecting = client.connect_to_matching_endpoint(endpoint, token);
        let (session, events) = timeout(deadline, connecting).await.map_err(late)?.map_err(|e| e.to_string())?;
        let (out, mut heard) = mpsc::channel(WAITING);
        let (told, (end, ended)) = (out.clone(), oneshot::channel());
        // The connection is polled by a task of its own. The set ends it with this future.
        let mut tasks = tokio::task::JoinSet::new();
        tasks.spawn(async move {
            let mut events = std::pin::pin!(events.enter());
            while let Some(event) = events.next().await {
                let status = match event {
                    Ok(SessionPollResult::Subscription(SubscriptionActivity::Publish)) => {
                        if out.send(Heard::Alive).await.is_err() {
                            return;
                        }
                        continue;
                    }
                    Ok(SessionPollResult::Subscription(SubscriptionActivity::FatalFailure(status))) => status,
                    Ok(SessionPollResult::ConnectionLost(status) | SessionPollResult::ReconnectFailed(status)) => {
                        status
                    }
                    Ok(_) => continue,
                    Err(status) => status,
                };
                let _ = end.send(format!("the connection is lost: {status}"));
                return;
            }
        });
        let work = async {
            let subscribed = async {
                session.wait_for_connection().await;
                self.subscribe(&session, told).await
            };
            timeout(deadline, subscribed).await.map_err(late)??;
            self.take(&mut heard, readings, sender, deadline).await
        };
        let result = tokio::select! {
            why = ended => Err(why.unwrap_or_else(|_| "the connection has ended".to_owned())),
            result = work => result,
        };
        if result.is_ok() {
            // The server is told, so that it need not wait for the session to end by itself.
            let _ = timeout(deadline, session.disconnect()).await;
        }
        result
    }

    async fn subscribe(&self, session: &Session, told: mpsc::Sender<Heard>) -> Result<(), String> {
        let callback = DataChangeCallback::new(move |value, item| {
            let at = item.client_handle() as usize;
            // The queue is read as fast as it is filled; what finds no room is told again with the next change.
            let _ = at.checked_sub(1).map(|at| told.try_send(Heard::Value(at, value)));
        });
        let interval = Duration::from_secs_f64(self.publish_secs);
        let id = session
            .create_subscription(interval, LIFETIME_COUNT, 1, 0, 0, true, callback)
            .await
            .map_err(|e| format!("no subscription: {e}"))?;
        let mut items = Vec::new();
        for (at, node) in self.nodes.iter().enumerate() {
            let id: NodeId = node.node.parse().map_err(|e| format!("node {:?}: {e}", node.node))?;
            items.push(MonitoredItemCreateRequest {
                item_to_monitor: ReadValueId::from(id),
                monitoring_mode: MonitoringMode::Reporting,
                requested_parameters: MonitoringParameters {
                    client_handle: u32::try_from(at + 1).unwrap_or(u32::MAX),
                    sampling_interval: 1e3 * self.publish_secs,
                    queue_size: 1,
                    discard_oldest: true,
                    ..Default::default()
                },
            });
        }
        let created = session
            .create_monitored_items(id, TimestampsToReturn::Neither, items)
            .await
            .map_err(|e| format!("no subscription: {e}"))?;
        for (node, created) in self.nodes.iter().zip(&created) {
            if !created.result.status_code.is_good() {
                return Err(format!("node {:?}: {}", node.node, created.result.status_code));
            }
        }
        Ok(())
    }

    /// Takes what is told until the service stops or the server is silent.
    async fn take(
        &self,
        heard: &mut mpsc::Receiver<Heard>,
        readings: &Readings,
        sender: &Sender,
        deadline: Duration,
    ) -> Result<(), String> {
        // The newest value of each node, until the server says something else of it.
        let mut values = vec![f64::NAN; self.nodes.len()];
        loop {
            match timeout(deadline, heard.recv()).await {
                Err(_) => return Err(format!("no answer within {:.1} s", deadline.as_secs_f64())),
                Ok(None) => return Err("the connection has ended".to_owned()),
                Ok(Some(Heard::Value(at, value))) => {
                    if let (Some(node), Some(place)) = (self.nodes.get(at), values.get_mut(at)) {
                        *place = node.value(&value).unwrap_or_else(|why| {
                            tracing::warn!(node = node.node, "{why}; it is unknown");
                            f64::NAN
                        });
                    }
                }
                Ok(Some(Heard::Alive)) => {
                    for (node, &value) in self.nodes.iter().zip(&values) {
                        readings.set(node.quantity, value, deadline);
                    }
                    if sender.send(Packet::OperatingPoint(readings.point(now_unix_ns()))).await.is_err() {
                        return Ok(());
                    }
                }
            }
        }
    }
}
