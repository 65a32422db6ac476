//! From recordings to each gauge's actual sensing frame, with what the data can and cannot see.

pub mod noise;
pub mod triangle;
