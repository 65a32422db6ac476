//! A robot as configured: configuration, run directories, and the cycle from CAN frames to a wrench

pub mod binding;
pub mod config;
pub mod cycle;
pub mod document;
pub mod error;
pub mod model_file;
pub mod run;
pub mod status;
pub mod tare;
pub mod wire;

pub use binding::Rig;
pub use config::Config;
pub use cycle::Cycle;
pub use error::RigError;
pub use model_file::ModelFile;
pub use run::Run;
pub use status::Status;
