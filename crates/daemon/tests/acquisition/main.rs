//! Sources in a service: their configuration, and what one that fails does to the rest.

mod examples;
mod opcua;
mod operating_point;
mod several;
mod support;
