//! MCAP recordings: the contract, round trips, foreign and damaged files.

mod contract;
mod damaged;
mod fixture;
mod foreign;
