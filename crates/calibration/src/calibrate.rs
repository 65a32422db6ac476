//! The stored model and the report of a calibration.

use model::sensing::{CHARACTERISTIC_LENGTH_M, Compliance};
use nalgebra::{Matrix6, SMatrix, Vector6};
use rig::Rig;
use rig::model_file::{
    Components, FiveParameter, Frame, Input, ModelFile, NominalAxes, Provenance, Sensor, Unobservable,
};
use serde::Serialize;

use crate::dataset::Dataset;
use crate::error::Error;
use crate::gauges::{self, Gauge};
use crate::joint::{self, Joint, outcome::Correction, told::Untold};
use crate::observability::{Remedies, words};
use crate::recording::Recording;
use crate::solve::{Estimate, unscaled};

/// Which part of each gauge's sensitivity to calibrate: the whole, or one of the baselines as a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// The whole compliance vector (actual frame and pitch).
    Full,
    /// The published five parameters: no pitch, ordinary least squares.
    Five,
    /// No crosstalk: the nominal torque alone, ordinary least squares.
    Nominal,
}

/// A finished calibration.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The model to store.
    pub model: ModelFile,
    /// What `--json` prints.
    pub report: Report,
    /// What a person should know, one line each.
    pub warnings: Vec<String>,
    /// Where the arm was estimated with the gauges: what is left of each gauge's readings as a mean over each held pose of the
    /// dataset, counts: `[gauge][window]`.
    pub left_counts: Option<Vec<Vec<Option<f64>>>>,
}

/// `wrenchctl calibrate --json`.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    format: u32,
    /// Still instants used.
    pub samples: u64,
    /// One a gauge.
    pub sensors: Vec<SensorReport>,
    /// Corrections of the arm, the weights and the reference by name.
    pub arm: std::collections::BTreeMap<String, Correction>,
    /// What of these the recordings do not tell.
    pub arm_unobservable: Vec<Untold>,
    /// How much later the gauges are than the joints beyond the configured delays, s; absent where no move tells.
    pub gauges_late_s: Option<Lateness>,
}

/// A time with its standard deviation, s.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Lateness {
    pub value: f64,
    pub sigma: f64,
}

/// One gauge in the report; `None` (null) is what the data do not determine.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct SensorReport {
    pub name: String,
    pub compliance: [Option<f64>; 6],
    pub bias: Option<f64>,
    pub r: Option<f64>,
    pub ax: Option<f64>,
    pub ay: Option<f64>,
    pub lx: Option<f64>,
    pub ly: Option<f64>,
    pub pitch: Option<f64>,
    pub sigma: SigmaReport,
    pub crosstalk_percent: Option<f64>,
    pub noise_floor_counts: f64,
    pub residual_rms_counts: f64,
    pub unobservable: Vec<UnobservableReport>,
}

/// Standard deviations of one gauge's numbers.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct SigmaReport {
    pub compliance: [Option<f64>; 6],
    pub bias: Option<f64>,
    pub r: Option<f64>,
    pub ax: Option<f64>,
    pub ay: Option<f64>,
    pub lx: Option<f64>,
    pub ly: Option<f64>,
    pub pitch: Option<f64>,
}

/// A direction that the data could not see: unit load in S, moments over 0.1 m.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct UnobservableReport {
    pub direction: [f64; 6],
    pub words: String,
    pub remedy: String,
}

/// Calibrates an arm from recordings. `inputs` and `date` (YYYY-MM-DD) go into the model's provenance.
pub fn calibrate(
    rig: &Rig,
    recordings: &[Recording],
    axes: Axes,
    inputs: Vec<Input>,
    date: &str,
) -> Result<Calibration, Error> {
    let dataset = Dataset::new(rig, recordings)?;
    let names: Vec<&str> = rig.config.sensors.iter().map(|s| s.name.as_str()).collect();
    let mut gauges = gauges::calibrate(rig, &dataset, recordings, &names)?;
    let joint = match axes {
        Axes::Full => joint::estimate(rig, &dataset, recordings, &gauges),
        Axes::Five | Axes::Nominal => None,
    };
    if let Some(joint) = &joint {
        gauges.iter_mut().enumerate().for_each(|(k, gauge)| joint.apply(k, gauge));
    }
    let arm = joint.as_ref().and_then(|joint| joint.arm(rig));
    let remedies = Remedies::new(rig);
    let sensors: Vec<Sensor> = gauges
        .iter()
        .enumerate()
        .map(|(k, gauge)| {
            let entry = &rig.config.sensors[k];
            let mut sensor = sensor(&entry.name, &entry.section, k, gauge, &remedies);
            if axes != Axes::Full {
                reduce(&mut sensor, gauge, axes);
            }
            if let Some(joint) = &joint {
                let deviations = arm.as_ref().map_or(&[][..], |arm| &arm.deviations);
                let working = joint.working_covariance(k, deviations);
                sensor.covariance = std::array::from_fn(|i| std::array::from_fn(|j| working[(i, j)]));
                (sensor.centre_counts, sensor.scale_counts, sensor.terms) = joint.terms(k, &working);
            }
            sensor
        })
        .collect();
    let report = Report {
        format: 1,
        samples: dataset.samples,
        sensors: sensors.iter().map(SensorReport::new).collect(),
        arm: joint.iter().flat_map(Joint::corrections).collect(),
        arm_unobservable: joint.iter().flat_map(Joint::untold).collect(),
        gauges_late_s: lateness(&gauges),
    };
    let model = ModelFile {
        format: 1,
        provenance: Provenance {
            tool: concat!("wrenchctl ", env!("CARGO_PKG_VERSION")).to_owned(),
            date: date.to_owned(),
            axes: match axes {
                Axes::Full => "full",
                Axes::Five => "five",
                Axes::Nominal => "nominal",
            }
            .to_owned(),
            samples: dataset.samples,
            inputs,
        },
        joints: dataset.encoders.clone(),
        arm,
        sensors,
        fingerprint: rig.fingerprint().clone(),
    };
    let mut warnings = warnings(&dataset, &gauges, &names, recordings);
    warnings.extend(joint.iter().flat_map(|joint| joint.summary(&names)));
    warnings.extend(report.gauges_late_s.and_then(late));
    let left_counts = joint.map(|joint| joint.left_counts(dataset.windows.len()));
    Ok(Calibration { model, report, warnings, left_counts })
}

/// How much later all gauges are than the joints. Where they differ by more than they say, the sigma holds that.
fn lateness(gauges: &[Gauge]) -> Option<Lateness> {
    let told: Vec<(f64, f64)> = gauges.iter().filter_map(|gauge| gauge.late_s).collect();
    let weight: f64 = told.iter().map(|(_, sigma)| sigma.powi(-2)).sum();
    let value = told.iter().map(|(late, sigma)| late * sigma.powi(-2)).sum::<f64>() / weight;
    let spread: f64 = told.iter().map(|(late, sigma)| ((late - value) / sigma).powi(2)).sum();
    let excess = (spread / (told.len().max(2) - 1) as f64).max(1.0);
    (!told.is_empty()).then(|| Lateness { value, sigma: (excess / weight).sqrt() })
}

/// What to do about gauges that are not in time with the joints.
fn late(late_s: Lateness) -> Option<String> {
    /// Less than this moves no wrench of a usual motion by more than its noise.
    const SMALL_S: f64 = 1e-3;
    let Lateness { value, sigma } = late_s;
    let whose = if value > 0.0 { "[[sensor]]" } else { "[[joint]]" };
    let told = value.abs() > 4.0 * sigma && value.abs() > SMALL_S;
    told.then(|| {
        format!(
            "the gauges are {:.1} ms (sigma {:.1}) {} than the joints while the arm moves: add that to delay_s of every {whose} in the config and calibrate again",
            1e3 * value.abs(),
            1e3 * sigma,
            if value > 0.0 { "later" } else { "earlier" },
        )
    })
}

fn sensor(name: &str, section: &str, index: usize, gauge: &Gauge, remedies: &Remedies) -> Sensor {
    let unseen: Vec<Vector6<f64>> = gauge.directions.unseen().collect();
    let compliance = Compliance::from_vector(&gauge.compliance);
    let known = known_components(&unseen);
    let select = |values: Vector6<f64>| std::array::from_fn(|k| known[k].then_some(values[k]));
    let sigma = Vector6::from_fn(|k, _| gauge.covariance[(k, k)].sqrt());
    let (frame, frame_sigma) = frame(&compliance, gauge, &unseen);
    let whole = known.iter().all(|k| *k);
    let slow = gauge.noise.slow_counts2 / gauge.noise.sigma_counts().powi(2);
    Sensor {
        name: name.to_owned(),
        section: section.to_owned(),
        bias_counts: gauge.bias_counts,
        bias_sigma_counts: gauge.covariance[(6, 6)].sqrt(),
        noise_floor_counts: gauge.noise.sigma_counts(),
        noise_slow_share: slow,
        noise_slow_time_s: gauge.noise.tau_s,
        residual_rms_counts: gauge.residual_rms_counts,
        crosstalk_percent: whole.then(|| compliance.crosstalk_percent(CHARACTERISTIC_LENGTH_M)),
        crosstalk_length_m: CHARACTERISTIC_LENGTH_M,
        covariance: std::array::from_fn(|i| std::array::from_fn(|k| gauge.covariance[(i, k)])),
        working_compliance: (!whole).then(|| gauge.compliance.into()),
        compliance: Components::from_array(select(gauge.compliance)),
        compliance_sigma: Components::from_array(select(sigma)),
        frame,
        frame_sigma,
        five_parameter: five_parameter(&gauge.ordinary),
        nominal_axes: NominalAxes {
            k_counts_per_nm: unscaled(&gauge.nominal.scaled)[5],
            bias_counts: last_bias(&gauge.nominal),
        },
        centre_counts: 0.0,
        scale_counts: 0.0,
        terms: Vec::new(),
        unobservable: unseen
            .iter()
            .zip(&gauge.assumed_counts_per_n)
            .map(|(direction, assumed)| Unobservable {
                direction: (*direction).into(),
                assumed_sigma_counts_per_n: *assumed,
                words: words(name, direction),
                remedy: remedies.remedy(index, direction),
            })
            .collect(),
    }
}

/// Components in which no unseen direction has a share worth speaking of.
fn known_components(unseen: &[Vector6<f64>]) -> [bool; 6] {
    std::array::from_fn(|k| unseen.iter().all(|d| d[k].powi(2) < 0.01))
}

/// The actual sensing frame and its standard deviations, as far as it is determined.
fn frame(compliance: &Compliance, gauge: &Gauge, unseen: &[Vector6<f64>]) -> (Frame, Frame) {
    let (Some(frame), Some(jacobian)) = (compliance.actual_frame(), compliance.frame_jacobian()) else {
        return (Frame::default(), Frame::default());
    };
    let values =
        [frame.r_counts_per_nm, frame.a_x_rad, frame.a_y_rad, frame.l_x_m, frame.l_y_m, frame.pitch_m];
    let part = |c: &SMatrix<f64, 7, 7>| -> Matrix6<f64> {
        jacobian * c.fixed_view::<6, 6>(0, 0) * jacobian.transpose()
    };
    let (whole, seen) = (part(&gauge.covariance), part(&gauge.seen_covariance));
    let torque_seen = unseen.iter().all(|d| d.fixed_rows::<3>(3).norm_squared() < 0.01);
    // A number whose variance is mostly assumed is not determined by the data.
    let known = |k: usize| torque_seen && whole[(k, k)] <= 2.0 * seen[(k, k)];
    let frame = std::array::from_fn(|k| known(k).then_some(values[k]));
    let sigma = std::array::from_fn(|k| known(k).then(|| whole[(k, k)].sqrt()));
    (Frame::from_array(frame), Frame::from_array(sigma))
}

fn last_bias(estimate: &Estimate) -> f64 {
    estimate.biases.iter().rev().find_map(|b| *b).unwrap_or(0.0)
}

/// The published method: the frame of the ordinary least squares compliance, its pitch dropped.
fn five_parameter(ordinary: &Estimate) -> FiveParameter {
    let frame = Compliance::from_vector(&unscaled(&ordinary.scaled)).actual_frame();
    let of = |f: fn(&model::sensing::ActualFrame) -> f64| frame.as_ref().map_or(0.0, f);
    FiveParameter {
        r_counts_per_nm: of(|f| f.r_counts_per_nm),
        a_x_rad: of(|f| f.a_x_rad),
        a_y_rad: of(|f| f.a_y_rad),
        l_x_m: of(|f| f.l_x_m),
        l_y_m: of(|f| f.l_y_m),
        bias_counts: last_bias(ordinary),
    }
}

/// Makes a baseline of a sensor: its compliance and bias replaced, nothing said of their uncertainty.
fn reduce(sensor: &mut Sensor, gauge: &Gauge, axes: Axes) {
    let (compliance, bias) = match axes {
        Axes::Five => {
            let five = &sensor.five_parameter;
            (five.compliance().vector(), five.bias_counts)
        }
        _ => {
            let nominal = &sensor.nominal_axes;
            (Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, nominal.k_counts_per_nm), nominal.bias_counts)
        }
    };
    let reduced = Compliance::from_vector(&compliance);
    let frame = reduced.actual_frame();
    sensor.compliance = Components::from_array(std::array::from_fn(|k| Some(compliance[k])));
    sensor.compliance_sigma = Components::default();
    sensor.working_compliance = None;
    sensor.unobservable.clear();
    sensor.bias_counts = bias;
    sensor.covariance = [[0.0; 7]; 7];
    sensor.bias_sigma_counts = 0.0;
    sensor.crosstalk_percent =
        Some(reduced.crosstalk_percent(CHARACTERISTIC_LENGTH_M)).filter(|c| c.is_finite());
    sensor.frame = frame.map_or_else(Frame::default, |f| {
        Frame::from_array([f.r_counts_per_nm, f.a_x_rad, f.a_y_rad, f.l_x_m, f.l_y_m, f.pitch_m].map(Some))
    });
    sensor.frame_sigma = Frame::default();
    sensor.noise_floor_counts = gauge.noise.sigma_counts();
}

impl SensorReport {
    fn new(sensor: &Sensor) -> Self {
        let [r, ax, ay, lx, ly, pitch] = sensor.frame.array();
        let [sr, sax, say, slx, sly, spitch] = sensor.frame_sigma.array();
        Self {
            name: sensor.name.clone(),
            compliance: sensor.compliance.array(),
            bias: Some(sensor.bias_counts),
            r,
            ax,
            ay,
            lx,
            ly,
            pitch,
            sigma: SigmaReport {
                compliance: sensor.compliance_sigma.array(),
                bias: Some(sensor.bias_sigma_counts),
                r: sr,
                ax: sax,
                ay: say,
                lx: slx,
                ly: sly,
                pitch: spitch,
            },
            crosstalk_percent: sensor.crosstalk_percent,
            noise_floor_counts: sensor.noise_floor_counts,
            residual_rms_counts: sensor.residual_rms_counts,
            unobservable: sensor
                .unobservable
                .iter()
                .map(|u| UnobservableReport {
                    direction: u.direction,
                    words: u.words.clone(),
                    remedy: u.remedy.clone(),
                })
                .collect(),
        }
    }
}

fn warnings(dataset: &Dataset, gauges: &[Gauge], names: &[&str], recordings: &[Recording]) -> Vec<String> {
    let mut out = Vec::new();
    if dataset.sessions.len() > 1 {
        let last = &dataset.sessions[dataset.sessions.len() - 1];
        out.push(format!(
            "{} sessions: every gauge has a zero in each; the model keeps those of the last one, {last}",
            dataset.sessions.len()
        ));
    }
    out.extend(recordings.iter().filter_map(|recording| recording.thinned.clone()));
    out.extend(recordings.iter().filter_map(Recording::oddities));
    for (name, gauge) in names.iter().zip(gauges) {
        if gauge.outliers > 0 {
            let all = gauge.readings + gauge.outliers;
            out.push(format!("{name}: {} of {all} readings left out, too far off", gauge.outliers));
        }
    }
    out
}
