//! labels.json: what was put into simulated runs, for those who check what comes out.

use std::path::Path;

use rig::Rig;
use serde_json::{Map, Value, json};

use crate::SimError;
use crate::effects::{Effect, Kind, Place};
use crate::truth::{TrueGauge, Truth};

/// Name of the file with the truth, beside the run directories that it is about.
pub const LABELS_FILE: &str = "labels.json";

/// The text of labels.json at `file` with the run `name` added; what it says about other runs is kept.
///
/// On top: seed, gauges and effects of this run. Under `cases` the same for every run by its directory's name.
pub(super) fn merged(
    file: &Path,
    name: &str,
    rig: &Rig,
    truth: &Truth,
    seed: u64,
) -> Result<String, SimError> {
    let mut cases = known_cases(file)?;
    let gauges: Vec<Value> = rig
        .layout
        .gauges
        .iter()
        .zip(&truth.gauges)
        .map(|(binding, gauge)| label(&binding.name, gauge))
        .collect();
    let arm = rig.config.file.file_stem().and_then(|stem| stem.to_str()).unwrap_or("arm");
    let effects: Vec<Value> = truth.effects.list.iter().map(|effect| put_in(effect, rig)).collect();
    cases.insert(name.to_owned(), json!({ "seed": seed, "gauges": gauges, "effects": effects }));
    let labels = json!({ "format": 1, "arm": arm, "seed": seed, "gauges": gauges, "effects": effects, "cases": cases });
    Ok(format!("{labels:#}\n"))
}

/// An effect that was put in: where, its parameters, and the size that was asked for.
fn put_in(effect: &Effect, rig: &Rig) -> Value {
    let mut parameters = Map::new();
    let is_source =
        |name: &str| matches!(effect.kind, Kind::ChannelCoupling | Kind::Product) && name == "source";
    parameters.insert(effect.kind.strength().to_owned(), json!(effect.strength));
    for (name, value) in &effect.numbers {
        let gauge = rig.layout.gauges.get(*value as usize).filter(|_| is_source(name));
        parameters.insert((*name).to_owned(), gauge.map_or_else(|| json!(value), |gauge| json!(gauge.name)));
    }
    let (mut sensors, mut joints, mut links) = (Vec::new(), Vec::new(), Vec::new());
    match effect.place {
        Place::Gauge(gauge) => sensors.push(rig.layout.gauges[gauge].name.clone()),
        Place::Joint(joint) => joints.push(rig.chain.coordinate_names()[joint].to_owned()),
        Place::Link(link) => links.push(rig.chain.joints[link].child_link.clone()),
        Place::Arm => {}
    }
    json!({
        "effect": effect.kind.id(),
        "sensors": sensors,
        "joints": joints,
        "links": links,
        "parameters": parameters,
        "size_sigma": effect.size,
    })
}

/// One gauge: scale (counts/Nm), angles (rad), offsets and pitch (m), bias and noise (counts).
fn label(name: &str, gauge: &TrueGauge) -> Value {
    let frame = gauge.frame();
    let of = |value: fn(&model::sensing::ActualFrame) -> f64| frame.as_ref().map(value);
    json!({
        "name": name,
        "r": of(|frame| frame.r_counts_per_nm),
        "ax": of(|frame| frame.a_x_rad),
        "ay": of(|frame| frame.a_y_rad),
        "lx": of(|frame| frame.l_x_m),
        "ly": of(|frame| frame.l_y_m),
        // Below a picometre it is the rounding of a line's other numbers.
        "pitch": of(|frame| if frame.pitch_m.abs() < 1e-12 { 0.0 } else { frame.pitch_m }),
        "bias": gauge.bias_counts,
        "noise": gauge.noise.sigma_counts,
    })
}

fn known_cases(file: &Path) -> Result<Map<String, Value>, SimError> {
    let bytes = match std::fs::read(file) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Map::new()),
        Err(source) => {
            let what = "the labels of earlier simulations, or another place for the run";
            return Err(SimError::Read { file: file.to_owned(), source, what });
        }
    };
    let foreign = || {
        let problem =
            "is there already and does not hold labels of simulations; move it, or put the run elsewhere";
        SimError::row(file, 1, problem)
    };
    let known: Value = serde_json::from_slice(&bytes).map_err(|_| foreign())?;
    let cases = known.as_object().and_then(|known| known.get("cases")).and_then(Value::as_object);
    cases.cloned().ok_or_else(foreign)
}
