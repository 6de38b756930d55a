//! Order spectra for the page and the log: made beside the ranks on a thread of their own, for the
//! page only while somebody looks, for the log now and then.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::order_spectrum::{OrderSpectrum, Orders};
use gearwatch_core::train::Train;
use gearwatch_core::verdict::HARMONICS;
use gearwatch_core::window::Window;

use crate::event::{Event, Fanout};
use crate::web::Hub;
use gearwatch_log::{SpectrumFrame, SpectrumLine};

/// A channel is shown at most so often: the eye does not need more.
const SHOWN_EVERY: Duration = Duration::from_millis(450);
/// Windows that may wait for the thread; more are not shown.
const WAITING: usize = 16;
/// Lines sent to a page, at most: more than a screen has columns.
const MOST_LINES: usize = 1500;
/// The view ends this far above the highest mesh harmonic.
const BEYOND: f64 = 1.08;

struct View {
    for_page: bool,
    for_log: bool,
    bench: Arc<str>,
    several: bool,
    train: Arc<Train>,
    samples: Vec<f64>,
    analysis: WindowAnalysis,
}

/// Sinks that want a spectrum of each channel every so often, counted in the data's own time.
#[derive(Clone)]
pub(super) struct Wanted {
    pub(super) sinks: Fanout,
    pub(super) every_secs: f64,
}

/// Starts the viewing thread. It ends with the last viewer that was made from what is returned.
pub(super) fn start(hub: &Arc<Hub>, wanted: Option<Wanted>, several: bool) -> std::io::Result<Views> {
    let (views, seen) = sync_channel(WAITING);
    let (page, sinks) = (hub.clone(), wanted.as_ref().map(|wanted| wanted.sinks.clone()));
    std::thread::Builder::new().name("gw-view".to_owned()).spawn(move || keep_showing(&seen, &page, sinks.as_ref()))?;
    Ok(Views {
        views,
        several,
        hub: hub.clone(),
        logged_every_ns: wanted.map(|wanted| (1e9 * wanted.every_secs) as i64),
    })
}

/// The way to the viewing thread.
pub(super) struct Views {
    views: SyncSender<View>,
    /// The service watches several benches.
    several: bool,
    hub: Arc<Hub>,
    logged_every_ns: Option<i64>,
}

impl Views {
    pub(super) fn of(&self, bench: Arc<str>, train: Train) -> Viewer {
        Viewer {
            bench,
            several: self.several,
            train: Arc::new(train),
            hub: self.hub.clone(),
            logged_every_ns: self.logged_every_ns,
            shown: HashMap::new(),
            logged: HashMap::new(),
            views: self.views.clone(),
        }
    }
}

/// Hands windows of one bench to the viewing thread.
pub(super) struct Viewer {
    bench: Arc<str>,
    several: bool,
    train: Arc<Train>,
    hub: Arc<Hub>,
    logged_every_ns: Option<i64>,
    shown: HashMap<Arc<str>, Instant>,
    logged: HashMap<Arc<str>, i64>,
    views: SyncSender<View>,
}

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Viewer").field("bench", &self.bench).finish_non_exhaustive()
    }
}

impl Viewer {
    /// Never waits: a window that the viewing thread has no room for is not shown, and its
    /// successor is logged in its place.
    pub(super) fn offer(&mut self, window: &Window, analysis: &WindowAnalysis) {
        if !analysis.input_speed_hz.is_known() {
            return;
        }
        let now = Instant::now();
        let for_page = self.hub.is_watched()
            && self.shown.get(&window.sensor).is_none_or(|last| now.duration_since(*last) >= SHOWN_EVERY);
        let for_log = self.logged_every_ns.is_some_and(|every| {
            // A replay that starts anew is due at once.
            self.logged
                .get(&window.sensor)
                .is_none_or(|&last| !(last..last.saturating_add(every)).contains(&analysis.t0))
        });
        if !(for_page || for_log) {
            return;
        }
        let offered = self.views.try_send(View {
            for_page,
            for_log,
            bench: self.bench.clone(),
            several: self.several,
            train: self.train.clone(),
            samples: window.samples.clone(),
            analysis: analysis.clone(),
        });
        if for_page {
            self.shown.insert(window.sensor.clone(), now);
        }
        if for_log && offered.is_ok() {
            self.logged.insert(window.sensor.clone(), analysis.t0);
        }
    }
}

/// Shows windows until the last viewer has gone; what panics at one window goes on with the next.
fn keep_showing(views: &Receiver<View>, hub: &Hub, sinks: Option<&Fanout>) {
    while catch_unwind(AssertUnwindSafe(|| show(views, hub, sinks))).is_err() {
        tracing::error!("view: its code panicked");
    }
}

fn show(views: &Receiver<View>, hub: &Hub, sinks: Option<&Fanout>) {
    let mut spectrum = OrderSpectrum::default();
    let mut orders = Orders::default();
    for view in views {
        gearwatch_runtime::fail::point("view");
        if !spectrum.window(&view.samples, &view.analysis, &mut orders) {
            continue;
        }
        let frame = frame(&view, &orders);
        if view.for_page {
            hub.spectrum(&frame);
        }
        if let Some(sinks) = sinks.filter(|_| view.for_log) {
            sinks.mention(Event::Spectrum(Arc::new(frame)));
        }
    }
}

/// The part of a spectrum that holds the mesh harmonics, in lines that a screen can show: each the
/// largest of its group, so that no peak is lost.
fn frame(view: &View, orders: &Orders) -> SpectrumFrame {
    let highest = view.train.stages.iter().map(|s| s.harmonic_order(HARMONICS)).fold(0.0, f64::max) * BEYOND;
    let lines = ((highest / orders.step).ceil() as usize).clamp(2, orders.amplitude.len());
    let group = lines.div_ceil(MOST_LINES);
    let largest = |lines: &[f64]| lines.iter().fold(0.0, |a: f64, &b| a.max(b)) as f32;
    SpectrumFrame {
        bench: view.bench.to_string(),
        several: view.several,
        channel: view.analysis.sensor.to_string(),
        unit: view.analysis.unit.to_string(),
        t0_ns: view.analysis.t0,
        first_order: 0.5 * (group - 1) as f64 * orders.step,
        order_step: group as f64 * orders.step,
        amplitude: orders.amplitude[..lines].chunks(group).map(largest).collect(),
        lines: marked(&view.train, highest),
    }
}

/// Mesh harmonics, the first sidebands of both shafts, and the lines that passing planets and
/// idlers make.
fn marked(train: &Train, highest: f64) -> Vec<SpectrumLine> {
    let mut out = Vec::new();
    for stage in &train.stages {
        for harmonic in 1..=HARMONICS {
            let carrier = stage.harmonic_order(harmonic);
            out.push(SpectrumLine { order: carrier, label: format!("{} {harmonic}x", stage.name), sideband: false });
            for shaft in [stage.pinion_order, stage.wheel_order] {
                for order in [carrier - shaft, carrier + shaft] {
                    out.push(SpectrumLine { order, label: String::new(), sideband: true });
                }
            }
            for offset in stage.beside(harmonic) {
                out.push(SpectrumLine { order: carrier + offset, label: String::new(), sideband: true });
            }
        }
    }
    out.retain(|line| line.order <= highest);
    out
}
