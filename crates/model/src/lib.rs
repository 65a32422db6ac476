//! Kinematics, loads, sensing frames and the wrench estimator of an arm with joint torque sensors

pub mod chain;
pub mod dynamics;
pub mod spatial;
pub mod urdf;
