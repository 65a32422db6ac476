//! The page of `calibrate --report`: the gauges as found, what is left of their readings, and what the recordings showed.

use calibration::dataset::Dataset;
use calibration::{Calibration, Recording};
use model::sensing::CHARACTERISTIC_LENGTH_M;
use nalgebra::Vector6;
use report::{Bars, Cell, Heading, Heat, List, Page, Table, Text, number};
use rig::model_file::Sensor;
use rig::{Rig, Run};

use super::residuals::Residuals;
use super::temperatures::Temperatures;
use super::{arm, left_out};
use crate::Error;

/// The whole page.
pub fn page(result: &Calibration, rig: &Rig, runs: &[Run], recordings: &[Recording]) -> Result<Page, Error> {
    let dataset = Dataset::new(rig, recordings)?;
    let temperatures = runs.iter().map(|run| Temperatures::read(run, rig)).collect::<Result<Vec<_>, _>>()?;
    let sensors = &result.model.sensors;
    let residuals = Residuals::new(rig, result, &dataset, recordings, &temperatures);
    let source = &result.model.provenance;
    let subtitle = format!(
        "{} gauges, {} still instants in {} held poses of {}; {} axes, {}, {}",
        sensors.len(),
        source.samples,
        dataset.windows.len(),
        dataset.recordings.join(", "),
        source.axes,
        source.date,
        source.tool
    );
    let mut page = Page::new("Calibration", subtitle);
    in_short(&mut page, result, residuals.overall());
    gauges(&mut page, rig, sensors, &dataset);
    crosstalk(&mut page, sensors);
    residuals.add_to(&mut page);
    observability(&mut page, sensors);
    Ok(page)
}

fn in_short(page: &mut Page, result: &Calibration, overall: [Option<f64>; 3]) {
    let sensors = &result.model.sensors;
    let of = |s: &Sensor| s.crosstalk_percent.filter(|c| c.is_finite());
    let worst = sensors.iter().filter_map(|s| Some((of(s)?, s))).max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((percent, sensor)) = worst {
        page.add(Text::new(format!(
            "{} has the most crosstalk: its sensitivity to what it was not meant to sense is {} % of that to its own torque.",
            sensor.name,
            number(percent, 3)
        )));
    }
    if let [Some(nominal), Some(five), Some(ours)] = overall {
        page.add(Text::new(format!(
            "What is left in a held pose, as a mean over it, is {} noise floors with nominal axes, {} with five parameters and {} with this model. \
             A mean over many readings of a gauge with white noise alone would be well below 1.",
            number(nominal, 3),
            number(five, 3),
            number(ours, 3)
        )));
    }
    page.add(List::new(result.warnings.iter().cloned()));
}

fn gauges(page: &mut Page, rig: &Rig, sensors: &[Sensor], dataset: &Dataset) {
    page.add(Heading::section("Sensing axes"));
    let poses: Vec<&[f64]> = dataset.windows.iter().map(|w| &w.pose_rad[..]).collect();
    page.add(arm::drawing(rig, sensors, &poses));
    page.add(Heading::small("From near, all at one scale"));
    page.add(Text::new(
        "Dashed: the nominal axis, through the section's origin. Solid: the actual axis, with a dot at its positive end. The thin cross is x and y of the nominal sensing frame.",
    ));
    page.add(arm::close_ups(sensors));
    if let Some(text) = left_out(sensors.len(), "gauges") {
        page.add(text);
    }
}

fn crosstalk(page: &mut Page, sensors: &[Sensor]) {
    page.add(Heading::section("Crosstalk"));
    let mut table = Table::new(
        "Actual sensing frames; \u{b1} is one standard deviation",
        &[
            ("gauge", ""),
            ("section", ""),
            ("crosstalk", "%"),
            ("r", "counts/Nm"),
            ("a_x", "deg"),
            ("a_y", "deg"),
            ("l_x", "mm"),
            ("l_y", "mm"),
            ("pitch", "mm"),
            ("noise", "counts"),
            ("residual", "counts"),
        ],
    );
    let factors = [1.0, f64::to_degrees(1.0), f64::to_degrees(1.0), 1e3, 1e3, 1e3];
    for s in sensors {
        let mut row = vec![Cell::from(s.name.as_str()), Cell::from(s.section.as_str())];
        row.push(Cell::Number(s.crosstalk_percent, 3));
        for ((value, sigma), factor) in s.frame.array().iter().zip(s.frame_sigma.array()).zip(factors) {
            row.push(with_sigma(value.map(|v| v * factor), sigma.map(|v| v * factor)));
        }
        row.push(Cell::Number(Some(s.noise_floor_counts), 3));
        row.push(Cell::Number(Some(s.residual_rms_counts), 3));
        table.row(row);
    }
    page.add(table);
    let length_m = sensors.first().map_or(CHARACTERISTIC_LENGTH_M, |s| s.crosstalk_length_m);
    page.add(Text::new(format!(
        "Crosstalk is the sensitivity to everything but torque about the nominal axis, over that to this torque; {length_m} m compares newtons with newton metres.",
    )));
    let title = "Crosstalk before and after correction";
    let bars = Bars::new(title, "%", &["uncorrected", "left after correction (one standard deviation)"]);
    page.add(
        sensors.iter().fold(bars, |bars, s| bars.row(s.name.clone(), &[s.crosstalk_percent, remaining(s)])),
    );
}

/// A value with its standard deviation, as a cell to the right.
fn with_sigma(value: Option<f64>, sigma: Option<f64>) -> Cell {
    match (value, sigma) {
        (Some(value), Some(sigma)) if sigma > 0.0 && sigma.is_finite() => {
            // As many decimals as the deviation's first digit has.
            let decimals = usize::try_from(-sigma.log10().floor() as i32).unwrap_or(0).min(6);
            Cell::Right(format!("{value:.decimals$} \u{b1} {sigma:.decimals$}").replace('-', "\u{2212}"))
        }
        (value, _) => Cell::Number(value, 4),
    }
}

/// Crosstalk that the calibration's own uncertainty leaves, %; none where it states no uncertainty, or a direction was not seen.
fn remaining(sensor: &Sensor) -> Option<f64> {
    sensor.crosstalk_percent?;
    let variance = |k: usize| sensor.covariance[k][k];
    let length = CHARACTERISTIC_LENGTH_M;
    let sum: f64 = (0..5).map(|k| if k < 3 { variance(k) / (length * length) } else { variance(k) }).sum();
    (sum > 0.0).then(|| 100.0 * sum.sqrt() / sensor.working()[5].abs())
}

fn observability(page: &mut Page, sensors: &[Sensor]) {
    page.add(Heading::section("What the recordings could show"));
    let names = ["force x", "force y", "force z", "torque x", "torque y", "torque z"];
    let mut heat = Heat::new("Standard deviation of each sensitivity", names.map(str::to_owned))
        .remark("% of the gauge's whole sensitivity (torque over 0.1 m); a dash is not determined");
    for s in sensors {
        let whole = Vector6::from_fn(|k, _| s.working()[k] * per_newton(k)).norm();
        let sigma = s.compliance_sigma.array();
        heat.row(
            s.name.clone(),
            sigma
                .iter()
                .enumerate()
                .map(|(k, sigma)| sigma.map(|sigma| 100.0 * sigma * per_newton(k) / whole)),
        );
    }
    page.add(heat);
    let unseen: Vec<String> = sensors
        .iter()
        .flat_map(|s| &s.unobservable)
        .map(|u| format!("{}: never excited; {}", u.words, u.remedy))
        .collect();
    if unseen.is_empty() {
        page.add(Text::new("Every direction of every gauge was excited."));
    }
    page.add(List::new(unseen));
}

/// What a sensitivity is multiplied by to be one per newton, moments over the characteristic length.
fn per_newton(component: usize) -> f64 {
    if component < 3 { 1.0 } else { CHARACTERISTIC_LENGTH_M }
}
