//! Joint velocity and acceleration from measured positions, with their covariance.
//!
//! The gauges feel inertia, so the wrench needs accelerations, and an encoder differentiated twice is mostly noise. Each
//! joint's motion is a chain of integrators driven by white snap (the fourth derivative of position). How strong
//! that snap is differs by many decades between a held pose and a fast move, so a small bank of Kalman filters
//! runs side by side, one for each strength and one for a joint at rest, mixed as an interacting multiple model (Blom and
//! Bar-Shalom, IEEE Trans. Automatic Control 33(8), 1988). The mixture's covariance holds the doubt about which applies.
//!
//! [`RoundClock`] says how far apart the positions were sampled; [`MotionFilter`] is causal and runs in the cycle; [`LagSmoother`]
//! waits for some rounds more; [`smooth`] uses the whole recording and is for offline work.

mod bank;
mod clock;
mod filter;
mod kalman;
mod lag;
mod rhythm;
mod smoother;

pub use clock::{RoundClock, Sampled};
pub use filter::{Fate, MotionFilter};
pub use lag::LagSmoother;
pub use smoother::smooth;

use nalgebra::Matrix3;

/// Position, velocity and acceleration of one joint at one instant, with their covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointMotion {
    /// Joint position, rad.
    pub position_rad: f64,
    /// Joint velocity, rad/s.
    pub velocity_rad_s: f64,
    /// Joint acceleration, rad/s^2.
    pub acceleration_rad_s2: f64,
    /// Covariance of position, velocity and acceleration in that order; rad, rad/s, rad/s^2.
    pub covariance: Matrix3<f64>,
}

impl JointMotion {
    /// A joint known to rest exactly at a position, rad.
    pub fn at_rest(position_rad: f64) -> Self {
        Self { position_rad, velocity_rad_s: 0.0, acceleration_rad_s2: 0.0, covariance: Matrix3::zeros() }
    }

    /// Between this motion (share 0) and another (1), by a straight line.
    pub fn towards(&self, other: &Self, share: f64) -> Self {
        let between = |own: f64, other: f64| own + share * (other - own);
        Self {
            position_rad: between(self.position_rad, other.position_rad),
            velocity_rad_s: between(self.velocity_rad_s, other.velocity_rad_s),
            acceleration_rad_s2: between(self.acceleration_rad_s2, other.acceleration_rad_s2),
            covariance: self.covariance + (other.covariance - self.covariance) * share,
        }
    }
}

/// Spectral densities of the driving snap of a moving joint, rad^2/s^7: from a creep to a violent move. The highest follows
/// a reversal of tens of rad/s^2 within a few samples.
const SNAP_DENSITIES: [f64; 7] = [1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7];

/// Mean time that a moving joint stays with one strength of snap, s: about that of a move.
const DWELL_S: f64 = 1.2;

/// Mean time that a joint at rest stays there, s: robots hold poses, and rest is left only on evidence.
const REST_S: f64 = 40.0;
