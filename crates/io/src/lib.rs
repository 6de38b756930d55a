//! Every byte format that crosses gearwatch's border: recordings, bench files, baselines, logs.

pub mod bench_file;
