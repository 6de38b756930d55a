//! MCAP, gearwatch's own recordings and foreign ones.

use std::io::Read;

use crate::mcap::McapSource;
use crate::mcap::walk::{Limits, MAGIC};
use crate::open::{Bytes, OpenOptions, Reader};
use crate::problem::Problem;

use super::Format;

/// See the module.
pub(super) struct Mcap;

impl Format for Mcap {
    fn name(&self) -> &'static str {
        "MCAP"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["mcap"]
    }

    fn help(&self) -> &'static str {
        "recordings of gearwatch; topics with sensor_msgs/msg/Imu (ROS 2) or foxglove.RawAudio of other programs"
    }

    fn sniff(&self, head: &[u8]) -> bool {
        head.starts_with(&MAGIC)
    }

    fn open(&self, bytes: Bytes, _options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
        Ok(Box::new(McapSource::new(bytes, Limits::default())))
    }
}

impl<R: Read + Send> Reader for McapSource<R> {
    fn warnings(&self) -> Vec<String> {
        Self::warnings(self).to_vec()
    }
}
