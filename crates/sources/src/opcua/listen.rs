//! Subscribes to the nodes, and listens until the server is lost.
//!
//! A server sends a value when it changes, and otherwise that nothing has changed. So a value
//! holds while messages of the server come, however old it is. Without one for the data deadline
//! all values are unknown.

use std::panic::AssertUnwindSafe;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use futures_util::{FutureExt, StreamExt};
use gearwatch_core::block::Packet;
use gearwatch_runtime::clock::now_unix_ns;
use gearwatch_runtime::secret::Secret;
use opcua_client::{
    IdentityToken, MonitoredItem, OnSubscriptionNotification, Session, SessionPollResult, SubscriptionActivity,
};
use opcua_types::{
    DataValue, MonitoredItemCreateRequest, MonitoringMode, MonitoringParameters, NodeId, ReadValueId,
    StatusChangeNotification, StatusCode, TimestampsToReturn,
};
use tokio::sync::{Notify, oneshot};
use tokio::time::{sleep, timeout};

use super::connect::{CLOSING, Events, session};
use super::error::ListenError;
use super::trust::Trust;
use super::value::Held;
use super::{Node, OpcUa, Security};
use crate::readings::Readings;
use crate::{Feed, Sender, SourceContext, SourceError};

/// The server forgets a subscription after so many intervals without a client. OPC UA asks for
/// three at least (OPC 10000-4, 5.14.2).
const LIFETIME_COUNT: u32 = 60;
/// Messages that come faster than this are taken together.
const SHORTEST_PAUSE: Duration = Duration::from_millis(20);
/// So many intervals fit into a data deadline.
const INTERVALS: f64 = 3.0;

/// Opens the source.
pub(super) fn open(config: &OpcUa, context: &SourceContext) -> Result<Feed, SourceError> {
    let trust = Trust::read(config, context)?;
    let token = match (&config.username, &config.password_file) {
        (None, _) => IdentityToken::Anonymous,
        (Some(user), None) => IdentityToken::UserName(user.clone(), String::new().into()),
        (Some(user), Some(path)) => {
            let path = context.resolve(path);
            let password = Secret::read(&path).map_err(|source| SourceError::Io { path, source })?;
            IdentityToken::UserName(user.clone(), password.expose().into())
        }
    };
    let (config, readings) = (config.clone(), context.readings.clone());
    let deadline = context.data_deadline;
    Ok(Feed::Push(Box::new(move |sender| {
        Box::pin(async move {
            let listening = config.listen(&trust, token, &readings, &sender, deadline);
            // The library decodes what any program at this address may have sent.
            let result = AssertUnwindSafe(listening).catch_unwind().await.unwrap_or(Err(ListenError::Library));
            // Whatever ended it: its values hold no longer.
            readings.forget(config.nodes.iter().map(|node| node.quantity));
            let _ = sender.send(Packet::OperatingPoint(readings.point(now_unix_ns()))).await;
            // A server's own words may be part of it.
            let printable = |text: String| text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
            result.map_err(|e| SourceError::Peer { peer: config.endpoint, message: printable(e.to_string()) })
        })
    })))
}

/// The newest values of the nodes, shared by what receives and what reads.
struct Board {
    held: Mutex<Vec<Option<Held>>>,
    /// The subscription has ended so.
    ended: Mutex<Option<StatusCode>>,
    /// A message has come, and its values stand here.
    news: Notify,
}

impl Board {
    fn new(nodes: usize) -> Self {
        Self { held: Mutex::new(vec![None; nodes]), ended: Mutex::new(None), news: Notify::new() }
    }
}

/// Writes notifications to the board.
struct Writer {
    board: Arc<Board>,
    nodes: Vec<Node>,
}

impl OnSubscriptionNotification for Writer {
    fn on_data_value(&mut self, data: DataValue, item: &MonitoredItem) {
        let Some(at) = (item.client_handle() as usize).checked_sub(1) else { return };
        let mut held = self.board.held.lock().unwrap_or_else(PoisonError::into_inner);
        if let (Some(place), Some(node)) = (held.get_mut(at), self.nodes.get(at)) {
            *place = Some(Held::read(&data, node.linear()));
        }
    }

    fn on_subscription_status_change(&mut self, change: StatusChangeNotification) {
        if !change.status.is_good() {
            *self.board.ended.lock().unwrap_or_else(PoisonError::into_inner) = Some(change.status);
        }
    }
}

/// Polls a session until it is lost, or until `gone` shows that nothing reads it any more. Then it
/// is closed at the server, which has few of them.
async fn attend(session: Arc<Session>, mut events: Events, board: Arc<Board>, mut gone: oneshot::Receiver<()>) -> Lost {
    let mut is_in = false;
    let ended = |is_in, status| if is_in { Lost::Later(status) } else { Lost::AtLogin(status) };
    loop {
        let event = tokio::select! {
            event = events.next() => event,
            _ = &mut gone => break,
        };
        match event {
            None => return Lost::Closed,
            Some(
                Err(status)
                | Ok(SessionPollResult::ConnectionLost(status) | SessionPollResult::ReconnectFailed(status)),
            ) => {
                return ended(is_in, status);
            }
            Some(Ok(SessionPollResult::Reconnected(_))) => is_in = true,
            Some(Ok(SessionPollResult::Subscription(activity))) => match activity {
                SubscriptionActivity::Publish => board.news.notify_one(),
                // The library asks for fewer from then on.
                SubscriptionActivity::PublishFailed(StatusCode::BadTooManyPublishRequests) => {}
                // A message may be missing: values are read anew.
                SubscriptionActivity::PublishFailed(status) | SubscriptionActivity::FatalFailure(status) => {
                    return ended(is_in, status);
                }
            },
            Some(Ok(_)) => {}
        }
    }
    let polling = async { while events.next().await.is_some() {} };
    let _ = timeout(CLOSING, futures_util::future::join(session.disconnect(), polling)).await;
    Lost::Closed
}

/// How a session has ended.
enum Lost {
    AtLogin(StatusCode),
    Later(StatusCode),
    Closed,
}

impl OpcUa {
    /// Listens until the service stops or the server is lost.
    async fn listen(
        &self,
        trust: &Trust,
        token: IdentityToken,
        readings: &Readings,
        sender: &Sender,
        deadline: Duration,
    ) -> Result<(), ListenError> {
        let (session, events) = session(self, trust, token, deadline).await?;
        let board = Arc::new(Board::new(self.nodes.len()));
        // A session is polled by a task of its own, and never given up in the middle of a message.
        // Where this future ends, `here` goes and the task closes the session.
        let (here, gone) = oneshot::channel();
        let mut attended = tokio::spawn(attend(session.clone(), events, board.clone(), gone));
        let work = async {
            let late = |what| move |_| ListenError::Late { within: deadline, what };
            timeout(deadline, session.wait_for_connection()).await.map_err(late("to the login"))?;
            if self.username.is_some() && self.security == Security::None {
                tracing::warn!(
                    endpoint = self.endpoint,
                    "the password has gone to a server that is not verified; security = \"sign_and_encrypt\" protects it"
                );
            }
            timeout(deadline, self.subscribe(&session, &board, deadline))
                .await
                .map_err(late("to the request for a subscription"))??;
            self.take(&board, readings, sender, deadline).await
        };
        let result = tokio::select! {
            lost = &mut attended => Err(self.why(lost)),
            result = work => result,
        };
        drop(here);
        result
    }

    fn why(&self, lost: Result<Lost, tokio::task::JoinError>) -> ListenError {
        let user = || self.username.as_ref().map_or_else(|| "without a user".to_owned(), |user| format!("as {user:?}"));
        match lost {
            Ok(Lost::AtLogin(status)) => ListenError::Login { user: user(), status },
            Ok(Lost::Later(status)) => ListenError::Lost { status },
            Ok(Lost::Closed) => ListenError::Ended,
            Err(_) => ListenError::Library,
        }
    }

    async fn subscribe(&self, session: &Session, board: &Arc<Board>, deadline: Duration) -> Result<(), ListenError> {
        let interval = Duration::from_secs_f64(self.publish_secs);
        let writer = Writer { board: board.clone(), nodes: self.nodes.clone() };
        // After one interval without a change the server sends that there was none.
        let id = session
            .create_subscription(interval, LIFETIME_COUNT, 1, 0, 0, true, writer)
            .await
            .map_err(ListenError::Subscription)?;
        let given =
            session.subscription_state.lock().get(id).map(|given| {
                given.publishing_interval().as_secs_f64() * f64::from(given.max_keep_alive_count().max(1))
            });
        let expected_secs = deadline.as_secs_f64() / INTERVALS;
        if let Some(found_secs) = given.filter(|given| *given > expected_secs) {
            return Err(ListenError::Slow { found_secs, expected_secs });
        }
        let mut items = Vec::new();
        for (at, node) in self.nodes.iter().enumerate() {
            let wrong = |status| ListenError::Node { node: node.node.clone(), status };
            let id: NodeId = node.node.parse().map_err(wrong)?;
            items.push(MonitoredItemCreateRequest {
                item_to_monitor: ReadValueId::from(id),
                monitoring_mode: MonitoringMode::Reporting,
                requested_parameters: MonitoringParameters {
                    client_handle: u32::try_from(at + 1).unwrap_or(u32::MAX),
                    sampling_interval: 1e3 * self.publish_secs,
                    queue_size: 1,
                    discard_oldest: true,
                    ..MonitoringParameters::default()
                },
            });
        }
        let created = session
            .create_monitored_items(id, TimestampsToReturn::Neither, items)
            .await
            .map_err(ListenError::Subscription)?;
        if created.len() != self.nodes.len() {
            return Err(ListenError::Nodes { expected: self.nodes.len(), found: created.len() });
        }
        for (node, created) in self.nodes.iter().zip(&created) {
            let status = created.result.status_code;
            if !status.is_good() {
                return Err(ListenError::Node { node: node.node.clone(), status });
            }
        }
        Ok(())
    }

    /// Takes values until the service stops or the server is silent.
    async fn take(
        &self,
        board: &Board,
        readings: &Readings,
        sender: &Sender,
        deadline: Duration,
    ) -> Result<(), ListenError> {
        let mut remarks = vec![String::new(); self.nodes.len()];
        loop {
            let late = |_| ListenError::Late { within: deadline, what: "from the subscription" };
            timeout(deadline, board.news.notified()).await.map_err(late)?;
            if let Some(status) = *board.ended.lock().unwrap_or_else(PoisonError::into_inner) {
                return Err(ListenError::SubscriptionEnded(status));
            }
            let held = board.held.lock().unwrap_or_else(PoisonError::into_inner).clone();
            for ((node, held), remark) in self.nodes.iter().zip(held).zip(&mut remarks) {
                let (value, found) = node.take(held)?;
                readings.set(node.quantity, value, deadline);
                if *remark != found && !found.is_empty() {
                    tracing::warn!(endpoint = self.endpoint, node = node.node, "{found}");
                }
                *remark = found;
            }
            if sender.send(Packet::OperatingPoint(readings.point(now_unix_ns()))).await.is_err() {
                return Ok(());
            }
            sleep(SHORTEST_PAUSE).await;
        }
    }
}

impl Node {
    /// The physical value (`NaN` where there is none), and a remark where it is not simply good.
    fn take(&self, held: Option<Held>) -> Result<(f64, String), ListenError> {
        match held {
            // The first message may come before the first value.
            None => Ok((f64::NAN, String::new())),
            Some(Held::Number { value, status }) if status.is_uncertain() => {
                Ok((value, format!("its value is used, although the server gives it the status {status}")))
            }
            Some(Held::Number { value, .. }) => Ok((value, String::new())),
            Some(Held::Nothing(why)) => Ok((f64::NAN, format!("{why}; it is unknown"))),
            Some(Held::NoNumber(found)) => Err(ListenError::NoNumber { node: self.node.clone(), found }),
        }
    }
}
