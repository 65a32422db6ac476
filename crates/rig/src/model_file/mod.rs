//! MODEL: what a calibration found, as a text file that people read and the daemon applies.
//!
//! The stored truth is each gauge's compliance vector, bias and their covariance; the actual sensing frame, the crosstalk
//! and all else are derived from it and stand there for the reader. A quantity that the data did not determine is absent.

mod arm;
mod known;
mod terms;

use std::path::Path;

pub use arm::{Arm, ArmDeviation, ArmJoint, MOST_DEVIATIONS};
use model::chain::Chain;
use model::estimator::{ArmModel, GaugeCovariance, GaugeModel};
use model::sensing::{ActualFrame, Compliance};
use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

pub use terms::{EffectShape, SensorTerm};

use crate::Rig;
use crate::binding::Fingerprint;
use crate::document;
use crate::error::{RigError, read_text};

/// A calibrated arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Version of this format: 1.
    pub format: u32,
    /// Where it comes from.
    pub provenance: Provenance,
    /// Encoders, one a coordinate from base to tip.
    #[serde(rename = "joint")]
    pub joints: Vec<Encoder>,
    /// What the arm has other than its URDF; absent where nothing was worth correcting.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arm: Option<Arm>,
    /// Gauges in the configuration's order.
    #[serde(rename = "sensor")]
    pub sensors: Vec<Sensor>,
    /// What the arm looked like, so that the model of another arm is refused.
    pub fingerprint: Fingerprint,
}

/// How a model came about.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Program and version.
    pub tool: String,
    /// Date of the calibration, UTC, as YYYY-MM-DD.
    pub date: String,
    /// Which axes were calibrated: "full", or one of the baselines "five" and "nominal".
    pub axes: String,
    /// Still instants used.
    pub samples: u64,
    /// The files it was made from.
    pub inputs: Vec<Input>,
}

/// One input of a calibration.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// The file as it was given.
    pub file: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
}

/// Noise of one coordinate's encoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Encoder {
    /// The joint's name.
    pub name: String,
    /// Standard deviation of one position reading, rad.
    pub position_sigma_rad: f64,
    /// Standard deviation of one velocity reading, rad/s, where velocities are measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_sigma_rad_s: Option<f64>,
}

/// Six numbers of a load or a compliance by name; absent where not determined. Force in S first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Components {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fx_counts_per_n: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fy_counts_per_n: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fz_counts_per_n: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tx_counts_per_nm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ty_counts_per_nm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tz_counts_per_nm: Option<f64>,
}

/// The actual sensing frame A against S, with the pitch; absent where not determined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Frame {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub r_counts_per_nm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub a_x_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub a_y_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub l_x_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub l_y_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch_m: Option<f64>,
}

/// One gauge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Name, as in the configuration.
    pub name: String,
    /// URDF joint of its section, as in the configuration.
    pub section: String,
    /// Reading without load, counts.
    pub bias_counts: f64,
    /// Standard deviation of the bias, counts.
    pub bias_sigma_counts: f64,
    /// Standard deviation of one still reading about the calibrated prediction, its slow part included, counts.
    pub noise_floor_counts: f64,
    /// Share of the noise's variance that is correlated in time.
    pub noise_slow_share: f64,
    /// Correlation time of that part, s.
    pub noise_slow_time_s: f64,
    /// RMS of all samples used about the calibrated prediction, counts.
    pub residual_rms_counts: f64,
    /// Crosstalk against the nominal z torque, per cent; absent where not determined.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crosstalk_percent: Option<f64>,
    /// Length that compares N with Nm in the crosstalk, m.
    pub crosstalk_length_m: f64,
    /// Covariance of fx fy fz (counts/N), tx ty tz (counts/Nm) and bias (counts), in that order; where something is
    /// unobservable, with the width that is assumed there; where the arm was calibrated too, without directions in which arm
    /// and gauges move together and no prediction moves.
    pub covariance: [[f64; 7]; 7],
    /// What the estimator uses where something is unobservable: `compliance` with the unseen directions at zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub working_compliance: Option<[f64; 6]>,
    /// Sensitivity to the load of the section.
    pub compliance: Components,
    /// Its standard deviations.
    pub compliance_sigma: Components,
    /// The actual sensing frame.
    pub frame: Frame,
    /// Its standard deviations.
    pub frame_sigma: Frame,
    /// Baseline: the published five-parameter method on the same samples.
    pub five_parameter: FiveParameter,
    /// Baseline: no crosstalk correction, `z = k t_z + b` on the same samples.
    pub nominal_axes: NominalAxes,
    /// Reading that the terms take as the middle, counts.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub centre_counts: f64,
    /// Change of reading that the terms take as one, counts.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub scale_counts: f64,
    /// What the gauge adds to its readings beside the load's share.
    #[serde(rename = "term", default, skip_serializing_if = "Vec::is_empty")]
    pub terms: Vec<SensorTerm>,
    /// Directions that the data could not see.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unobservable: Vec<Unobservable>,
}

#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A direction of load to which a gauge's sensitivity is unknown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Unobservable {
    /// Unit direction of load in S; moments over the characteristic length 0.1 m.
    pub direction: [f64; 6],
    /// Width assumed for the sensitivity along it, so that it never counts as known, counts/N.
    pub assumed_sigma_counts_per_n: f64,
    /// The direction in physical words.
    pub words: String,
    /// What would show it.
    pub remedy: String,
}

/// The published method's parameters of one gauge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct FiveParameter {
    pub r_counts_per_nm: f64,
    pub a_x_rad: f64,
    pub a_y_rad: f64,
    pub l_x_m: f64,
    pub l_y_m: f64,
    pub bias_counts: f64,
}

/// A gauge taken to sense its nominal axis only.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct NominalAxes {
    pub k_counts_per_nm: f64,
    pub bias_counts: f64,
}

impl FiveParameter {
    /// Compliance vector of these parameters, without pitch: counts/N and counts/Nm in S.
    pub fn compliance(&self) -> Compliance {
        ActualFrame {
            r_counts_per_nm: self.r_counts_per_nm,
            a_x_rad: self.a_x_rad,
            a_y_rad: self.a_y_rad,
            l_x_m: self.l_x_m,
            l_y_m: self.l_y_m,
            pitch_m: 0.0,
        }
        .compliance()
    }
}

impl Components {
    /// In the order fx fy fz tx ty tz; `None` where absent.
    pub fn array(&self) -> [Option<f64>; 6] {
        [
            self.fx_counts_per_n,
            self.fy_counts_per_n,
            self.fz_counts_per_n,
            self.tx_counts_per_nm,
            self.ty_counts_per_nm,
            self.tz_counts_per_nm,
        ]
    }

    /// From the order fx fy fz tx ty tz.
    pub fn from_array(c: [Option<f64>; 6]) -> Self {
        Self {
            fx_counts_per_n: c[0],
            fy_counts_per_n: c[1],
            fz_counts_per_n: c[2],
            tx_counts_per_nm: c[3],
            ty_counts_per_nm: c[4],
            tz_counts_per_nm: c[5],
        }
    }
}

impl Frame {
    /// In the order r a_x a_y l_x l_y pitch; `None` where absent.
    pub fn array(&self) -> [Option<f64>; 6] {
        [self.r_counts_per_nm, self.a_x_rad, self.a_y_rad, self.l_x_m, self.l_y_m, self.pitch_m]
    }

    /// From the order r a_x a_y l_x l_y pitch.
    pub fn from_array(p: [Option<f64>; 6]) -> Self {
        Self { r_counts_per_nm: p[0], a_x_rad: p[1], a_y_rad: p[2], l_x_m: p[3], l_y_m: p[4], pitch_m: p[5] }
    }
}

/// The least share of a gauge's variance that is taken to last longer than 50 ms, whatever its calibration found.
const LEAST_SLOW_SHARE: f64 = 0.1;

impl Sensor {
    /// Variance of the reading that is new at each instant, counts^2.
    pub fn white_counts2(&self) -> f64 {
        let slow = self.noise_slow_share.clamp(LEAST_SLOW_SHARE, 1.0);
        self.noise_floor_counts.powi(2) * (1.0 - slow)
    }

    /// The compliance that the estimator uses, counts/N and counts/Nm in S.
    pub fn working(&self) -> Vector6<f64> {
        match &self.working_compliance {
            Some(working) => Vector6::from(*working),
            None => Vector6::from(self.compliance.array().map(|c| c.unwrap_or(0.0))),
        }
    }

    /// The gauge as the estimator takes it.
    pub fn gauge(&self) -> GaugeModel {
        GaugeModel {
            compliance: self.working(),
            bias_counts: self.bias_counts,
            covariance: self.whole_covariance(),
            assumed: self.assumed(),
            noise_counts2: self.noise_floor_counts.powi(2),
            terms: terms::gauge_terms(self.centre_counts, self.scale_counts, &self.terms),
        }
    }

    /// Covariance of compliance, bias and terms, all that is uncertain about them included.
    fn whole_covariance(&self) -> GaugeCovariance {
        let mut whole = GaugeCovariance::zeros();
        for (i, row) in self.covariance.iter().enumerate() {
            row.iter().enumerate().for_each(|(k, value)| whole[(i, k)] = *value);
        }
        for (i, term) in self.terms.iter().enumerate() {
            for (k, value) in term.covariance.iter().enumerate().take(8 + i) {
                whole[(7 + i, k)] = *value;
                whole[(k, 7 + i)] = *value;
            }
        }
        whole
    }

    /// Covariance of the compliance that is assumed for lack of data; counts/N, counts/Nm.
    fn assumed(&self) -> Option<Matrix6<f64>> {
        let length = model::sensing::CHARACTERISTIC_LENGTH_M;
        let mut sum = Matrix6::zeros();
        for unseen in &self.unobservable {
            // Sensitivity per unit of load/length: back from N-equivalents to counts per Nm.
            let direction =
                Vector6::from_fn(|k, _| unseen.direction[k] * if k < 3 { 1.0 } else { length.recip() });
            sum += direction * direction.transpose() * unseen.assumed_sigma_counts_per_n.powi(2);
        }
        (!self.unobservable.is_empty()).then_some(sum)
    }
}

impl ModelFile {
    /// Reads a model and checks that it is the model of this robot.
    pub fn load(file: &Path, rig: &Rig) -> Result<Self, RigError> {
        Self::of_robot(file, &Self::text(file)?, rig)
    }

    /// A model file's text as it stands there.
    pub fn text(file: &Path) -> Result<String, RigError> {
        read_text(file, "a model that `wrenchctl calibrate` wrote")
    }

    /// Reads a model's text and checks that it is the model of this robot; `file` is named in errors.
    pub fn of_robot(file: &Path, text: &str, rig: &Rig) -> Result<Self, RigError> {
        let model = Self::parse(file, text)?;
        rig.check_model(file, &model.fingerprint)?;
        let joints = model.joints.iter().map(|j| j.name.as_str());
        if !joints.eq(rig.chain.coordinate_names()) {
            let names = rig.chain.coordinate_names().join(", ");
            let problem =
                format!("its [[joint]] tables are not those of the arm, {names}; calibrate this arm");
            return Err(RigError::of_file(file, problem));
        }
        if let Some(arm) = &model.arm {
            arm.check_chain(&rig.chain)
                .map_err(|problem| RigError::of_file(file, format!("{problem}; calibrate this arm")))?;
        }
        Ok(model)
    }

    /// Reads a model's text; `file` is named in errors.
    pub fn parse(file: &Path, text: &str) -> Result<Self, RigError> {
        let model: Self = document::parse(file, text)?;
        model.check().map_err(|problem| {
            RigError::of_file(file, format!("{problem}; the file was edited or cut, calibrate again"))
        })?;
        Ok(model)
    }

    /// The model as text.
    pub fn to_toml(&self) -> String {
        let body = toml::to_string(self).expect("a model has only keys and values that TOML can hold");
        format!(
            "# Calibrated model of an arm with joint torque sensors, written by `wrenchctl calibrate`.\n{body}"
        )
    }

    /// The gauges as the estimator takes them: what the arm's deviations say of them is not said twice.
    pub fn gauges(&self) -> Vec<GaugeModel> {
        let mut gauges: Vec<GaugeModel> = self.sensors.iter().map(Sensor::gauge).collect();
        for deviation in self.arm.iter().flat_map(|arm| &arm.deviations) {
            for (index, gauge) in gauges.iter_mut().enumerate() {
                let part = nalgebra::SVector::from(deviation.gauge(index));
                gauge.covariance -= part * part.transpose();
            }
        }
        gauges
    }

    /// The arm as calibrated, `chain` being the URDF's, and what the estimator takes beside it.
    pub fn arm(&self, chain: &Chain) -> (Chain, ArmModel) {
        match &self.arm {
            Some(arm) => (arm.correction().apply(chain), arm.model(chain)),
            None => (chain.clone(), ArmModel::default()),
        }
    }

    /// Encoder of a coordinate.
    pub fn encoder(&self, coordinate: usize) -> &Encoder {
        &self.joints[coordinate]
    }

    fn check(&self) -> Result<(), String> {
        if self.sensors.len() != self.fingerprint.sensors.len() {
            return Err("has another number of [[sensor]] tables than its fingerprint".into());
        }
        for (sensor, print) in self.sensors.iter().zip(&self.fingerprint.sensors) {
            sensor.check().map_err(|problem| format!("sensor \"{}\": {problem}", sensor.name))?;
            if (&sensor.name, &sensor.section) != (&print.name, &print.section) {
                return Err(format!("sensor \"{}\" is not the one in its fingerprint", sensor.name));
            }
        }
        if let Some(arm) = &self.arm {
            arm.check(&self.sensors.iter().map(|s| s.terms.len()).collect::<Vec<_>>())?;
        }
        for (sensor, gauge) in self.sensors.iter().zip(self.gauges()) {
            if !is_covariance(&gauge.covariance, &sensor.whole_covariance()) {
                let name = &sensor.name;
                return Err(format!(
                    "[arm] a deviation says more than the gauge's covariance of sensor \"{name}\""
                ));
            }
        }
        for joint in &self.joints {
            let sigma = joint.position_sigma_rad;
            if !(sigma > 0.0 && sigma.is_finite()) {
                return Err(format!(
                    "joint \"{}\": position_sigma_rad = {sigma} is not positive",
                    joint.name
                ));
            }
        }
        Ok(())
    }
}

impl Sensor {
    fn check(&self) -> Result<(), String> {
        if !(self.noise_floor_counts > 0.0 && self.noise_floor_counts.is_finite()) {
            return Err(format!("noise_floor_counts = {} is not positive", self.noise_floor_counts));
        }
        if !(0.0..=1.0).contains(&self.noise_slow_share) {
            return Err(format!("noise_slow_share = {} is not between 0 and 1", self.noise_slow_share));
        }
        for (key, value) in [
            ("noise_slow_time_s", self.noise_slow_time_s),
            ("bias_sigma_counts", self.bias_sigma_counts),
            ("residual_rms_counts", self.residual_rms_counts),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(format!("{key} = {value} is negative or not finite"));
            }
        }
        terms::check(self.scale_counts, &self.terms)?;
        if !self.bias_counts.is_finite() || !self.working().iter().all(|c| c.is_finite()) {
            return Err("compliance or bias is not a finite number".into());
        }
        if !self.covariance.iter().flatten().all(|c| c.is_finite()) {
            return Err("the covariance has a number that is not finite".into());
        }
        let covariance = self.whole_covariance();
        let lopsided = (covariance - covariance.transpose()).amax() > 1e-9 * covariance.amax();
        if lopsided || covariance.diagonal().iter().any(|v| *v < 0.0) {
            return Err("the covariance is not symmetric with a positive diagonal".into());
        }
        if !is_covariance(&covariance, &covariance) {
            return Err("the covariance is none: some combination has a negative variance".into());
        }
        if self.unobservable.is_empty() && self.compliance.array().contains(&None) {
            return Err("a component of the compliance is missing, and nothing is called unobservable".into());
        }
        Ok(())
    }
}

/// Whether no combination has a negative variance, but for rounding of the text; `scale` has the size of the numbers.
fn is_covariance(matrix: &GaugeCovariance, scale: &GaugeCovariance) -> bool {
    let scale = scale.diagonal().map(|v| if v > 0.0 { v.sqrt().recip() } else { 0.0 });
    let correlation = GaugeCovariance::from_fn(|i, k| matrix[(i, k)] * scale[i] * scale[k]);
    let mut certain = (0..scale.len()).filter(|k| scale[*k] == 0.0);
    let loose = certain.any(|k| matrix.row(k).amax() > 0.0);
    !loose && correlation.symmetric_eigenvalues().min() > -1e-6
}
