//! The service against real brokers, which the tests start themselves; skipped with a message where
//! there are none.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "tests tell figures, and what was skipped")]

#[path = "../service/fixture.rs"]
#[expect(dead_code, reason = "shared with the tests of the service, which use all of it")]
mod fixture;
#[path = "../campaign/service.rs"]
#[expect(dead_code, reason = "shared with the campaigns, which use all of it")]
mod service;

mod between;
mod fleet;
mod live_view;
mod mqtt;
mod nats;
mod server;
mod tls;
mod webhook;
