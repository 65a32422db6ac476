//! The sim-to-real gap: where it lies, which physical effect causes it, how far it shrinks on data left out
//!
//! From data to answer: [`comparison`] (files to a [`Session`]: channels with gap and covariates, divided into units and
//! blocks), [`effects`] (the catalogue: what each effect would add), `library` (products of those columns, block by block:
//! the only pass over the data), `select` (which effects, by left-out units and a paired block bootstrap), `attribute` (shares,
//! intervals, look-alikes), `location` (where), [`diagnosis`] (the answer as values).
//!
//! What it does not do: tell effects apart that the data does not; find anything outside its catalogue; judge a gap whose
//! noise nobody states.

mod agreement;
mod apply;
mod attribute;
mod bootstrap;
mod candidates;
pub mod comparison;
mod confidence;
mod diagnose;
pub mod diagnosis;
mod division;
mod doubt;
pub mod effects;
mod error;
mod establish;
mod fit;
mod folds;
mod generic;
mod library;
mod location;
mod loops;
mod measure;
mod motion;
mod oracle;
mod orders;
mod parallel;
mod refine;
mod refit;
mod remainder;
pub mod runs;
mod screen;
mod select;
pub mod session;
mod shapes;
mod spectrum;
mod steadiness;
mod words;

pub use apply::apply;
pub use diagnose::{diagnose, diagnose_without};
pub use diagnosis::Diagnosis;
pub use error::Error;
pub use oracle::oracle;
pub use session::Session;
