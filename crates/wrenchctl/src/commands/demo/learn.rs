//! Before the live part: calibration recordings simulated in memory, the crosstalk found from them.

use std::io::Write;
use std::path::Path;

use calibration::{Axes, Calibration, Recording};
use rig::run::{Loads, Reference};
use rig::{ModelFile, Rig};
use sim::motion::MotionLimits;
use sim::scenario::CalibrationPlan;
use sim::{Options, Scenario, Simulator, Truth};

use crate::Error;
use crate::output::{Side, Table};
use crate::progress::Progress;

/// Length that compares N with Nm in the crosstalk, m.
const LENGTH_M: f64 = model::sensing::CHARACTERISTIC_LENGTH_M;

/// Calibrates the arm from a recording of its simulated self: weights at three points, then pushes under a reference.
pub(super) fn calibrate(
    rig: &Rig,
    truth: &Truth,
    seed: u64,
    out: &mut impl Write,
) -> Result<ModelFile, Error> {
    let plan = CalibrationPlan::default();
    let scenario = plan.scenario(&MotionLimits::of(&rig.chain)?, seed);
    let recording = record(rig, truth, &scenario, seed)?;
    writeln!(
        out,
        "calibrating {} gauges from {:.0} s of simulated poses: bare, with weights at {} points, pushed",
        truth.gauges.len(),
        scenario.duration_s(),
        plan.weights.len()
    )?;
    let date = humantime::format_rfc3339_seconds(std::time::SystemTime::now()).to_string();
    let result: Calibration = calibration::calibrate(rig, &[recording], Axes::Full, Vec::new(), &date[..10])?;
    write!(out, "{}", table(&result.model, truth))?;
    out.flush()?;
    Ok(result.model)
}

fn record(rig: &Rig, truth: &Truth, scenario: &Scenario, seed: u64) -> Result<Recording, Error> {
    let options = Options { seed, ..Options::default() };
    let simulator = Simulator::new(rig, truth.clone(), scenario, options)?;
    let reference = sim::output::reference_csv(&simulator, scenario, seed)
        .map(|csv| Reference::parse(Path::new("simulated reference"), &csv))
        .transpose()?;
    let progress = Progress::steps(100, "simulating");
    let mut simulator = simulator;
    let frames = std::iter::from_fn(|| {
        progress.at((100.0 * simulator.progress()) as u64);
        simulator.next()
    });
    let mut recording = Recording::from_frames(rig, "simulated calibration", frames)?;
    recording.loads = Loads::new(scenario.loads.clone());
    recording.reference = reference;
    Ok(recording)
}

/// What was found beside what is true.
fn table(model: &ModelFile, truth: &Truth) -> Table {
    let sides = [Side::Left].into_iter().chain([Side::Right; 7]).collect::<Vec<_>>();
    let mut table = Table::new(&sides, 2);
    table.row(["gauge", "crosstalk %", "true", "tilt deg", "true", "counts/Nm", "true", "worst sigma"]);
    for (sensor, gauge) in model.sensors.iter().zip(&truth.gauges) {
        let shown = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| "unknown".into(), |value| format!("{value:.digits$}"))
        };
        let (found, real) = (&sensor.frame, gauge.frame());
        table.row([
            sensor.name.clone(),
            shown(sensor.crosstalk_percent, 2),
            shown(Some(gauge.compliance.crosstalk_percent(LENGTH_M)), 2),
            shown(tilt_rad(found.a_x_rad, found.a_y_rad).map(f64::to_degrees), 3),
            shown(
                real.and_then(|frame| tilt_rad(Some(frame.a_x_rad), Some(frame.a_y_rad)))
                    .map(f64::to_degrees),
                3,
            ),
            shown(found.r_counts_per_nm, 0),
            shown(real.map(|frame| frame.r_counts_per_nm), 0),
            shown(worst_sigma(sensor, gauge), 1),
        ]);
    }
    table
}

/// Angle between the nominal and the actual sensing axis, rad: R3 has the z component cos a_x cos a_y.
fn tilt_rad(a_x_rad: Option<f64>, a_y_rad: Option<f64>) -> Option<f64> {
    Some((a_x_rad?.cos() * a_y_rad?.cos()).clamp(-1.0, 1.0).acos())
}

/// The largest deviation of the seven numbers of a gauge from the truth, in standard deviations.
fn worst_sigma(sensor: &rig::model_file::Sensor, gauge: &sim::TrueGauge) -> Option<f64> {
    let (found, sigma) = (sensor.compliance.array(), sensor.compliance_sigma.array());
    let compliance = gauge.compliance.vector();
    let components = (0..6).filter_map(|k| Some((found[k]? - compliance[k]).abs() / sigma[k]?));
    let bias = (sensor.bias_counts - gauge.bias_counts).abs() / sensor.bias_sigma_counts;
    components.chain([bias]).filter(|sigmas| sigmas.is_finite()).reduce(f64::max)
}
