//! What the simulated gauges and encoders are really like: drawn from a seed, or taken from a calibrated model.

use can::assembly::SignalBinding;
use can::signal::ValueKind;
use model::sensing::{ActualFrame, CHARACTERISTIC_LENGTH_M, Compliance};
use nalgebra::Vector3;
use rand::RngExt;
use rand::rngs::StdRng;
use rig::Rig;
use rig::model_file::{Encoder, ModelFile, Provenance, Sensor};

use crate::SimError;
use crate::effects::Effects;
use crate::imperfect::Imperfections;
use crate::random::{Purpose, stream};

/// Crosstalk of cheap gauges, per cent, smallest and largest: what Kim, Park and Song (J. Mech. Sci. Technol. 24(8), 2010)
/// found in eight of them was 3 .. 273 %.
const CROSSTALK_PERCENT: (f64, f64) = (3.0, 270.0);
/// Scale, counts/Nm, smallest and largest, for a converter of 24 bits.
const SCALE_COUNTS_PER_NM: (f64, f64) = (1.5e5, 6e5);
/// Largest reading without load, counts, for a converter of 24 bits: some 2 % of its range.
const BIAS_COUNTS: f64 = 2e5;
/// Farthest of a sensing line from its section's origin, m.
const OFFSET_M: f64 = 0.02;
/// Standard deviation of a reading, counts, smallest and largest, for a converter of 24 bits: some 3 mNm.
const NOISE_COUNTS: (f64, f64) = (500.0, 700.0);
/// Share of the noise's variance that is correlated in time.
const SLOW_SHARE: f64 = 0.15;
/// Its correlation time, s.
const SLOW_TIME_S: f64 = 0.2;
/// Noise of an encoder, rad.
const POSITION_SIGMA_RAD: f64 = 20e-6;
/// Noise of a measured velocity, rad/s.
const VELOCITY_SIGMA_RAD_S: f64 = 1e-3;
/// Half the range of a converter of 24 bits, counts.
const HALF_RANGE_24_COUNTS: f64 = 8_388_608.0;

/// Noise of one gauge's readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaugeNoise {
    /// Standard deviation of one reading, slow part included, counts.
    pub sigma_counts: f64,
    /// Share of its variance that is correlated in time, 0 .. 1.
    pub slow_share: f64,
    /// Correlation time of that part, s.
    pub slow_time_s: f64,
}

/// One gauge as it really is: `z = C . L + b + noise`, L in the nominal sensing frame S.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueGauge {
    /// Sensitivity to the load of its section, counts/N and counts/Nm, in S.
    pub compliance: Compliance,
    /// Reading without load, counts.
    pub bias_counts: f64,
    /// Noise of its readings.
    pub noise: GaugeNoise,
}

/// Noise of one coordinate's encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueEncoder {
    /// Standard deviation of a position, rad.
    pub position_sigma_rad: f64,
    /// Standard deviation of a velocity, rad/s, where velocities are sent.
    pub velocity_sigma_rad_s: f64,
}

/// All gauges in the configuration's order, and the encoders from base to tip, as they really are.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// The gauges.
    pub gauges: Vec<TrueGauge>,
    /// The encoders, one a coordinate.
    pub encoders: Vec<TrueEncoder>,
    /// What else is not as declared; none for an arm that is exactly its URDF, with linear gauges.
    pub imperfections: Option<Imperfections>,
    /// Effects put in at a chosen place and size.
    pub effects: Effects,
}

impl TrueGauge {
    /// The actual sensing frame with scale (counts/Nm), angles (rad), offsets and pitch (m), in S; none for a force cell.
    #[must_use]
    pub fn frame(&self) -> Option<ActualFrame> {
        self.compliance.actual_frame()
    }

    /// Reading without noise (counts) under the load `load` (N, Nm about S's origin, in S).
    #[must_use]
    pub fn counts(&self, load: &nalgebra::Vector6<f64>) -> f64 {
        self.compliance.vector().dot(load) + self.bias_counts
    }
}

impl Truth {
    /// What a perfect calibration of these gauges would have found: their true compliances, biases and noise, without an arm that is not as declared.
    #[must_use]
    pub fn known(&self, rig: &Rig) -> ModelFile {
        let sensors = rig.config.sensors.iter().zip(&self.gauges).map(|(sensor, gauge)| Sensor {
            bias_counts: gauge.bias_counts,
            noise_slow_share: gauge.noise.slow_share,
            noise_slow_time_s: gauge.noise.slow_time_s,
            ..Sensor::known(&sensor.name, &sensor.section, &gauge.compliance, gauge.noise.sigma_counts)
        });
        let names = rig.chain.coordinate_names();
        let joints = names.into_iter().zip(&self.encoders).map(|(name, encoder)| Encoder {
            name: name.to_owned(),
            position_sigma_rad: encoder.position_sigma_rad,
            velocity_sigma_rad_s: None,
        });
        ModelFile {
            format: 1,
            provenance: Provenance {
                tool: "the simulator".into(),
                date: "2026-01-01".into(),
                axes: "full".into(),
                samples: 1,
                inputs: Vec::new(),
            },
            joints: joints.collect(),
            arm: None,
            sensors: sensors.collect(),
            fingerprint: rig.fingerprint().clone(),
        }
    }

    /// Gauges with crosstalk as cheap ones have it, for the sensors of a configuration; pitch up to `pitch_max_m` (m).
    ///
    /// Scales, biases and noise shrink with the signal's range, where that is smaller than 24 bits.
    #[must_use]
    pub fn draw(rig: &Rig, seed: u64, pitch_max_m: f64) -> Self {
        let mut rng = stream(seed, Purpose::Gauges);
        let gauges = &rig.layout.gauges;
        Self {
            gauges: gauges.iter().map(|gauge| draw_gauge(&gauge.counts, pitch_max_m, &mut rng)).collect(),
            encoders: vec![usual_encoder(); rig.chain.coordinates()],
            imperfections: None,
            effects: Effects::default(),
        }
    }

    /// The same gauges and encoders on an arm as it is built, with every small fault of a cheap one, drawn from `seed`.
    ///
    /// # Errors
    /// A joint whose limits leave no motion.
    pub fn with_imperfections(mut self, rig: &Rig, seed: u64) -> Result<Self, SimError> {
        self.imperfections = Some(Imperfections::draw(rig, &self.gauges, seed)?);
        Ok(self)
    }

    /// The gauges and encoders of a calibrated model of this robot.
    ///
    /// # Errors
    /// The model has another number of sensors or joints than the configuration.
    pub fn from_model(rig: &Rig, model: &ModelFile) -> Result<Self, SimError> {
        let (sensors, joints) = (model.sensors.len(), model.joints.len());
        let expected = (rig.sections.len(), rig.chain.coordinates());
        if (sensors, joints) != expected {
            let problem = format!(
                "has {sensors} sensors and {joints} joints, the configuration {} and {}; give the model of this arm",
                expected.0, expected.1
            );
            return Err(SimError::signal("the model", problem));
        }
        let gauge = |sensor: &rig::model_file::Sensor| TrueGauge {
            compliance: Compliance::from_vector(&sensor.working()),
            bias_counts: sensor.bias_counts,
            noise: GaugeNoise {
                sigma_counts: sensor.noise_floor_counts,
                slow_share: sensor.noise_slow_share,
                slow_time_s: sensor.noise_slow_time_s,
            },
        };
        let encoder = |joint: &rig::model_file::Encoder| TrueEncoder {
            position_sigma_rad: joint.position_sigma_rad,
            velocity_sigma_rad_s: joint.velocity_sigma_rad_s.unwrap_or(VELOCITY_SIGMA_RAD_S),
        };
        Ok(Self {
            gauges: model.sensors.iter().map(gauge).collect(),
            encoders: model.joints.iter().map(encoder).collect(),
            imperfections: None,
            effects: Effects::default(),
        })
    }

    /// The same gauges and encoders without any noise; what the signals round (counts, rad) stays.
    #[must_use]
    pub fn without_noise(mut self) -> Self {
        for gauge in &mut self.gauges {
            gauge.noise.sigma_counts = 0.0;
        }
        self.encoders.fill(TrueEncoder { position_sigma_rad: 0.0, velocity_sigma_rad_s: 0.0 });
        self
    }
}

fn usual_encoder() -> TrueEncoder {
    TrueEncoder { position_sigma_rad: POSITION_SIGMA_RAD, velocity_sigma_rad_s: VELOCITY_SIGMA_RAD_S }
}

fn draw_gauge(signal: &SignalBinding, pitch_max_m: f64, rng: &mut StdRng) -> TrueGauge {
    let (middle_counts, size) = middle_and_size(signal);
    let (low, high) = CROSSTALK_PERCENT;
    let crosstalk = log_uniform(rng, low, high) / 100.0;
    // Part of the crosstalk comes from the line's distance (and pitch), the rest from its tilt:
    // crosstalk^2 = tan^2 + k^2 (1 + tan^2), with k = |l, h| / characteristic length.
    let length = CHARACTERISTIC_LENGTH_M;
    let offset_m =
        (crosstalk * length * rng.random_range(0.2..0.8)).min(rng.random_range(0.5..1.0) * OFFSET_M);
    let pitch_m = pitch_max_m.abs() * rng.random_range(-1.0..=1.0);
    let k = offset_m.hypot(pitch_m) / length;
    let tilt = ((crosstalk * crosstalk - k * k).max(0.0) / (1.0 + k * k)).sqrt().atan();
    let (tilt_to, offset_to): (f64, f64) =
        (rng.random_range(0.0..std::f64::consts::TAU), rng.random_range(0.0..std::f64::consts::TAU));
    let line = Vector3::new(tilt.sin() * tilt_to.cos(), tilt.sin() * tilt_to.sin(), tilt.cos());
    let straight = ActualFrame {
        r_counts_per_nm: size * log_uniform(rng, SCALE_COUNTS_PER_NM.0, SCALE_COUNTS_PER_NM.1),
        a_x_rad: line.y.atan2(line.z),
        a_y_rad: (-line.x).atan2(line.y.hypot(line.z)),
        l_x_m: offset_m * offset_to.cos(),
        l_y_m: offset_m * offset_to.sin(),
        pitch_m,
    };
    TrueGauge {
        compliance: straight.compliance(),
        bias_counts: middle_counts + size * rng.random_range(-BIAS_COUNTS..BIAS_COUNTS),
        noise: GaugeNoise {
            sigma_counts: size * rng.random_range(NOISE_COUNTS.0..NOISE_COUNTS.1),
            slow_share: SLOW_SHARE,
            slow_time_s: SLOW_TIME_S,
        },
    }
}

fn log_uniform(rng: &mut StdRng, low: f64, high: f64) -> f64 {
    rng.random_range(low.ln()..high.ln()).exp()
}

/// Middle of a reading's range (counts) where it is not 0, and the range over that of 24 bits, at most 1.
fn middle_and_size(signal: &SignalBinding) -> (f64, f64) {
    let (low, high) = range_si(signal);
    if !(low.is_finite() && high.is_finite()) {
        return (0.0, 1.0);
    }
    let half = (high - low) / 2.0;
    let middle = if low < 0.0 && high > 0.0 { 0.0 } else { low + half };
    (middle, (half / HALF_RANGE_24_COUNTS).min(1.0))
}

/// Lowest and highest value that a signal can say, in the product's unit; infinite for floats without limits.
pub(crate) fn range_si(signal: &SignalBinding) -> (f64, f64) {
    let spec = &signal.spec;
    let bits = i32::from(spec.bits);
    let raw = match spec.kind {
        ValueKind::Unsigned => (0.0, 2f64.powi(bits) - 1.0),
        ValueKind::Signed => (-2f64.powi(bits - 1), 2f64.powi(bits - 1) - 1.0),
        ValueKind::F32 | ValueKind::F64 => (f64::NEG_INFINITY, f64::INFINITY),
    };
    let physical = |raw: f64| raw * spec.scale + spec.offset;
    let (a, b) = (physical(raw.0), physical(raw.1));
    let low = a.min(b).max(spec.min.unwrap_or(f64::NEG_INFINITY));
    let high = a.max(b).min(spec.max.unwrap_or(f64::INFINITY));
    let (low, high) = (low * signal.to_si, high * signal.to_si);
    (low.min(high), low.max(high))
}
