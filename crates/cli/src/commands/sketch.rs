//! The train of a bench as a sketch: shafts, gears with their teeth, motor, brake, and where the
//! sensors sit. Gears are drawn in proportion to their teeth, shafts below each other; it is no
//! drawing of the machine.

use std::fmt::Write;

use gearwatch_core::bench::{Bench, Stage};
use gearwatch_report::{Chart, Drawing, escaped};

const WIDE: f64 = 900.0;
/// Between the axes of two shafts.
const GAP: f64 = 92.0;
const TOP: f64 = 46.0;
/// Of motor and brake.
const BOX: (f64, f64) = (78.0, 40.0);
const LEFT: f64 = 96.0;
const GEAR: f64 = 16.0;
const INK: &str = "#1a2027";
const SOFT: &str = "#55606c";
const SENSOR: &str = "#1f5fa8";

/// The sketch.
pub fn chart(bench: &Bench) -> Chart {
    let sensors: Vec<String> = bench.sensors.iter().map(|s| format!("{} on shaft {}", s.name, s.shaft)).collect();
    let stages: Vec<String> = bench.stages.iter().map(teeth).collect();
    let with = if sensors.is_empty() { String::new() } else { format!("; sensors: {}", sensors.join(", ")) };
    Chart::Drawing(Drawing {
        caption: format!(
            "{}: {}{with}. Gears in proportion to their teeth, not to scale otherwise",
            bench.name,
            stages.join(", ")
        ),
        svg: svg(bench),
    })
}

fn teeth(stage: &Stage) -> String {
    let all: Vec<String> = stage.gears().iter().map(|(name, gear)| format!("{name} {} teeth", gear.teeth)).collect();
    format!("{} ({}, {})", stage.name, stage.kind().word(), all.join(", "))
}

fn svg(bench: &Bench) -> String {
    let count = bench.stages.len().max(1) as f64;
    let high = TOP + GAP * count + 104.0;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDE} {high}\" width=\"{WIDE}\" height=\"{high}\" font-family=\"sans-serif\" font-size=\"13\">"
    );
    let step = (WIDE - 2.0 * LEFT - 80.0) / count;
    // Where stage k joins shaft k and shaft k + 1.
    let join = |k: usize| LEFT + 50.0 + (k as f64 + 0.5) * step;
    let axis = |shaft: usize| TOP + GAP * shaft as f64;
    for (i, shaft) in bench.shafts.iter().enumerate() {
        let from = if i == 0 { LEFT } else { join(i - 1) - 46.0 };
        let to = if i + 1 == bench.shafts.len() { WIDE - LEFT } else { join(i) + 46.0 };
        let y = axis(i);
        let _ = write!(out, "<path d=\"M{from:.1} {y}H{to:.1}\" stroke=\"{INK}\" stroke-width=\"5\"/>");
        for x in [from + 12.0, to - 12.0] {
            let _ = write!(
                out,
                "<path d=\"M{:.1} {}h12M{:.1} {}h12\" stroke=\"{SOFT}\" stroke-width=\"3\"/>",
                x - 6.0,
                y - 6.0,
                x - 6.0,
                y + 6.0
            );
        }
        let middle = 0.5 * (from + to);
        let _ = write!(
            out,
            "<text x=\"{middle:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"{SOFT}\">{}</text>",
            y - 9.0,
            escaped(&shaft.name)
        );
        sensors(&mut out, bench, &shaft.name, (from + 12.0, y));
    }
    for (k, stage) in bench.stages.iter().enumerate() {
        gears(&mut out, stage, join(k), (axis(k), axis(k + 1)));
    }
    let block = |out: &mut String, x: f64, y: f64, word: &str| {
        let _ = write!(
            out,
            "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"{}\" height=\"{}\" rx=\"5\" fill=\"#eef0f2\" stroke=\"{SOFT}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{INK}\">{word}</text>",
            y - 0.5 * BOX.1,
            BOX.0,
            BOX.1,
            x + 0.5 * BOX.0,
            y + 4.5
        );
    };
    block(&mut out, LEFT - BOX.0, axis(0), if bench.belt.is_some() { "motor, belt" } else { "motor" });
    block(&mut out, WIDE - LEFT, axis(bench.shafts.len().saturating_sub(1)), "brake");
    out.push_str("</svg>");
    out
}

/// Pinion and wheel as rectangles that touch where they mesh; a planetary stage as a box with its
/// three kinds of gears.
fn gears(out: &mut String, stage: &Stage, x: f64, (upper, lower): (f64, f64)) {
    let gap = lower - upper;
    let mut rect = |y: f64, half: f64, ink: &str, words: &str, below: bool| {
        let _ = write!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{}\" height=\"{:.1}\" fill=\"{ink}\" fill-opacity=\"0.8\" stroke=\"{INK}\"/>",
            x - 0.5 * GEAR,
            y - half,
            GEAR,
            2.0 * half
        );
        let at = if below { y + half + 15.0 } else { y - half - 5.0 };
        let _ = write!(out, "<text x=\"{:.1}\" y=\"{at:.1}\" fill=\"{INK}\">{words}</text>", x + GEAR);
    };
    let [first, second] = stage.gear_names();
    let words = |name: &str, teeth: u32| format!("{} {name} {teeth}", escaped(&stage.name));
    if let Some(planetary) = &stage.gearing.planetary {
        let _ = write!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"72\" height=\"{:.1}\" rx=\"6\" fill=\"#8fb4de\" fill-opacity=\"0.5\" stroke=\"{INK}\"/>",
            x - 36.0,
            upper - 14.0,
            gap + 28.0
        );
        let lines = [
            words(first, stage.pinion.teeth),
            format!("planet {}", planetary.planet.teeth),
            format!("{second} {}", stage.wheel.teeth),
        ];
        for (line, text) in lines.iter().enumerate() {
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{INK}\">{text}</text>",
                x + 42.0,
                upper + 0.5 * gap - 12.0 + 16.0 * line as f64
            );
        }
        return;
    }
    // Idlers lie between the two; the sketch shows the pair and names them.
    let all = f64::from(stage.pinion.teeth + stage.wheel.teeth);
    let half = gap * f64::from(stage.pinion.teeth) / all;
    rect(upper, half, "#8fb4de", &words(first, stage.pinion.teeth), false);
    rect(lower, gap - half, "#e8b98a", &words(second, stage.wheel.teeth), true);
    if !stage.gearing.idlers.is_empty() {
        let teeth: Vec<String> = stage.gearing.idlers.iter().map(|gear| gear.teeth.to_string()).collect();
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{SOFT}\">idler {}</text>",
            x + GEAR,
            upper + half,
            teeth.join(", ")
        );
    }
}

/// The sensors of a shaft: at its first bearing, one beside the other.
fn sensors(out: &mut String, bench: &Bench, shaft: &str, (x, y): (f64, f64)) {
    // On the side where no gear and no motor hides the name.
    let is_first = bench.shafts.first().is_some_and(|first| first.name == shaft);
    let (aside, anchor) = if is_first { (10.0, "start") } else { (-10.0, "end") };
    for (i, sensor) in bench.sensors.iter().filter(|sensor| sensor.shaft == shaft).enumerate() {
        let (x, y) = (x + 4.0 * i as f64, y + 16.0 + 15.0 * i as f64);
        let _ = write!(
            out,
            "<path d=\"M{x:.1} {:.1}l-6 10h12z\" fill=\"{SENSOR}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\" fill=\"{SENSOR}\">{} {}°</text>",
            y - 6.0,
            x + aside,
            y + 4.0,
            escaped(&sensor.name),
            sensor.direction_deg
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every gear, shaft and sensor of the demonstration bench is in it, and the two halves of a
    /// mesh fill the distance of their shafts.
    #[test]
    fn conform_all_parts_of_the_train_are_in_the_sketch() {
        let bench = gearwatch_io::bench_file::parse(gearwatch_sim::shipped::DEMO_BENCH, std::path::Path::new("demo"))
            .expect("a bench");
        let Chart::Drawing(drawing) = chart(&bench) else { unreachable!("a drawing") };
        for stage in &bench.stages {
            for (name, gear) in stage.gears() {
                assert!(drawing.caption.contains(&format!("{name} {} teeth", gear.teeth)), "{}", drawing.caption);
                assert!(drawing.svg.contains(&format!("{name} {}<", gear.teeth)), "{}", drawing.svg);
            }
        }
        for name in bench.shafts.iter().map(|s| &s.name).chain(bench.sensors.iter().map(|s| &s.name)) {
            assert!(drawing.svg.contains(name.as_str()), "{name}");
        }
    }
}
