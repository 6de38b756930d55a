//! `gearwatch emulate`: instruments that are not there.

use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::Context;
use clap::{Args, Subcommand};
use gearwatch_daemon::bench::read_bench;
use gearwatch_daemon::service::Reload;
use gearwatch_emulate::{FrameSender, Instrument, InstrumentConfig, Material, Open, TroubleConfig, open_source};
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::{SourceContext, Speed};

use super::Run;
use crate::exit::Exit;
use crate::terminal;
use crate::{signals, talk};

/// Play the simulator or a recording as an instrument would, with trouble if you like
///
/// For trying the service without hardware, and for seeing what it does when an instrument
/// misbehaves.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch emulate lanxi                         a LAN-XI front end at 127.0.0.1:8651, simulated
  gearwatch emulate lanxi --file run-up.mcap      plays a recording, again and again
  gearwatch emulate lanxi --drop-every 20 --flip-every 10
  gearwatch emulate lanxi --trouble 7             all that a network does, drawn from 7
  gearwatch emulate tcp --listen 127.0.0.1:5511   frames for a source of kind \"tcp\"
  gearwatch emulate udp --to 127.0.0.1:5512       frames for a source of kind \"udp\"

It prints the [[bench.source]] that reads it, to be put into a configuration. Ctrl-C ends it. Exit codes: 0 ended; 3 bad input.")]
pub struct Emulate {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// A LAN-XI front end: web server and stream
    Lanxi(Lanxi),
    /// A program that sends frames over TCP
    Tcp(Tcp),
    /// A program that sends frames over UDP
    Udp(Udp),
}

#[derive(Args)]
struct Lanxi {
    /// Address of the web server
    #[arg(short, long, default_value = "127.0.0.1:8651", value_name = "ADDR")]
    listen: SocketAddr,
    /// Serial number
    #[arg(long, default_value_t = 100_001, value_name = "N")]
    serial: u64,
    /// So many calls of `open` are refused with 403
    #[arg(long, default_value_t = 0, value_name = "N")]
    refuse: u32,
    #[command(flatten)]
    play: Play,
    #[command(flatten)]
    trouble: Trouble,
}

#[derive(Args)]
struct Tcp {
    /// Waits for the service here
    #[arg(short, long, default_value = "127.0.0.1:5511", value_name = "ADDR")]
    listen: SocketAddr,
    /// Calls the service there instead
    #[arg(short, long, conflicts_with = "listen", value_name = "ADDR")]
    connect: Option<SocketAddr>,
    #[command(flatten)]
    play: Play,
    #[command(flatten)]
    trouble: Trouble,
}

#[derive(Args)]
struct Udp {
    /// Sends there
    #[arg(short, long, default_value = "127.0.0.1:5512", value_name = "ADDR")]
    to: SocketAddr,
    #[command(flatten)]
    play: Play,
    #[command(flatten)]
    trouble: Trouble,
}

/// What is played.
#[derive(Args)]
struct Play {
    /// Bench file that is simulated; the built-in demonstration bench where left out
    #[arg(short, long, value_name = "FILE")]
    bench: Option<PathBuf>,
    /// Scenario of the simulation
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    scenario: Option<PathBuf>,
    /// Recording that is played in place of the simulation
    #[arg(short, long, value_name = "FILE")]
    file: Option<PathBuf>,
    /// Seconds of signal per second
    #[arg(short, long, default_value = "1")]
    speed: Speed,
}

/// Intervals are means, in seconds of signal.
#[derive(Args)]
struct Trouble {
    /// A mixture of everything, drawn from this number; the flags below change it
    #[arg(long, value_name = "SEED")]
    trouble: Option<u64>,
    /// A channel is overloaded for a second (LAN-XI)
    #[arg(long, value_name = "SECS")]
    clip_every: Option<f64>,
    /// Up to half a second is dropped
    #[arg(long, value_name = "SECS")]
    overrun_every: Option<f64>,
    /// Nothing is sent for a while
    #[arg(long, value_name = "SECS")]
    stall_every: Option<f64>,
    /// How long a stall is
    #[arg(long, value_name = "SECS", default_value_t = 2.0)]
    stall_secs: f64,
    /// The connection is closed inside a message
    #[arg(long, value_name = "SECS")]
    drop_every: Option<f64>,
    /// A bit is flipped
    #[arg(long, value_name = "SECS")]
    flip_every: Option<f64>,
    /// A message is late
    #[arg(long, value_name = "SECS")]
    delay_every: Option<f64>,
    /// Nothing is sent any more on a connection, which stays open
    #[arg(long, value_name = "SECS")]
    mute_after: Option<f64>,
    /// Writes end anywhere, often after one byte
    #[arg(long)]
    split: bool,
}

impl Trouble {
    fn config(&self, refuse: u32) -> anyhow::Result<TroubleConfig> {
        let base = self.trouble.map_or_else(TroubleConfig::default, TroubleConfig::of_network);
        for (flag, value) in [
            ("--clip-every", self.clip_every),
            ("--overrun-every", self.overrun_every),
            ("--stall-every", self.stall_every),
            ("--stall-secs", Some(self.stall_secs)),
            ("--drop-every", self.drop_every),
            ("--flip-every", self.flip_every),
            ("--delay-every", self.delay_every),
            ("--mute-after", self.mute_after),
        ] {
            if let Some(secs) = value {
                anyhow::ensure!(secs > 0.0 && secs <= 1e6, "{flag} is {secs}; expected a number above 0 and up to 1e6");
            }
        }
        Ok(TroubleConfig {
            seed: base.seed,
            split: self.split || base.split,
            refuse: refuse.max(base.refuse),
            clip_every_secs: self.clip_every.or(base.clip_every_secs),
            overrun_every_secs: self.overrun_every.or(base.overrun_every_secs),
            stall_every_secs: self.stall_every.or(base.stall_every_secs),
            stall_secs: self.stall_secs,
            drop_every_secs: self.drop_every.or(base.drop_every_secs),
            flip_every_secs: self.flip_every.or(base.flip_every_secs),
            delay_every_secs: self.delay_every.or(base.delay_every_secs),
            mute_after_secs: self.mute_after.or(base.mute_after_secs),
        })
    }
}

impl Play {
    fn open(&self, stop: &Stop) -> anyhow::Result<Open> {
        let bench = read_bench(self.bench.as_deref())?;
        let context = SourceContext::new(Arc::new(bench), PathBuf::new(), stop.clone());
        let path = |path: &PathBuf| toml::Value::String(path.display().to_string());
        let mut keys = toml::Table::new();
        // The emulator itself keeps time.
        keys.insert("speed".to_owned(), "max".into());
        let kind = if let Some(file) = &self.file {
            keys.insert("path".to_owned(), path(file));
            "file"
        } else {
            if let Some(scenario) = &self.scenario {
                keys.insert("scenario".to_owned(), path(scenario));
            }
            "simulator"
        };
        Ok(open_source(kind, keys, context)?)
    }
}

impl Run for Emulate {
    const NAME: &'static str = "emulate";

    fn run(self) -> anyhow::Result<Exit> {
        let _talk = talk::start();
        let stop = Stop::default();
        signals::listen(&stop, &Reload::default())?;
        match self.what {
            What::Lanxi(lanxi) => lanxi.run(&stop)?,
            What::Tcp(tcp) => tcp.run(&stop)?,
            What::Udp(udp) => udp.run(&stop)?,
        }
        Ok(Exit::Ok)
    }
}

/// How often the state is told.
const TELL: Duration = Duration::from_secs(10);

impl Lanxi {
    fn run(self, stop: &Stop) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let config = InstrumentConfig {
            listen: self.listen,
            serial: self.serial,
            speed: self.play.speed,
            trouble: self.trouble.config(self.refuse)?,
            ..InstrumentConfig::default()
        };
        let instrument = Instrument::start(config, self.play.open(stop)?, runtime.handle())
            .with_context(|| format!("{}: no instrument", self.listen))?;
        let channels = instrument.channels().iter().enumerate();
        let inputs = channels.map(|(i, channel)| format!("{{ input = {}, sensor = {:?} }}", i + 1, channel.sensor));
        print(&format!(
            "kind = \"lanxi\"\naddress = \"{}\"\nsample_rate_hz = {:?}\nchannels = [{}]\ntake_over = true",
            instrument.address(),
            instrument.rate_hz(),
            inputs.collect::<Vec<_>>().join(", ")
        ))?;
        while stop.sleep(TELL) {
            let stats = instrument.stats();
            let of = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
            tracing::info!(
                measurements = of(&stats.measurements),
                messages = of(&stats.messages),
                overruns = of(&stats.overruns),
                drops = of(&stats.drops),
                flips = of(&stats.flips),
                refused = of(&stats.refused),
                "an emulated instrument"
            );
        }
        Ok(())
    }
}

impl Tcp {
    fn run(self, stop: &Stop) -> anyhow::Result<()> {
        let material = Material::new(self.play.open(stop)?, self.play.speed, stop.clone())?;
        let frames = layout(&material);
        let mut sender = FrameSender::new(material, self.trouble.config(0)?, stop.clone());
        if let Some(peer) = self.connect {
            print(&format!("kind = \"tcp\"\nlisten = \"{peer}\"\n{frames}"))?;
            sender.connect(peer)?;
        } else {
            let listener = TcpListener::bind(self.listen).with_context(|| self.listen.to_string())?;
            print(&format!("kind = \"tcp\"\nconnect = \"{}\"\n{frames}", listener.local_addr()?))?;
            sender.serve(&listener)?;
        }
        Ok(())
    }
}

impl Udp {
    fn run(self, stop: &Stop) -> anyhow::Result<()> {
        let material = Material::new(self.play.open(stop)?, self.play.speed, stop.clone())?;
        print(&format!("kind = \"udp\"\nlisten = \"{}\"\n{}", self.to, layout(&material)))?;
        FrameSender::new(material, self.trouble.config(0)?, stop.clone()).datagrams(self.to)?;
        Ok(())
    }
}

fn layout(material: &Material) -> String {
    let names: Vec<_> = material.channels().iter().map(|channel| format!("{:?}", channel.sensor)).collect();
    let unit = material.channels().first().map_or("1", |channel| channel.unit.as_str());
    format!("frames = {{ channels = [{}], unit = {unit:?} }}", names.join(", "))
}

/// What reads it, for a configuration.
fn print(source: &str) -> std::io::Result<()> {
    writeln!(terminal::out(), "[[bench.source]]\n{source}")
}
