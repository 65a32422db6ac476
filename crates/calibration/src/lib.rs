//! From recordings to each gauge's actual sensing frame, with what the data can and cannot see.
//!
//! [`recording`] reads a run by the same ingestion as the daemon (of a long one what memory should hold: [`Keep`]), [`dataset`] finds the stretches in which the arm holds still
//! and what loads each section there, [`solve`] and [`noise`] estimate one gauge, [`observability`] says what the data
//! could not show (what motion between held poses shows of it: `moving`) and [`plan`] what to record next, [`gauges`] brings all gauges together, [`joint`] estimates the arm with them and [`calibrate`]
//! makes the stored model of it. [`validate`] scores a recording against its truth.

mod calibrate;
pub mod dataset;
mod error;
pub mod gauges;
pub mod joint;
mod keep;
mod moving;
pub mod noise;
pub mod observability;
pub mod plan;
pub mod recording;
pub mod solve;
pub mod still;
pub mod triangle;
pub mod validate;

pub use calibrate::{Axes, Calibration, calibrate};
pub use error::Error;
pub use keep::Keep;
pub use recording::Recording;
