//! A robot as configured: configuration, run directories, and the cycle from CAN frames to a wrench

pub mod config;
mod document;
mod error;
pub mod run;
pub mod wire;

pub use config::Config;
pub use error::RigError;
pub use run::Run;
