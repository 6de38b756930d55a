//! Schemas of other programs: accelerations of `sensor_msgs/msg/Imu` and sound of
//! `foxglove.RawAudio`.

pub mod imu;
pub mod raw_audio;
pub mod ros2;
