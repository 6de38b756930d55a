//! Recordings of all formats: right values, round trips through MCAP, damaged and contradictory
//! files, options.

mod csv;
mod damaged;
mod mat;
mod mat_stored;
mod options;
mod oracle;
mod round_trip;
mod tdms;
mod tdms_blocks;
mod uff;
mod wav;
