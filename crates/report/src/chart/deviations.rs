//! Deviations of the mesh harmonics in one frame: the same height for every stage and every report,
//! coloured by what the verdict bears out.

use std::fmt::Write;

use super::ChartError;

/// Half of the frame (percent).
const FRAME: f64 = 15.0;
/// Colours of 0 to V, as the live page has them, and of what is unknown.
const RANKS: [&str; 6] = ["#3f9164", "#a9c24a", "#e8c33a", "#ef9a3c", "#dd5a2b", "#a3142d"];
const UNKNOWN: &str = "#b9c0c8";
const NAMES: [&str; 5] = ["I", "II", "III", "IV", "V"];
const SIZE: (f64, f64) = (900.0, 300.0);
/// Left, top, right and bottom of the frame.
const EDGES: (f64, f64, f64, f64) = (76.0, 26.0, 50.0, 30.0);

/// Deviations of the harmonics of one place.
#[derive(Clone, Debug)]
pub struct Deviations {
    /// What it shows.
    pub caption: String,
    /// A bar each.
    pub bars: Vec<Deviation>,
    /// Lower ends of the ranks I to V (percent).
    pub steps_percent: Vec<f64>,
}

/// One bar.
#[derive(Clone, Debug)]
pub struct Deviation {
    /// Such as 1x.
    pub name: String,
    /// Signed (percent); NaN where it is not known.
    pub percent: f64,
    /// One standard deviation of it (percentage points).
    pub sigma_percent: f64,
    /// The rank that the verdict bears out, 0 to 5; none where nothing is known.
    pub rank: Option<usize>,
}

impl Deviations {
    pub(super) fn svg(&self) -> Result<String, ChartError> {
        if self.bars.iter().all(|bar| !bar.percent.is_finite()) {
            return Err(ChartError("no deviation is known".into()));
        }
        let (left, top, right, bottom) = EDGES;
        let (wide, high) = (SIZE.0 - left - right, SIZE.1 - top - bottom);
        let y = |percent: f64| top + high * 0.5 * (1.0 - percent.clamp(-FRAME, FRAME) / FRAME);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"13\">",
            SIZE.0, SIZE.1, SIZE.0, SIZE.1
        );
        let mut line = |percent: f64, ink: &str, word: &str| {
            let at = y(percent);
            let _ = write!(out, "<path d=\"M{left} {at:.1}H{}\" stroke=\"{ink}\"/>", left + wide);
            let _ =
                write!(out, "<text x=\"{}\" y=\"{:.1}\" fill=\"#55606c\">{word}</text>", left + wide + 8.0, at + 4.5);
        };
        line(0.0, "#55606c", "");
        for (step, (name, ink)) in self.steps_percent.iter().zip(NAMES.iter().zip(&RANKS[1..])) {
            line(*step, ink, name);
            line(-step, ink, name);
        }
        for percent in [-15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0] {
            let _ = write!(
                out,
                "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#55606c\">{percent:+} %</text>",
                left - 8.0,
                y(percent) + 4.5
            );
        }
        let slot = wide / self.bars.len().max(1) as f64;
        for (i, bar) in self.bars.iter().enumerate() {
            let middle = left + (i as f64 + 0.5) * slot;
            let _ = write!(
                out,
                "<text x=\"{middle:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"#1a2027\">{}</text>",
                SIZE.1 - 9.0,
                super::escaped(&bar.name)
            );
            self.bar(&mut out, bar, (middle, slot), &y);
        }
        out.push_str("</svg>");
        Ok(out)
    }

    fn bar(&self, out: &mut String, bar: &Deviation, (middle, slot): (f64, f64), y: &dyn Fn(f64) -> f64) {
        if !bar.percent.is_finite() {
            let _ = write!(
                out,
                "<text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#55606c\">?</text>",
                y(0.0) - 6.0
            );
            return;
        }
        let ink = bar.rank.and_then(|rank| RANKS.get(rank)).unwrap_or(&UNKNOWN);
        let half = 0.28 * slot;
        let (zero, end) = (y(0.0), y(bar.percent));
        let _ = write!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{ink}\"/>",
            middle - half,
            zero.min(end),
            2.0 * half,
            (zero - end).abs().max(1.0)
        );
        if bar.sigma_percent.is_finite() {
            let (low, high) = (y(bar.percent - bar.sigma_percent), y(bar.percent + bar.sigma_percent));
            let _ = write!(out, "<path d=\"M{middle:.1} {low:.1}V{high:.1}\" stroke=\"#1a2027\" stroke-width=\"2\"/>");
        }
        // Beside the bar, where neither it nor its error bar hides it; what lies beyond the frame
        // is written at its edge.
        let beyond = bar.percent.abs() > FRAME;
        let place = y(bar.percent + bar.percent.signum() * bar.sigma_percent.max(0.0));
        let at = if bar.percent < 0.0 { place + 15.0 } else { place - 5.0 };
        let arrow = match (beyond, bar.percent < 0.0) {
            (false, _) => "",
            (true, true) => " ↓",
            (true, false) => " ↑",
        };
        let _ = write!(
            out,
            "<text x=\"{middle:.1}\" y=\"{at:.1}\" text-anchor=\"middle\" fill=\"#1a2027\">{:+.1} %{arrow}</text>",
            bar.percent
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(percent: f64, rank: Option<usize>) -> String {
        let bar = Deviation { name: "1x<".into(), percent, sigma_percent: 0.5, rank };
        let steps_percent = vec![1.0, 4.0, 7.0, 10.0, 13.0];
        Deviations { caption: String::new(), bars: vec![bar], steps_percent }.svg().unwrap_or_default()
    }

    /// The frame is ±15 % whatever is in it: 15 % reaches its upper edge, and what lies beyond says
    /// so.
    #[test]
    fn analytic_the_frame_does_not_move() {
        let high = SIZE.1 - EDGES.1 - EDGES.3;
        for (percent, tall) in [(15.0, 0.5), (7.5, 0.25), (-3.0, 0.1), (40.0, 0.5)] {
            let text = chart(percent, Some(1));
            assert!(
                text.contains(&format!("height=\"{:.1}\" fill=\"{}\"", tall * high, RANKS[1])),
                "{percent}: {text}"
            );
            assert_eq!(text.contains('↑'), percent == 40.0);
        }
    }

    #[test]
    fn conform_what_is_not_known_has_no_bar_and_names_are_escaped() {
        assert!(chart(f64::NAN, None).is_empty());
        let text = chart(2.0, None);
        assert!(text.contains(UNKNOWN) && text.contains("1x&lt;") && !text.contains("1x<"));
    }
}
