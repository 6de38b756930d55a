//! Order spectra for the page: made beside the ranks, on a thread of their own, and only while somebody looks.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::order_spectrum::{OrderSpectrum, Orders};
use gearwatch_core::train::Train;
use gearwatch_core::verdict::HARMONICS;
use gearwatch_core::window::Window;

use crate::web::{Hub, SpectrumFrame, SpectrumLine};

/// A channel is shown at most so often: the eye does not need more.
const EVERY: Duration = Duration::from_millis(450);
/// Windows that may wait for the thread; more are not shown.
const WAITING: usize = 16;
/// Lines sent to a page, at most: more than a screen has columns.
const MOST_LINES: usize = 1500;
/// The view ends this far above the highest mesh harmonic.
const BEYOND: f64 = 1.08;

struct View {
    bench: Arc<str>,
    train: Arc<Train>,
    samples: Vec<f64>,
    analysis: WindowAnalysis,
}

/// Hands windows of one bench to the viewing thread.
pub(super) struct Viewer {
    bench: Arc<str>,
    train: Arc<Train>,
    hub: Arc<Hub>,
    last: HashMap<Arc<str>, Instant>,
    views: SyncSender<View>,
}

/// Starts the viewing thread. It ends with the last viewer that was made from what is returned.
pub(super) fn start(hub: &Arc<Hub>) -> std::io::Result<Views> {
    let (views, seen) = sync_channel(WAITING);
    let shown = hub.clone();
    std::thread::Builder::new().name("gw-view".to_owned()).spawn(move || show(&seen, &shown))?;
    Ok(Views { views, hub: hub.clone() })
}

/// The way to the viewing thread.
pub(super) struct Views {
    views: SyncSender<View>,
    hub: Arc<Hub>,
}

impl Views {
    pub(super) fn of(&self, bench: Arc<str>, train: Train) -> Viewer {
        let train = Arc::new(train);
        Viewer { bench, train, hub: self.hub.clone(), last: HashMap::new(), views: self.views.clone() }
    }
}

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Viewer").field("bench", &self.bench).finish_non_exhaustive()
    }
}

impl Viewer {
    /// Never waits: a window that the viewing thread has no room for is not shown.
    pub(super) fn offer(&mut self, window: &Window, analysis: &WindowAnalysis) {
        if !self.hub.is_watched() || !analysis.input_speed_hz.is_known() {
            return;
        }
        let now = Instant::now();
        if self.last.get(&window.sensor).is_some_and(|last| now.duration_since(*last) < EVERY) {
            return;
        }
        self.last.insert(window.sensor.clone(), now);
        let _ = self.views.try_send(View {
            bench: self.bench.clone(),
            train: self.train.clone(),
            samples: window.samples.clone(),
            analysis: analysis.clone(),
        });
    }
}

fn show(views: &Receiver<View>, hub: &Hub) {
    let mut spectrum = OrderSpectrum::default();
    let mut orders = Orders::default();
    for view in views {
        if spectrum.window(&view.samples, &view.analysis, &mut orders) {
            hub.spectrum(&frame(&view, &orders));
        }
    }
}

/// The part of a spectrum that holds the mesh harmonics, in lines that a screen can show: each the largest of its group, so that no
/// peak is lost.
fn frame(view: &View, orders: &Orders) -> SpectrumFrame {
    let highest = view.train.stages.iter().map(|s| s.mesh_order).fold(0.0, f64::max) * HARMONICS as f64 * BEYOND;
    let lines = ((highest / orders.step).ceil() as usize).clamp(2, orders.amplitude.len());
    let group = lines.div_ceil(MOST_LINES);
    let largest = |lines: &[f64]| lines.iter().fold(0.0, |a: f64, &b| a.max(b)) as f32;
    SpectrumFrame {
        bench: view.bench.to_string(),
        channel: view.analysis.sensor.to_string(),
        unit: view.analysis.unit.to_string(),
        t0_ns: view.analysis.t0,
        first_order: 0.5 * (group - 1) as f64 * orders.step,
        order_step: group as f64 * orders.step,
        amplitude: orders.amplitude[..lines].chunks(group).map(largest).collect(),
        lines: marked(&view.train, highest),
    }
}

/// Mesh harmonics, and the first sidebands of both shafts.
fn marked(train: &Train, highest: f64) -> Vec<SpectrumLine> {
    let mut out = Vec::new();
    for stage in &train.stages {
        for harmonic in 1..=HARMONICS {
            let carrier = harmonic as f64 * stage.mesh_order;
            out.push(SpectrumLine { order: carrier, label: format!("{} {harmonic}x", stage.name), sideband: false });
            for shaft in [stage.pinion_order, stage.wheel_order] {
                for order in [carrier - shaft, carrier + shaft] {
                    out.push(SpectrumLine { order, label: String::new(), sideband: true });
                }
            }
        }
    }
    out.retain(|line| line.order <= highest);
    out
}
