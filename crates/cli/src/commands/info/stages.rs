//! What `info` says of the stages of a bench.

use std::fmt::Write as _;

use gearwatch_core::bench::{Bench, Member, Stage, StageKind};
use gearwatch_core::train::{PlanetarySet, StageKinematics, Train};
use serde_json::{Value, json};

/// Adds one line a stage (more where there is more to know), and returns the same for programs.
pub fn stages(text: &mut String, bench: &Bench, train: &Train) -> Result<Vec<Value>, std::fmt::Error> {
    let mut out = Vec::new();
    for (stage, kinematics) in bench.stages.iter().zip(&train.stages) {
        out.push(match &kinematics.planetary {
            Some(set) => planetary(text, stage, kinematics, set, train.nominal_input_hz)?,
            None => pair(text, stage, kinematics, train.nominal_input_hz)?,
        });
    }
    Ok(out)
}

fn pair(
    text: &mut String,
    stage: &Stage,
    kinematics: &StageKinematics,
    input_hz: f64,
) -> Result<Value, std::fmt::Error> {
    let StageKinematics { name, pinion_teeth, wheel_teeth, mesh_order, .. } = kinematics;
    let mesh_hz = mesh_order * input_hz;
    let helix = stage.gearing.helix.as_ref().map(|helix| helix.angle_deg);
    write!(text, "  {name}: ")?;
    if let Some(degrees) = helix {
        write!(text, "helical {degrees}°, ")?;
    }
    write!(text, "{pinion_teeth} / {wheel_teeth} teeth")?;
    if stage.gearing.internal {
        text.push_str(" (internal)");
    }
    for (teeth, order) in &kinematics.idlers {
        write!(text, ", idler {teeth} ({:.2} Hz)", order * input_hz)?;
    }
    writeln!(text, ", mesh {mesh_hz:.2} Hz")?;
    let mut json = json!({
        "name": name, "kind": stage.kind().word(), "pinion_teeth": pinion_teeth, "wheel_teeth": wheel_teeth,
        "mesh_order": mesh_order, "mesh_hz": mesh_hz, "hunting_hz": mesh_hz / kinematics.hunting_meshes() as f64,
    });
    if stage.kind() == StageKind::Helical {
        json["helix_angle_deg"] = json!(helix);
    }
    if stage.gearing.internal {
        json["internal"] = json!(true);
    }
    if !kinematics.idlers.is_empty() {
        let idlers = kinematics.idlers.iter().map(|(teeth, order)| json!({ "teeth": teeth, "order": order }));
        json["idlers"] = idlers.collect();
    }
    Ok(json)
}

fn planetary(
    text: &mut String,
    stage: &Stage,
    kinematics: &StageKinematics,
    set: &PlanetarySet,
    input_hz: f64,
) -> Result<Value, std::fmt::Error> {
    let StageKinematics { name, pinion_teeth: sun, wheel_teeth: ring, mesh_order, .. } = kinematics;
    let mesh_hz = mesh_order * input_hz;
    let PlanetarySet { planets, planet_teeth, fixed, input, output, .. } = set;
    writeln!(
        text,
        "  {name}: planetary, sun {sun}, {planets} planets of {planet_teeth}, ring {ring} teeth; {} in, {} out, {} fixed; mesh {mesh_hz:.2} Hz",
        input.word(),
        output.word(),
        fixed.word()
    )?;
    let turning: Vec<String> = Member::ALL
        .into_iter()
        .filter(|member| member != fixed)
        .map(|member| format!("{} {:.3} Hz", member.word(), set.order_of(member) * input_hz))
        .collect();
    write!(text, "    {}, planet on its pin {:.3} Hz", turning.join(", "), set.planet_spin_order * input_hz)?;
    if set.pass_order > 0.0 {
        write!(text, ", planets pass {:.3} Hz", set.pass_order * input_hz)?;
    }
    text.push('\n');
    let lines = kinematics.harmonic_orders();
    if set.pass_order > 0.0 {
        let carrier = set.carrier_order.abs();
        let orders = lines.map(|order| format!("{:.0}", order / carrier)).join(", ");
        let hz = lines.map(|order| format!("{:.2}", order * input_hz)).join(", ");
        writeln!(text, "    1x to 5x are read at {orders} times the carrier's speed, {hz} Hz")?;
    }
    let positions_deg = stage.gearing.planetary.as_ref().map(|set| &set.positions_deg);
    let mut json = json!({
        "name": name, "kind": stage.kind().word(), "sun_teeth": sun, "ring_teeth": ring, "planet_teeth": planet_teeth,
        "planets": planets, "fixed": fixed, "in": input, "out": output, "mesh_order": mesh_order, "mesh_hz": mesh_hz,
        "sun_order": set.sun_order, "carrier_order": set.carrier_order, "ring_order": set.ring_order,
        "planet_order": set.planet_order, "planet_spin_order": set.planet_spin_order, "pass_order": set.pass_order,
        "harmonic_orders": lines, "hunting_hz": mesh_hz / kinematics.hunting_meshes() as f64,
    });
    if let Some(positions) = positions_deg.filter(|positions| !positions.is_empty()) {
        json["positions_deg"] = json!(positions);
    }
    Ok(json)
}
