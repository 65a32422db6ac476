//! From the text of a URDF to the chain of an arm, with one clear error for whatever cannot be used.

mod bodies;
mod scan;
mod tree;

use std::panic::{AssertUnwindSafe, catch_unwind};

use nalgebra::Vector3;

use crate::chain::Chain;
pub use crate::error::UrdfError;
pub(crate) use crate::error::suggestion;

impl Chain {
    /// The chain from link `base` to link `tip` (SI, frames as in the URDF) with gravity (m/s^2, base frame).
    ///
    /// Links that branch off the chain are lumped into the link they hang on, movable branches at position zero with a
    /// warning. What hangs on the base link is felt by no section and is left out. `file_name` is for messages.
    ///
    /// # Errors
    /// See [`UrdfError`]; no text makes this panic.
    pub fn from_urdf(
        text: &str,
        file_name: &str,
        base: &str,
        tip: &str,
        gravity_mps2: Vector3<f64>,
    ) -> Result<Self, UrdfError> {
        if !gravity_mps2.iter().all(|component| component.is_finite()) {
            return Err(UrdfError::Gravity { gravity_mps2: gravity_mps2.into() });
        }
        let robot = parse(text, file_name)?;
        tree::Tree::new(&robot, file_name)?.chain(base, tip, gravity_mps2)
    }
}

/// Reads the text, with the line of what cannot be read.
fn parse(text: &str, file: &str) -> Result<urdf_rs::Robot, UrdfError> {
    let malformed = |line, reason| UrdfError::Malformed { file: file.to_owned(), line, reason };
    let outline = scan::outline(text).map_err(|(line, reason)| malformed(Some(line), reason))?;
    read(text).map_err(|reason| {
        if let Some((line, reason)) = xml_place(&reason) {
            return malformed(Some(line), reason);
        }
        match outline.offender(text, |part| read(part).err()) {
            Some((line, reason)) => malformed(Some(line), reason),
            None => malformed(None, reason),
        }
    })
}

/// Reads the text with the parser kept from panicking.
fn read(text: &str) -> Result<urdf_rs::Robot, String> {
    match catch_unwind(AssertUnwindSafe(|| urdf_rs::read_from_string(text))) {
        Ok(Ok(robot)) => Ok(robot),
        Ok(Err(error)) => Err(error.to_string().replace('\n', " ")),
        Err(_) => Err("the XML parser gave up on it".to_owned()),
    }
}

/// Line (from 1) and reason out of the XML parser's "Parse error; Line: 1, Column: 2, Reason: text".
fn xml_place(message: &str) -> Option<(usize, String)> {
    let (line, rest) = message.strip_prefix("Parse error; Line: ")?.split_once(", Column: ")?;
    let (column, reason) = rest.split_once(", Reason: ")?;
    Some((line.parse().ok()?, format!("column {column}: {reason}")))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
