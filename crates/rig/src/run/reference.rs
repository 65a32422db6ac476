//! The reference wrench of a run, as a table over time.

use std::path::{Path, PathBuf};

use model::spatial::{Tip, Wrench};
use nalgebra::Vector6;

use crate::error::{RigError, read_text};

/// Farthest from a row that the reference still counts as mounted (s).
pub const MOUNTED_WITHIN_S: f64 = 0.05;

const HEADER: &str = "t,fx,fy,fz,tx,ty,tz";

/// One row: the wrench applied to the tip beside the loads, about E's origin, in E's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceRow {
    /// Instant (s from the log's first frame).
    pub t_s: f64,
    /// Force (N), then moment (Nm), about E's origin, in E's axes.
    pub wrench: Wrench<Tip>,
}

/// Wrench applied to the tip beside the loads, over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    file: PathBuf,
    rows: Vec<ReferenceRow>,
}

impl Reference {
    /// The table in a CSV file with the header `t,fx,fy,fz,tx,ty,tz`, t increasing.
    pub fn load(file: &Path) -> Result<Self, RigError> {
        Self::parse(file, &read_text(file, "a reference (CSV)")?)
    }

    /// The table in `text`; `file` is what messages call it.
    pub fn parse(file: &Path, text: &str) -> Result<Self, RigError> {
        let mut lines = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
        let header = lines.next().map_or("", |(_, line)| line);
        if !header.trim_start_matches('\u{feff}').split(',').map(str::trim).eq(HEADER.split(',')) {
            let problem = format!("begins with \"{}\"; the first line must be {HEADER}", beginning(header));
            return Err(RigError::at_line(file, 1, problem));
        }
        let mut rows: Vec<ReferenceRow> = Vec::with_capacity(text.len() / 60);
        for (number, line) in lines.filter(|(_, line)| !line.is_empty()) {
            let row = parse_row(line).map_err(|problem| RigError::at_line(file, number, problem))?;
            if let Some(last) = rows.last().filter(|last| last.t_s >= row.t_s) {
                let problem =
                    format!("t = {} is not after t = {} of the row before; sort the rows", row.t_s, last.t_s);
                return Err(RigError::at_line(file, number, problem));
            }
            rows.push(row);
        }
        if rows.is_empty() {
            return Err(RigError::of_file(
                file,
                "has no rows; remove `reference` from run.toml if none was mounted",
            ));
        }
        Ok(Self { file: file.to_owned(), rows })
    }

    /// The rows, t increasing.
    #[must_use]
    pub fn rows(&self) -> &[ReferenceRow] {
        &self.rows
    }

    /// The wrench (N, Nm; about E's origin, in E) at an instant (s from the log's first frame): interpolated between
    /// two rows within [`MOUNTED_WITHIN_S`], that of a single row so near, else none: no reference was mounted.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Option<Wrench<Tip>> {
        let after = self.rows.partition_point(|row| row.t_s < t_s);
        let near = |row: &&ReferenceRow| (row.t_s - t_s).abs() <= MOUNTED_WITHIN_S;
        let later = self.rows.get(after).filter(near);
        let earlier = after.checked_sub(1).and_then(|index| self.rows.get(index)).filter(near);
        match (earlier, later) {
            (Some(a), Some(b)) => {
                let part = (t_s - a.t_s) / (b.t_s - a.t_s);
                Some(a.wrench * (1.0 - part) + b.wrench * part)
            }
            (Some(row), None) | (None, Some(row)) => Some(row.wrench),
            (None, None) => None,
        }
    }

    pub(super) fn check_span(&self, log_duration_s: f64) -> Result<(), RigError> {
        let inside =
            |row: &ReferenceRow| (-MOUNTED_WITHIN_S..=log_duration_s + MOUNTED_WITHIN_S).contains(&row.t_s);
        if self.rows.iter().any(inside) {
            return Ok(());
        }
        let (first_s, last_s) = match (self.rows.first(), self.rows.last()) {
            (Some(first), Some(last)) => (first.t_s, last.t_s),
            _ => return Ok(()),
        };
        let problem = format!(
            "covers {first_s} .. {last_s} s, but the log lasts {log_duration_s:.3} s; t is in seconds from the log's first frame"
        );
        Err(RigError::of_file(&self.file, problem))
    }
}

fn parse_row(line: &str) -> Result<ReferenceRow, String> {
    let mut values = [0.0; 7];
    let count = line.split(',').count();
    if count != values.len() {
        return Err(format!(
            "has {count} columns instead of {} ({HEADER}); complete or remove the row",
            values.len()
        ));
    }
    for ((value, text), name) in values.iter_mut().zip(line.split(',')).zip(HEADER.split(',')) {
        let parsed = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
        *value = parsed.ok_or_else(|| {
            format!(
                "{name} = \"{}\" is not a finite number; correct or remove the row",
                beginning(text.trim())
            )
        })?;
    }
    let [t_s, fx, fy, fz, tx, ty, tz] = values;
    Ok(ReferenceRow { t_s, wrench: Wrench::from_vector(&Vector6::new(fx, fy, fz, tx, ty, tz)) })
}

/// As much of a foreign text as a message can hold.
fn beginning(text: &str) -> String {
    if text.chars().count() <= 60 {
        text.to_owned()
    } else {
        text.chars().take(57).chain("...".chars()).collect()
    }
}
