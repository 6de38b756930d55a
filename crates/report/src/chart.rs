//! Pictures of a report, drawn as SVG.

use plotters::coord::Shift;
use plotters::prelude::*;

mod deviations;

pub use deviations::{Deviation, Deviations};

/// Colours of the series, told apart by people with colour-vision deficiency too (Okabe and Ito
/// 2008).
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(120, 120, 120),
];
const SIZE: (u32, u32) = (900, 320);
/// Share of the height that is left free for a legend of some five entries, so that it hides
/// nothing.
const LEGEND_SHARE: f64 = 0.4;
const FONT: (&str, u32) = ("sans-serif", 14);
/// Height of a row of names of marks, which stand above the picture.
const MARK_ROW: i32 = 13;
/// Points drawn per series: two per pixel show everything that can be seen.
const MOST_POINTS: usize = 2 * SIZE.0 as usize;

/// Why a picture could not be drawn.
#[derive(Debug)]
pub struct ChartError(String);

impl std::fmt::Display for ChartError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for ChartError {}

fn failed(error: impl std::fmt::Display) -> ChartError {
    ChartError(error.to_string())
}

/// A picture.
#[derive(Clone, Debug)]
pub enum Chart {
    /// Curves over a common axis.
    Lines(Lines),
    /// Groups of bars with error bars.
    Bars(Bars),
    /// Deviations of the harmonics in their frame.
    Deviations(Deviations),
    /// Drawn elsewhere.
    Drawing(Drawing),
}

/// A picture that was drawn elsewhere.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// What it shows.
    pub caption: String,
    /// An SVG element; whoever draws it has escaped what is in it.
    pub svg: String,
}

/// Text as it may stand in an SVG element.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Curves over a common axis, with marked places.
#[derive(Clone, Debug)]
pub struct Lines {
    /// What it shows.
    pub caption: String,
    /// Quantity and unit.
    pub x_label: String,
    /// Quantity and unit.
    pub y_label: String,
    /// Logarithmic ordinate; values that are not above zero are left out.
    pub log_y: bool,
    /// The curves.
    pub series: Vec<Series>,
    /// Vertical marks.
    pub marks: Vec<Mark>,
}

/// One curve.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// Abscissa and ordinate, ascending in the abscissa; points that are not finite break the
    /// curve's range but not the picture.
    pub points: Vec<(f64, f64)>,
}

/// A vertical mark.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Where.
    pub x: f64,
    /// Its name, may be empty.
    pub label: String,
    /// Row in which the name is written, 0 at the top: marks of different kinds often lie close
    /// together.
    pub row: u32,
}

/// Groups of bars with error bars.
#[derive(Clone, Debug)]
pub struct Bars {
    /// What it shows.
    pub caption: String,
    /// Quantity and unit.
    pub y_label: String,
    /// Names of the groups, such as 1x to 5x.
    pub groups: Vec<String>,
    /// Name, and value with sigma by group; `NaN` where there is none.
    pub series: Vec<(String, Vec<(f64, f64)>)>,
    /// Horizontal limit lines, drawn at plus and minus each.
    pub limits: Vec<f64>,
}

impl Chart {
    /// What it shows.
    pub fn caption(&self) -> &str {
        match self {
            Self::Lines(lines) => &lines.caption,
            Self::Bars(bars) => &bars.caption,
            Self::Deviations(deviations) => &deviations.caption,
            Self::Drawing(drawing) => &drawing.caption,
        }
    }

    /// The picture as an SVG element.
    ///
    /// # Errors
    /// When there is nothing finite to draw.
    pub fn svg(&self) -> Result<String, ChartError> {
        match self {
            Self::Deviations(deviations) => return deviations.svg(),
            Self::Drawing(drawing) => return Ok(drawing.svg.clone()),
            Self::Lines(_) | Self::Bars(_) => {}
        }
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            match self {
                Self::Lines(lines) => draw_lines(lines, &root)?,
                Self::Bars(bars) => draw_bars(bars, &root)?,
                Self::Deviations(_) | Self::Drawing(_) => {}
            }
            root.present().map_err(failed)?;
        }
        Ok(text)
    }
}

/// The range of finite values with a margin; never empty.
fn range(values: impl Iterator<Item = f64>, margin: f64) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return None;
    }
    let spread = if high > low { high - low } else { low.abs().max(1.0) };
    Some((low - margin * spread, high + margin * spread))
}

/// Keeps the largest and smallest value of each run of points, so that no peak is lost.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let finite: Vec<_> = points.iter().copied().filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
    if finite.len() <= MOST_POINTS {
        return finite;
    }
    let run = finite.len().div_ceil(MOST_POINTS / 2);
    finite
        .chunks(run)
        .flat_map(|chunk| {
            let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            let mut pair: Vec<_> =
                chunk.iter().min_by(by_value).into_iter().chain(chunk.iter().max_by(by_value)).collect();
            pair.sort_by(|a, b| a.0.total_cmp(&b.0));
            pair.into_iter().copied()
        })
        .collect()
}

/// A number at an axis: three digits, as a power of ten where it is far from one.
fn number(value: f64) -> String {
    let rounded = format!("{value:.3e}").parse().unwrap_or(value);
    if rounded != 0.0 && !(1e-3..1e5).contains(&f64::abs(rounded)) {
        format!("{rounded:e}")
    } else {
        format!("{rounded}")
    }
}

macro_rules! legend {
    ($chart:ident, $count:expr) => {
        if $count > 1 {
            $chart
                .configure_series_labels()
                .background_style(WHITE.mix(0.85))
                .border_style(RGBColor(200, 200, 200))
                .position(SeriesLabelPosition::UpperRight)
                .draw()
                .map_err(failed)?;
        }
    };
}

/// Linear and logarithmic charts are different types; what is drawn on them is the same.
macro_rules! finish_lines {
    ($chart:ident, $lines:ident, $bounds:ident, $rows:ident, $keep:expr) => {{
        $chart
            .configure_mesh()
            .x_desc($lines.x_label.as_str())
            .y_desc($lines.y_label.as_str())
            .label_style(FONT)
            .x_label_formatter(&|v| number(*v))
            .y_label_formatter(&|v| number(*v))
            .light_line_style(WHITE)
            .draw()
            .map_err(failed)?;
        for mark in &$lines.marks {
            let style = RGBColor(200, 120, 60).mix(0.6);
            $chart
                .draw_series(std::iter::once(PathElement::new([(mark.x, $bounds.0), (mark.x, $bounds.1)], style)))
                .map_err(failed)?;
            let place = (mark.x, $bounds.1);
            let text = Text::new(mark.label.clone(), (-4, MARK_ROW * (mark.row as i32 - $rows)), ("sans-serif", 12));
            $chart.draw_series(std::iter::once(EmptyElement::at(place) + text)).map_err(failed)?;
        }
        for (series, colour) in $lines.series.iter().zip(COLOURS.iter().cycle()) {
            let points = thinned(&series.points).into_iter().filter(|p| $keep(p.1));
            $chart
                .draw_series(LineSeries::new(points, colour))
                .map_err(failed)?
                .label(series.name.as_str())
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], *colour));
        }
        legend!($chart, $lines.series.len());
    }};
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn draw_lines(lines: &Lines, root: &Area<'_>) -> Result<(), ChartError> {
    let all = || lines.series.iter().flat_map(|s| &s.points).filter(|p| p.0.is_finite() && p.1.is_finite());
    let nothing = || ChartError("there is no finite point".into());
    let (x_low, x_high) = range(all().map(|p| p.0), 0.0).ok_or_else(nothing)?;
    let mut builder = ChartBuilder::on(root);
    let rows = lines.marks.iter().map(|mark| mark.row as i32 + 1).max().unwrap_or(0);
    builder.margin(8).margin_top(8 + MARK_ROW * rows).margin_right(24).x_label_area_size(38).y_label_area_size(76);
    let room = if lines.series.len() > 1 { LEGEND_SHARE } else { 0.0 };
    if lines.log_y {
        let positive = all().map(|p| p.1).filter(|&y| y > 0.0);
        let (low, high) = positive.fold((f64::INFINITY, 0.0_f64), |(l, h), y| (l.min(y), h.max(y)));
        if !(low.is_finite() && high > 0.0) {
            return Err(nothing());
        }
        let low = low.max(high * 1e-7) * 0.8;
        let bounds = (low, 1.6 * high * (high / low).powf(0.6 * room));
        let mut chart = builder.build_cartesian_2d(x_low..x_high, (bounds.0..bounds.1).log_scale()).map_err(failed)?;
        finish_lines!(chart, lines, bounds, rows, |y: f64| y > 0.0);
    } else {
        let mut bounds = range(all().map(|p| p.1), 0.06).ok_or_else(nothing)?;
        bounds.1 += room * (bounds.1 - bounds.0);
        let mut chart = builder.build_cartesian_2d(x_low..x_high, bounds.0..bounds.1).map_err(failed)?;
        finish_lines!(chart, lines, bounds, rows, |_: f64| true);
    }
    Ok(())
}

fn draw_bars(bars: &Bars, root: &Area<'_>) -> Result<(), ChartError> {
    let ends = bars.series.iter().flat_map(|(_, values)| values).flat_map(|&(v, s)| {
        let s = if s.is_finite() { s } else { 0.0 };
        [v - s, v + s]
    });
    let mut bounds = range(ends.chain([0.0]), 0.12).ok_or_else(|| ChartError("there is no finite value".into()))?;
    if bars.series.len() > 1 {
        bounds.1 += LEGEND_SHARE * (bounds.1 - bounds.0);
    }
    let groups = bars.groups.len();
    let mut chart = ChartBuilder::on(root)
        .margin(8)
        .x_label_area_size(30)
        .y_label_area_size(70)
        .build_cartesian_2d(-0.5..groups as f64 - 0.5, bounds.0..bounds.1)
        .map_err(failed)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(groups.max(1))
        .x_label_formatter(&|x| {
            let nearest = x.round();
            let group =
                if (x - nearest).abs() < 0.01 && nearest >= 0.0 { bars.groups.get(nearest as usize) } else { None };
            group.cloned().unwrap_or_default()
        })
        .y_desc(bars.y_label.as_str())
        .label_style(FONT)
        .light_line_style(WHITE)
        .draw()
        .map_err(failed)?;
    for limit in bars.limits.iter().flat_map(|&l| [l, -l]).filter(|l| (bounds.0..=bounds.1).contains(l)) {
        let style = RGBColor(180, 60, 60).mix(0.35);
        let path = [(-0.5, limit), (groups as f64 - 0.5, limit)];
        chart.draw_series(std::iter::once(PathElement::new(path, style))).map_err(failed)?;
    }
    let width = 0.8 / bars.series.len().max(1) as f64;
    for (k, ((name, values), colour)) in bars.series.iter().zip(COLOURS.iter().cycle()).enumerate() {
        let left = |i: usize| i as f64 - 0.4 + k as f64 * width;
        let known = || values.iter().take(groups).enumerate().filter(|(_, (v, _))| v.is_finite());
        let boxes =
            known().map(|(i, &(v, _))| Rectangle::new([(left(i), 0.0), (left(i) + 0.92 * width, v)], colour.filled()));
        chart
            .draw_series(boxes)
            .map_err(failed)?
            .label(name.as_str())
            .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 12, y + 5)], colour.filled()));
        let whiskers = known().filter(|(_, (_, s))| s.is_finite() && *s > 0.0).map(|(i, &(v, s))| {
            let middle = left(i) + 0.46 * width;
            PathElement::new([(middle, v - s), (middle, v + s)], BLACK.stroke_width(2))
        });
        chart.draw_series(whiskers).map_err(failed)?;
    }
    legend!(chart, bars.series.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Thinning keeps the largest value of every run: a single spike in a million points is still
    /// there.
    #[test]
    fn analytic_thinning_keeps_peaks() {
        let mut points: Vec<_> = (0..1_000_000).map(|i| (f64::from(i), 0.0)).collect();
        points[777_777].1 = 5.0;
        let thin = thinned(&points);
        assert!(thin.len() <= MOST_POINTS + 2);
        assert!(thin.contains(&(777_777.0, 5.0)));
        assert!(thin.windows(2).all(|w| w[0].0 <= w[1].0));
    }

    #[test]
    fn conform_nothing_finite_is_an_error_not_a_panic() {
        let mut lines = Lines {
            caption: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            log_y: true,
            series: vec![Series { name: String::new(), points: vec![(f64::NAN, 1.0), (0.0, -1.0)] }],
            marks: vec![],
        };
        assert!(Chart::Lines(lines.clone()).svg().is_err());
        lines.series[0].points = vec![(1.0, 2.0)];
        assert!(Chart::Lines(lines).svg().unwrap().starts_with("<svg"));
        let bars =
            Bars { caption: String::new(), y_label: String::new(), groups: vec![], series: vec![], limits: vec![] };
        assert!(Chart::Bars(bars).svg().is_ok());
    }
}
