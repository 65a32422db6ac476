//! Kinematics, loads, sensing frames and the wrench estimator of an arm with joint torque sensors.
//!
//! No I/O and no clock. From the bottom up: [`spatial`] (wrenches with their frame as a type, placements, bodies),
//! [`chain`] and [`urdf`] (the arm), [`dynamics`] (what its own weight and motion load each section with),
//! [`sensing`] (what a gauge makes of a load, and its actual sensing frame), [`motion`] (velocity and acceleration from
//! positions) and [`estimator`] (the environment's wrench).

pub mod arm;
pub mod chain;
pub mod dynamics;
mod error;
pub mod estimator;
mod lanes;
pub mod motion;
pub mod sensing;
pub mod spatial;
pub mod terms;
pub mod urdf;
