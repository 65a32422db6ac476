//! Sums of sines about a pose, faded in and out, scaled to keep to the limits.

use std::f64::consts::TAU;

use super::MotionLimits;
use super::quintic::{PEAK_ACCELERATION, PEAK_SPEED, blend};

/// One sine of a joint's motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sine {
    /// Amplitude, rad.
    pub amplitude_rad: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Phase at the beginning, rad.
    pub phase_rad: f64,
}

/// A swing: `center + w(t) sum a sin(2 pi f t + phase)`, with `w` rising from 0 to 1 and back at the ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Sines {
    center_rad: Vec<f64>,
    terms: Vec<Vec<Sine>>,
    duration_s: f64,
    ramp_s: f64,
}

impl Sines {
    /// A swing of `duration_s` about `center_rad` with these sines for each coordinate, fading in and out over `ramp_s`.
    ///
    /// A coordinate's amplitudes are scaled down together where their sum could leave its limits of position, speed
    /// (`speed_share` of it) or acceleration.
    #[must_use]
    pub fn new(
        center_rad: Vec<f64>,
        mut terms: Vec<Vec<Sine>>,
        duration_s: f64,
        ramp_s: f64,
        limits: &MotionLimits,
        speed_share: f64,
    ) -> Self {
        terms.resize(center_rad.len(), Vec::new());
        let ramp_s = ramp_s.min(duration_s / 2.0);
        for ((terms, limit), center) in terms.iter_mut().zip(&limits.joints).zip(&center_rad) {
            // Bounds of w S, its first and its second derivative, from the bounds of w and of each sine.
            let mut bounds = [0.0; 3];
            for term in terms.iter() {
                let (a, omega) = (term.amplitude_rad.abs(), TAU * term.frequency_hz.abs());
                let (dw, ddw) = (PEAK_SPEED / ramp_s, PEAK_ACCELERATION / (ramp_s * ramp_s));
                bounds[0] += a;
                bounds[1] += a * (omega + dw);
                bounds[2] += a * (omega * omega + 2.0 * dw * omega + ddw);
            }
            let room = (limit.upper_rad - center).min(center - limit.lower_rad).max(0.0);
            let allowed = [room, limit.velocity_rad_s * speed_share, limit.acceleration_rad_s2];
            let scale = allowed
                .iter()
                .zip(bounds)
                .filter(|(_, bound)| *bound > 0.0)
                .fold(1.0f64, |scale, (allowed, bound)| scale.min(allowed / bound));
            terms.iter_mut().for_each(|term| term.amplitude_rad *= scale);
        }
        Self { center_rad, terms, duration_s, ramp_s }
    }

    /// How long it takes, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The fade and its derivatives by time.
    fn window(&self, t_s: f64) -> [f64; 3] {
        let left_s = self.duration_s - t_s;
        let (s, sign) = if t_s < left_s { (t_s, 1.0) } else { (left_s, -1.0) };
        if s >= self.ramp_s {
            return [1.0, 0.0, 0.0];
        }
        let rate = self.ramp_s.recip();
        let [w, dw, ddw] = blend((s * rate).clamp(0.0, 1.0));
        [w, sign * dw * rate, ddw * rate * rate]
    }

    /// Position, velocity and acceleration of a coordinate at an instant (s): rad, rad/s, rad/s^2.
    #[must_use]
    pub fn at(&self, coordinate: usize, t_s: f64) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for term in &self.terms[coordinate] {
            let omega = TAU * term.frequency_hz;
            let (sin, cos) = (omega * t_s + term.phase_rad).sin_cos();
            sum[0] += term.amplitude_rad * sin;
            sum[1] += term.amplitude_rad * omega * cos;
            sum[2] -= term.amplitude_rad * omega * omega * sin;
        }
        let [w, dw, ddw] = self.window(t_s);
        [
            self.center_rad[coordinate] + w * sum[0],
            dw * sum[0] + w * sum[1],
            ddw * sum[0] + 2.0 * dw * sum[1] + w * sum[2],
        ]
    }

    pub(super) fn extent(&self, coordinate: usize) -> (f64, f64) {
        let reach: f64 = self.terms[coordinate].iter().map(|term| term.amplitude_rad.abs()).sum();
        let center = self.center_rad[coordinate];
        (center - reach, center + reach)
    }
}
