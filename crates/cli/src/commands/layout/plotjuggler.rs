//! A layout of PlotJuggler: a tab a stage with ranks and deviations over time. Its series are named
//! by topic and field alone, so the channels of a stage share them; it has no view of a spectrum
//! that a file holds.

use std::fmt::Write as _;

use super::Shown;

const HARMONICS: [&str; 5] = ["1x", "2x", "3x", "4x", "5x"];
const INKS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00"];

pub(super) fn layout(shown: &Shown) -> String {
    let mut out = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- gearwatch, bench {} -->\n<root>\n <tabbed_widget parent=\"main_window\" name=\"Main Window\">\n",
        escaped(&shown.bench).replace("--", "- -")
    );
    let prefix = escaped(&shown.prefix);
    for stage in &shown.stages {
        let stage = escaped(stage);
        // Writing to a string cannot fail.
        let _ = write!(
            out,
            "  <Tab tab_name=\"{stage}\" containers=\"1\">\n   <Container>\n    <DockSplitter orientation=\"-\" count=\"2\" sizes=\"0.4;0.6\">\n"
        );
        for (name, before, after) in
            [("ranks (0 to 5, -1 unknown)", "level_", ""), ("deviation in %", "dev_", "_percent")]
        {
            let _ = write!(
                out,
                "     <DockArea name=\"{stage}: {name}\">\n      <plot mode=\"TimeSeries\" style=\"{}\" flip_x=\"false\" flip_y=\"false\">\n",
                if after.is_empty() { "Steps" } else { "Lines" }
            );
            for (harmonic, ink) in HARMONICS.iter().zip(INKS) {
                let _ = writeln!(
                    out,
                    "       <curve name=\"/gear/{prefix}{stage}/rank/{before}{harmonic}{after}\" color=\"{ink}\"/>"
                );
            }
            out.push_str("      </plot>\n     </DockArea>\n");
        }
        out.push_str("    </DockSplitter>\n   </Container>\n  </Tab>\n");
    }
    out.push_str(
        "  <currentTabIndex index=\"0\"/>\n </tabbed_widget>\n <use_relative_time_offset enabled=\"0\"/>\n</root>\n",
    );
    out
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
