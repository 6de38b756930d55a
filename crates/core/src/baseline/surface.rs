//! The surface over speed and torque: cells, and what lies between them where there are enough.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::cells::{Cell, Gathered, Reference, cells};
use super::{Baseline, BaselineConfig, Run, ScatterPrior};
use crate::verdict::HARMONICS;

/// The most cells that one operating point is worked out from: two on each of two lines of equal
/// torque.
const CORNERS: usize = 4;

/// Where an operating point lies among the cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    corners: [(usize, f64); CORNERS],
    count: usize,
    /// Σ (w (x−a)(b−x))² over the lines of equal torque, x = ln speed.
    speed_span_squared: f64,
    /// (T−a)(b−T) between lines of equal torque.
    torque_span: f64,
    /// A cell lies within the tolerances: its own runs say what a run there scatters by.
    in_cell: bool,
}

impl Place {
    fn corners(&self) -> &[(usize, f64)] {
        &self.corners[..self.count]
    }

    /// Σ w²
    fn weights(&self) -> f64 {
        self.corners().iter().map(|(_, weight)| weight * weight).sum()
    }
}

/// Value at each cell, and how strongly it bends between cells.
#[derive(Clone, Debug, PartialEq)]
struct Series {
    cells: Vec<Option<Reference>>,
    speed_bend: Bend,
    torque_bend: Bend,
}

/// What leaving out each inner cell in turn says of the error of interpolating. Two causes would
/// explain it: a surface that bends, whose error shrinks with the gap between the cells, and cells
/// that are rough from run to run, whose error does not. Few cells do not tell them apart, so that
/// the larger error of the two is stated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Bend {
    /// Mean square of the second derivative, if all were bend.
    mean_square: f64,
    /// Variance of a cell, if all were roughness.
    roughness: f64,
    residuals: f64,
}

/// One stage of one sensor: lines and floors, 1x to 5x.
#[derive(Clone, Debug, PartialEq)]
struct StageSurface {
    lines: [Series; HARMONICS],
    floors: [Series; HARMONICS],
    line_prior: ScatterPrior,
    floor_prior: ScatterPrior,
}

/// One sensor.
#[derive(Clone, Debug, PartialEq)]
struct ChannelSurface {
    unit: String,
    stages: Vec<StageSurface>,
    /// Condition indicators in the order of their names.
    indicators: Vec<Series>,
}

/// A baseline made ready for use.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    config: BaselineConfig,
    cells: Vec<Cell>,
    /// Cells of equal torque, by speed; sorted by torque, unknown torque first.
    torque_lines: Vec<(Option<f64>, Vec<usize>)>,
    interpolates_speed: bool,
    interpolates_torque: bool,
    channels: BTreeMap<String, ChannelSurface>,
}

impl Surface {
    /// Works out cells, scatter and bend from the runs.
    pub fn new(baseline: &Baseline) -> Self {
        let config = baseline.config;
        let (cells, torque_lines, members) = cells(&baseline.runs, &config);
        let mut surface = Self {
            config,
            cells,
            torque_lines,
            interpolates_speed: true,
            interpolates_torque: true,
            channels: BTreeMap::new(),
        };
        // Interpolation needs an inner cell, by which its error can be judged. Which lines there
        // are decides, not the values; so that it is settled first.
        let speed_triples = surface.speed_triples();
        surface.interpolates_speed = !speed_triples.is_empty();
        let torque_triples = surface.torque_triples();
        surface.interpolates_torque = !torque_triples.is_empty();
        let mut names: Vec<(&String, &String)> =
            baseline.runs.iter().flat_map(|run| &run.channels).map(|(name, c)| (name, &c.unit)).collect();
        names.sort_unstable();
        names.dedup_by_key(|(name, _)| *name);
        let indicator_names = crate::indicators::columns::names(baseline.stages.len());
        for (name, unit) in names {
            let gather = |floor: bool| -> Vec<Vec<Vec<Option<Gathered>>>> {
                (0..baseline.stages.len())
                    .map(|stage| {
                        (0..HARMONICS)
                            .map(|h| members.iter().map(|runs| Gathered::of(runs, name, stage, h, floor)).collect())
                            .collect()
                    })
                    .collect()
            };
            let (lines, floors) = (gather(false), gather(true));
            // What scatters alike are the lines of one stage at one sensor, over all cells.
            let prior = |stage: &[Vec<Option<Gathered>>]| {
                let variances: Vec<_> = stage.iter().flatten().flatten().map(|g| (g.variance, g.freedom)).collect();
                ScatterPrior::learn(&variances)
            };
            let run_prior = |stage: &[Vec<Option<Gathered>>]| {
                let squares = stage.iter().flatten().flatten().map(|g| (g.run_mean_square, g.run_freedom));
                ScatterPrior::learn(&squares.collect::<Vec<_>>())
            };
            let series = |gathered: &[Option<Gathered>], (prior, run_prior): (ScatterPrior, ScatterPrior)| {
                let reference = |g: &Gathered| {
                    let reference = g.reference(prior, run_prior);
                    (reference.scatter_freedom + 1.0 >= config.least_windows).then_some(reference)
                };
                let cells: Vec<_> = gathered.iter().map(|g| g.as_ref().and_then(reference)).collect();
                Series {
                    speed_bend: surface.speed_bend(&cells, &speed_triples),
                    torque_bend: surface.torque_bend(&cells, &torque_triples),
                    cells,
                }
            };
            let stages = lines
                .iter()
                .zip(&floors)
                .map(|(lines, floors)| {
                    let (line_prior, floor_prior) = (prior(lines), prior(floors));
                    let (line_runs, floor_runs) = (run_prior(lines), run_prior(floors));
                    StageSurface {
                        lines: std::array::from_fn(|h| series(&lines[h], (line_prior, line_runs))),
                        floors: std::array::from_fn(|h| series(&floors[h], (floor_prior, floor_runs))),
                        line_prior,
                        floor_prior,
                    }
                })
                .collect();
            // Nothing says that one indicator scatters as another: each stands by itself.
            let alone = (ScatterPrior::NONE, ScatterPrior::NONE);
            let indicator = |indicator: &String| {
                let of = |run: &Run| {
                    let known = run.channels.get(name)?.indicators.get(indicator)?;
                    Some([known.value.ln(), known.scatter, known.effective, known.noise])
                };
                let gathered: Vec<_> = members.iter().map(|runs| Gathered::by(runs, &of)).collect();
                series(&gathered, alone)
            };
            let indicators = indicator_names.iter().map(indicator).collect();
            surface.channels.insert(name.clone(), ChannelSurface { unit: unit.clone(), stages, indicators });
        }
        surface
    }

    /// A torque is known of some operating point.
    pub fn knows_torque(&self) -> bool {
        self.torque_lines.iter().any(|(torque, _)| torque.is_some())
    }

    /// The operating points that the baseline has seen.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Unit of a channel, none for a channel that the baseline does not know.
    pub fn unit(&self, channel: &str) -> Option<&str> {
        self.channels.get(channel).map(|c| c.unit.as_str())
    }

    /// What the scatters of the lines, and of the floors, of a stage at a channel have in common.
    pub fn priors(&self, channel: &str, stage: usize) -> Option<(ScatterPrior, ScatterPrior)> {
        self.channels.get(channel)?.stages.get(stage).map(|s| (s.line_prior, s.floor_prior))
    }

    /// Finds an operating point among the cells; none outside what the baseline has seen.
    ///
    /// Between cells of equal torque it is interpolated over ln speed, and between lines of equal
    /// torque over torque, wherever an inner cell exists by which the error of interpolating is
    /// known; else the nearest cell within the tolerance serves.
    pub fn locate(&self, input_speed_hz: f64, brake_torque_nm: Option<f64>) -> Option<Place> {
        let candidates = || {
            self.torque_lines
                .iter()
                .filter(|(torque, _)| torque.is_some() == brake_torque_nm.is_some())
                .filter_map(|(torque, line)| Some((torque.unwrap_or(0.0), self.along(line, input_speed_hz)?)))
        };
        let wanted = brake_torque_nm.unwrap_or(0.0);
        let below = candidates().rfind(|(t, _)| *t <= wanted);
        let above = candidates().find(|(t, _)| *t >= wanted);
        if let (Some((low, a)), Some((high, b)), true) = (below, above, self.interpolates_torque) {
            let place = if low == high {
                Place::new(&[(a, 1.0)], 0.0)
            } else {
                let share = (wanted - low) / (high - low);
                Place::new(&[(a, 1.0 - share), (b, share)], (wanted - low) * (high - wanted))
            };
            return Some(Place { in_cell: self.is_in_cell(&place, input_speed_hz, brake_torque_nm), ..place });
        }
        let nearest = candidates().min_by(|(s, _), (t, _)| (s - wanted).abs().total_cmp(&(t - wanted).abs()))?;
        self.config
            .torque_matches(brake_torque_nm, brake_torque_nm.map(|_| nearest.0))
            .then(|| Place::new(&[(nearest.1, 1.0)], 0.0))
            .map(|place| Place { in_cell: self.is_in_cell(&place, input_speed_hz, brake_torque_nm), ..place })
    }

    /// One of the cells that serve lies within the tolerances.
    fn is_in_cell(&self, place: &Place, speed_hz: f64, torque_nm: Option<f64>) -> bool {
        place.corners().iter().map(|(cell, _)| &self.cells[*cell]).any(|cell| {
            self.config.speed_matches(cell.input_speed_hz, speed_hz)
                && self.config.torque_matches(cell.brake_torque_nm, torque_nm)
        })
    }

    /// Where a speed lies on a line of equal torque.
    fn along(&self, line: &[usize], speed_hz: f64) -> Option<Along> {
        let speed = |cell: usize| self.cells[cell].input_speed_hz;
        let after = line.partition_point(|&cell| speed(cell) < speed_hz);
        if self.interpolates_speed && after > 0 && after < line.len() {
            return Some(between(line[after - 1], line[after], speed(line[after - 1]), speed(line[after]), speed_hz));
        }
        let neighbours = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|i| line.get(i));
        let nearest =
            neighbours.min_by(|&&a, &&b| (speed(a) - speed_hz).abs().total_cmp(&(speed(b) - speed_hz).abs()))?;
        self.config
            .speed_matches(speed(*nearest), speed_hz)
            .then_some(Along { cells: [(*nearest, 1.0), (*nearest, 0.0)], span: 0.0 })
    }

    /// Each inner cell of a line of equal torque with its neighbours.
    fn speed_triples(&self) -> Vec<(usize, Along)> {
        let speed = |cell: usize| self.cells[cell].input_speed_hz;
        let mut out = Vec::new();
        for (_, line) in &self.torque_lines {
            for three in line.windows(3) {
                let [a, cell, b] = [three[0], three[1], three[2]];
                out.push((cell, between(a, b, speed(a), speed(b), speed(cell))));
            }
        }
        out
    }

    /// Each cell of an inner torque line with what its neighbour lines say at its speed.
    fn torque_triples(&self) -> Vec<(usize, Place)> {
        let known: Vec<_> = self.torque_lines.iter().filter_map(|(t, line)| Some((((*t)?), line))).collect();
        let mut out = Vec::new();
        for three in known.windows(3) {
            for &cell in three[1].1 {
                let speed = self.cells[cell].input_speed_hz;
                if let (Some(a), Some(b)) = (self.along(three[0].1, speed), self.along(three[2].1, speed)) {
                    let (low, torque, high) = (three[0].0, three[1].0, three[2].0);
                    let share = (torque - low) / (high - low);
                    let span = (torque - low) * (high - torque);
                    out.push((cell, Place::new(&[(a, 1.0 - share), (b, share)], span)));
                }
            }
        }
        out
    }

    fn speed_bend(&self, values: &[Option<Reference>], triples: &[(usize, Along)]) -> Bend {
        Bend::from_misfits(triples.iter().filter_map(|(cell, along)| {
            let guess =
                along.cells[0].1 * values[along.cells[0].0]?.ln + along.cells[1].1 * values[along.cells[1].0]?.ln;
            let weights = along.cells[0].1.powi(2) + along.cells[1].1.powi(2);
            Some(Misfit { ln: values[*cell]?.ln - guess, span: along.span, weights })
        }))
    }

    fn torque_bend(&self, values: &[Option<Reference>], triples: &[(usize, Place)]) -> Bend {
        Bend::from_misfits(triples.iter().filter_map(|(cell, place)| {
            let mut guess = 0.0;
            for &(corner, weight) in place.corners() {
                guess += weight * values[corner]?.ln;
            }
            Some(Misfit { ln: values[*cell]?.ln - guess, span: place.torque_span, weights: place.weights() })
        }))
    }

    /// What is normal there for a line; none where a cell that is needed does not know the line.
    pub fn line(&self, place: &Place, channel: &str, stage: usize, harmonic: usize) -> Option<Reference> {
        self.channels.get(channel)?.stages.get(stage)?.lines.get(harmonic)?.at(place)
    }

    /// What is normal there for the floor beside a line.
    pub fn floor(&self, place: &Place, channel: &str, stage: usize, harmonic: usize) -> Option<Reference> {
        self.channels.get(channel)?.stages.get(stage)?.floors.get(harmonic)?.at(place)
    }

    /// What is normal there for a condition indicator, by its position among the
    /// [names](crate::indicators::columns::names).
    pub fn indicator(&self, place: &Place, channel: &str, position: usize) -> Option<Reference> {
        self.channels.get(channel)?.indicators.get(position)?.at(place)
    }

    /// Writes the name of a place: its cell, or the range of the cells between which it lies.
    pub fn write_name(&self, place: &Place, out: &mut String) {
        let range = |value: &dyn Fn(&Cell) -> f64| {
            place.corners().iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &(cell, _)| {
                let value = value(&self.cells[cell]);
                (low.min(value), high.max(value))
            })
        };
        // Writing to a String cannot fail.
        let (low, high) = range(&|cell| cell.input_speed_hz);
        let _ = if low < high { write!(out, "{low:.2}–{high:.2} Hz") } else { write!(out, "{low:.2} Hz") };
        let (low, high) = range(&|cell| cell.brake_torque_nm.unwrap_or(f64::NAN));
        if low.is_finite() {
            let _ = if low < high { write!(out, ", {low:.1}–{high:.1} N m") } else { write!(out, ", {low:.1} N m") };
        }
    }
}

/// Two cells on a line of equal torque, their weights, and (x−a)(b−x) in ln speed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Along {
    cells: [(usize, f64); 2],
    span: f64,
}

fn between(a: usize, b: usize, low_hz: f64, high_hz: f64, speed_hz: f64) -> Along {
    let (low, high, x) = (low_hz.ln(), high_hz.ln(), speed_hz.ln());
    let share = if high > low { (x - low) / (high - low) } else { 0.0 };
    Along { cells: [(a, 1.0 - share), (b, share)], span: (x - low) * (high - x) }
}

impl Place {
    fn new(lines: &[(Along, f64)], torque_span: f64) -> Self {
        let corners = [(0, 0.0); CORNERS];
        let mut place = Self { corners, count: 0, speed_span_squared: 0.0, torque_span, in_cell: false };
        for (along, weight) in lines {
            for &(cell, share) in &along.cells {
                if share * weight != 0.0 && place.count < CORNERS {
                    place.corners[place.count] = (cell, share * weight);
                    place.count += 1;
                }
            }
            place.speed_span_squared += (weight * along.span).powi(2);
        }
        place
    }
}

/// By how much a cell misses what its neighbours say of it.
struct Misfit {
    ln: f64,
    /// (x−a)(b−x)
    span: f64,
    /// Σ w² of the neighbours.
    weights: f64,
}

impl Bend {
    /// Linear interpolation misses a curve of second derivative k by k/2 (x−a)(b−x); of cells that
    /// are off by a variance ρ each, a cell misses its neighbours by ρ (1 + Σ w²).
    fn from_misfits(misfits: impl Iterator<Item = Misfit>) -> Self {
        let mut bend = Self::default();
        for misfit in misfits.filter(|misfit| misfit.span > 0.0) {
            bend.mean_square += (2.0 * misfit.ln / misfit.span).powi(2);
            bend.roughness += misfit.ln.powi(2) / (1.0 + misfit.weights);
            bend.residuals += 1.0;
        }
        if bend.residuals > 0.0 {
            bend.mean_square /= bend.residuals;
            bend.roughness /= bend.residuals;
        }
        bend
    }

    /// Variance of what is interpolated over a squared span, with these weights.
    fn variance(&self, span_squared: f64, place: &Place) -> f64 {
        let bend = self.mean_square / 4.0 * span_squared;
        if place.in_cell { bend } else { bend.max(self.roughness * (1.0 + place.weights())) }
    }
}

impl Series {
    fn at(&self, place: &Place) -> Option<Reference> {
        let mut out = Reference {
            ln: 0.0,
            mean_variance: 0.0,
            scatter_variance: 0.0,
            scatter_freedom: f64::INFINITY,
            noise_variance: 0.0,
            between_variance: Some(0.0),
            sessions: u32::MAX,
            run_variance: 0.0,
            run_freedom: f64::INFINITY,
            runs: u32::MAX,
            interpolation_variance: 0.0,
            interpolation_freedom: f64::INFINITY,
        };
        let mut between_sigma = Some(0.0);
        for &(cell, weight) in place.corners() {
            let corner = self.cells.get(cell).copied().flatten()?;
            out.ln += weight * corner.ln;
            out.mean_variance += weight * weight * corner.mean_variance;
            out.scatter_variance += weight * corner.scatter_variance;
            out.scatter_freedom = out.scatter_freedom.min(corner.scatter_freedom);
            out.noise_variance += weight * corner.noise_variance;
            // A session is off in the same direction at neighbouring cells, so that its sigmas add,
            // not its variances.
            between_sigma = between_sigma.zip(corner.between_variance).map(|(sum, v)| sum + weight * v.sqrt());
            out.sessions = out.sessions.min(corner.sessions);
            out.run_variance += weight * corner.run_variance;
            out.run_freedom = out.run_freedom.min(corner.run_freedom);
            out.runs = out.runs.min(corner.runs);
        }
        out.between_variance = between_sigma.map(|sigma| sigma * sigma);
        for (bend, span_squared) in
            [(self.speed_bend, place.speed_span_squared), (self.torque_bend, place.torque_span.powi(2))]
        {
            if span_squared > 0.0 {
                if bend.residuals < 1.0 {
                    return None;
                }
                out.interpolation_variance += bend.variance(span_squared, place);
                out.interpolation_freedom = out.interpolation_freedom.min(bend.residuals);
            }
        }
        Some(out)
    }
}
