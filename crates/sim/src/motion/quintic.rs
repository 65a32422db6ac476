//! Moves from pose to pose along `10 s^3 - 15 s^4 + 6 s^5`: at rest, without acceleration, at both ends.

use super::MotionLimits;

/// Peak of the first derivative of the blend, at its middle.
pub(super) const PEAK_SPEED: f64 = 1.875;
/// Peak of the second derivative of the blend: `10 / sqrt(3)`.
pub(super) const PEAK_ACCELERATION: f64 = 5.773_502_691_896_258;

/// Blend from 0 to 1 with its first and second derivative by `s`, for 0 <= s <= 1.
pub(super) fn blend(s: f64) -> [f64; 3] {
    let rest = 1.0 - s;
    [
        s * s * s * (10.0 + s * (-15.0 + 6.0 * s)),
        30.0 * s * s * rest * rest,
        60.0 * s * rest * (1.0 - 2.0 * s),
    ]
}

/// A move between two poses (rad) in which all joints start and arrive together.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    from_rad: Vec<f64>,
    to_rad: Vec<f64>,
    duration_s: f64,
}

impl Move {
    /// The fastest move at which no joint exceeds `speed_share` of its speed limit (rad/s), nor its acceleration (rad/s^2).
    #[must_use]
    pub fn new(from_rad: Vec<f64>, to_rad: Vec<f64>, limits: &MotionLimits, speed_share: f64) -> Self {
        let mut duration_s: f64 = 0.0;
        for ((from, to), limit) in from_rad.iter().zip(&to_rad).zip(&limits.joints) {
            let way = (to - from).abs();
            let by_speed = PEAK_SPEED * way / (limit.velocity_rad_s * speed_share);
            let by_acceleration = (PEAK_ACCELERATION * way / limit.acceleration_rad_s2).sqrt();
            duration_s = duration_s.max(by_speed).max(by_acceleration);
        }
        Self { from_rad, to_rad, duration_s }
    }

    /// How long it takes, s; 0 where both poses are the same.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Position, velocity and acceleration of a coordinate at an instant (s): rad, rad/s, rad/s^2.
    #[must_use]
    pub fn at(&self, coordinate: usize, t_s: f64) -> [f64; 3] {
        let (from, to) = (self.from_rad[coordinate], self.to_rad[coordinate]);
        if self.duration_s <= 0.0 {
            return [to, 0.0, 0.0];
        }
        let (way, rate) = (to - from, self.duration_s.recip());
        let [s, ds, dds] = blend((t_s * rate).clamp(0.0, 1.0));
        [from + way * s, way * ds * rate, way * dds * rate * rate]
    }

    pub(super) fn extent(&self, coordinate: usize) -> (f64, f64) {
        let (from, to) = (self.from_rad[coordinate], self.to_rad[coordinate]);
        (from.min(to), from.max(to))
    }
}
