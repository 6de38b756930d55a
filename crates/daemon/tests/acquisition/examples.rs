//! Every kind of source: its example is a configuration, and what is wrong in one is said.

use std::path::Path;

use gearwatch_daemon::config::Config;
use gearwatch_sources::KINDS;

fn parse(keys: &str) -> Result<Config, String> {
    let text = format!("format = \"gearwatch-service/1\"\n[[bench]]\n[[bench.source]]\n{keys}");
    Config::parse(&text, "test", Path::new("")).map_err(|e| e.to_string())
}

#[test]
fn conform_every_example_is_a_configuration_and_shows_itself_again() {
    for kind in KINDS {
        let config = match parse(&format!("kind = {:?}\n{}", kind.name, kind.example)) {
            // A sound card needs headers of the system, and is in few builds.
            Err(left_out) if kind.name == "sound_card" && left_out.contains("cargo feature \"sound-card\"") => continue,
            parsed => parsed.unwrap_or_else(|e| panic!("{e}")),
        };
        let shown = config.shown();
        let again = Config::parse(&shown, "shown", Path::new("")).unwrap_or_else(|e| panic!("{}: {e}", kind.name));
        assert_eq!(again.shown(), shown);
    }
}

#[test]
fn conform_values_that_cannot_be_are_named() {
    let frames = "frames = { channels = [\"a\"] }";
    for (keys, why) in [
        ("kind = \"lanxi\"\naddress = \"http://x\"\nchannels = []", "address is \"http://x\""),
        ("kind = \"lanxi\"\naddress = \"x\"\nchannels = [{ input = 0, sensor = \"a\" }]", "input is 0"),
        ("kind = \"lanxi\"\naddress = \"x\"\nchannels = [{ input = 1, sensor = \"a\", unit = \"g\" }]", "go together"),
        ("kind = \"lanxi\"\naddress = \"x\"\nchannels = [{ input = 1, sensor = \"a\", gain = 2 }]", "gain"),
        (&format!("kind = \"tcp\"\n{frames}"), "either connect or listen"),
        (&format!("kind = \"tcp\"\nconnect = \"x\"\n{frames}"), "expected host:port"),
        (&format!("kind = \"udp\"\nlisten = \"x\"\n{frames}"), "listen"),
        ("kind = \"udp\"\nlisten = \"127.0.0.1:1\"\nframes = { channels = [], unit = \"N\" }", "unit is \"N\""),
        ("kind = \"modbus\"\naddress = \"x\"\nregisters = []", "expected host:port"),
        (
            "kind = \"modbus\"\naddress = \"x:1\"\nregisters = [{ quantity = \"brake_torque_nm\", register = 1, scale = 0.0 }]",
            "scale 0",
        ),
        ("kind = \"mqtt\"\nbroker = \"x\"\ntopics = []", "broker is \"x\""),
        (
            "kind = \"mqtt\"\nbroker = \"x:1\"\ntopics = [{ quantity = \"temperature_c\", topic = \"a/#\" }]",
            "without wildcards",
        ),
        ("kind = \"mqtt\"\nbroker = \"x:1\"\ntopics = [{ quantity = \"torque\", topic = \"a\" }]", "brake_torque_nm"),
        ("kind = \"opcua\"\nendpoint = \"192.168.1.10\"\nnodes = []", "expected opc.tcp://host:port"),
        ("kind = \"opcua\"\nendpoint = \"opc.tcp://me:secret@plc\"\nnodes = []", "endpoint opc.tcp://plc holds a user"),
        (
            "kind = \"opcua\"\nendpoint = \"opc.tcp://x\"\nnodes = [{ quantity = \"temperature_c\", node = \"Oil\" }]",
            "expected an id as ns=2;s=Brake.Torque",
        ),
        (
            "kind = \"opcua\"\nendpoint = \"opc.tcp://x\"\nsecurity = \"sign\"\nnodes = []",
            "server_certificate is missing",
        ),
        (
            "kind = \"opcua\"\nendpoint = \"opc.tcp://x\"\npassword_file = \"p\"\nnodes = []",
            "password_file goes with username",
        ),
        ("kind = \"nidaqmx\"\nsample_rate_hz = 1e9\nchannels = []", "channels is empty"),
        (
            "kind = \"nidaqmx\"\nsample_rate_hz = 1e4\nchannels = [{ input = \"ai0\", sensor = \"a\" }]",
            "expected a device and an input",
        ),
        (
            "kind = \"nidaqmx\"\nsample_rate_hz = 1e4\nchannels = [{ input = \"D/ai0\", sensor = \"a\", iepe_current_ma = 2.0 }]",
            "goes with an accelerometer",
        ),
        (
            "kind = \"iio\"\nuri = \"192.168.1.3\"\ndevice = \"x\"\nsample_rate_hz = 1e4\nchannels = []",
            "expected local:",
        ),
        (
            "kind = \"iio\"\ndevice = \"x\"\nsample_rate_hz = 1e4\nchannels = [{ input = \"accel_x\", sensor = \"a\", unit = \"g\" }]",
            "the device says its unit itself",
        ),
        (
            &format!("data_deadline_secs = inf\nkind = \"tcp\"\nconnect = \"x:1\"\n{frames}"),
            "data_deadline_secs is inf",
        ),
    ] {
        let error = parse(keys).expect_err(keys);
        assert!(error.contains(why), "{why}: {error}");
    }
}
