//! What the joints may do: the URDF's limits, with defaults where it gives none.

use std::f64::consts::PI;

use model::chain::{Chain, JointKind};
use rand::RngExt;
use rand::rngs::StdRng;

use crate::SimError;

/// Largest acceleration of simulated moves, rad/s^2: URDF has no limit for it.
pub const MAX_ACCELERATION_RAD_S2: f64 = 10.0;
/// Share of a joint's speed limit that ordinary moves use.
pub const SPEED_SHARE: f64 = 0.75;
/// Speed of a joint without a limit, rad/s.
const DEFAULT_SPEED_RAD_S: f64 = 1.5;

/// Limits of one coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct JointLimits {
    /// Name of the joint.
    pub name: String,
    /// Lowest position, rad.
    pub lower_rad: f64,
    /// Highest position, rad.
    pub upper_rad: f64,
    /// Highest speed, rad/s.
    pub velocity_rad_s: f64,
    /// Highest acceleration, rad/s^2.
    pub acceleration_rad_s2: f64,
}

/// Limits of all coordinates, base to tip (rad, rad/s, rad/s^2).
#[derive(Clone, Debug, PartialEq)]
pub struct MotionLimits {
    /// One entry a coordinate.
    pub joints: Vec<JointLimits>,
}

impl MotionLimits {
    /// The limits of a chain's coordinates; half a turn either way and 1.5 rad/s where the URDF gives none.
    ///
    /// # Errors
    /// A joint whose limits leave no room to move, or no speed.
    pub fn of(chain: &Chain) -> Result<Self, SimError> {
        let movable = chain.joints.iter().filter(|joint| joint.coordinate.is_some());
        let mut joints = Vec::with_capacity(chain.coordinates());
        for joint in movable {
            let stated = joint.limits.as_ref().filter(|_| joint.kind == JointKind::Revolute);
            let bound = |value: Option<f64>, default: f64| value.filter(|v| v.is_finite()).unwrap_or(default);
            let lower_rad = bound(stated.map(|limits| limits.lower_rad), -PI);
            let upper_rad = bound(stated.map(|limits| limits.upper_rad), PI);
            let velocity = joint.limits.as_ref().map(|limits| limits.velocity_rad_s);
            let velocity_rad_s = bound(velocity, DEFAULT_SPEED_RAD_S);
            if lower_rad >= upper_rad || velocity_rad_s <= 0.0 {
                let problem = format!(
                    "its limits {lower_rad} .. {upper_rad} rad at {velocity_rad_s} rad/s leave it no motion; correct <limit> in {}",
                    chain.file_name
                );
                return Err(SimError::motion(&joint.name, problem));
            }
            joints.push(JointLimits {
                name: joint.name.clone(),
                lower_rad,
                upper_rad,
                velocity_rad_s,
                acceleration_rad_s2: MAX_ACCELERATION_RAD_S2,
            });
        }
        Ok(Self { joints })
    }

    /// The pose in the middle of all limits, rad.
    #[must_use]
    pub fn middle(&self) -> Vec<f64> {
        self.joints.iter().map(|joint| (joint.lower_rad + joint.upper_rad) / 2.0).collect()
    }

    /// A random pose (rad) within `share` of the range about its middle.
    pub(crate) fn random_pose(&self, rng: &mut StdRng, share: f64) -> Vec<f64> {
        let place = |joint: &JointLimits| {
            let half = (joint.upper_rad - joint.lower_rad) / 2.0 * share;
            (joint.lower_rad + joint.upper_rad) / 2.0 + rng.random_range(-half..=half)
        };
        self.joints.iter().map(place).collect()
    }
}
