//! A motion from a CSV file: instants and joint positions.

use std::path::Path;

use super::{MotionLimits, Spline, Trajectory};
use crate::SimError;

/// How far a spline may exceed a limit before it is refused: rounding of the rows, not a motion.
const LIMIT_TOLERANCE: f64 = 1e-3;

impl Trajectory {
    /// The motion in a CSV file: header `t` and the names of the movable joints (or `q1` .. `qn`, base to tip), then rows
    /// of an instant (s, increasing) and positions (rad). A spline joins them; it starts and ends at rest.
    ///
    /// # Errors
    /// A file that cannot be read, a column or row that cannot be used, or a motion beyond the joints' limits.
    pub fn from_csv(file: &Path, limits: &MotionLimits) -> Result<Self, SimError> {
        let text = std::fs::read_to_string(file).map_err(|source| SimError::Read {
            file: file.to_owned(),
            source,
            what: "a motion as CSV text: t, then one column of positions (rad) a joint",
        })?;
        Self::parse_csv(file, &text, limits)
    }

    /// The motion in the text of a CSV file; `file` is what messages call it. Instants in s, positions in rad.
    ///
    /// # Errors
    /// As [`Self::from_csv`].
    pub fn parse_csv(file: &Path, text: &str, limits: &MotionLimits) -> Result<Self, SimError> {
        let mut lines = text
            .lines()
            .enumerate()
            .map(|(index, line)| (index + 1, line.trim()))
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let (header_line, header) = lines.next().unwrap_or((1, ""));
        let columns = columns(file, header_line, header.trim_start_matches('\u{feff}'), limits)?;
        let mut rows: Vec<(f64, Vec<f64>)> = Vec::new();
        let mut numbers = Vec::new();
        for (line, text) in lines {
            let (t_s, row) =
                parse_row(text, &columns, limits).map_err(|why| SimError::row(file, line, why))?;
            if let Some((last_s, _)) = rows.last().filter(|(last_s, _)| *last_s >= t_s) {
                let problem = format!("t = {t_s} is not after t = {last_s} of the row before; sort the rows");
                return Err(SimError::row(file, line, problem));
            }
            rows.push((t_s, row));
            numbers.push(line);
        }
        let Some(spline) = Spline::new(&rows) else {
            let problem = format!("has {} rows below its header; a motion needs at least two", rows.len());
            return Err(SimError::row(file, header_line, problem));
        };
        check_limits(file, &spline, &rows, &numbers, limits)?;
        Ok(Self::from_spline(spline))
    }
}

/// Which coordinate each column after `t` belongs to.
fn columns(file: &Path, line: usize, header: &str, limits: &MotionLimits) -> Result<Vec<usize>, SimError> {
    let names: Vec<&str> = limits.joints.iter().map(|joint| joint.name.as_str()).collect();
    let expected = || format!("write t,{} (rad) or t,q1..q{}", names.join(","), names.len());
    let mut titles = header.split(',').map(str::trim);
    let first = titles.next().unwrap_or("");
    if first != "t" {
        let problem = format!("the first column is \"{first}\" instead of t (s); {}", expected());
        return Err(SimError::row(file, line, problem));
    }
    let mut columns = Vec::with_capacity(names.len());
    for title in titles {
        let numbered = title.strip_prefix('q').and_then(|number| number.parse::<usize>().ok());
        let by_number = numbered.and_then(|number| number.checked_sub(1)).filter(|k| *k < names.len());
        let Some(coordinate) = names.iter().position(|name| *name == title).or(by_number) else {
            let problem = format!("the column \"{title}\" is no movable joint of the arm; {}", expected());
            return Err(SimError::row(file, line, problem));
        };
        if columns.contains(&coordinate) {
            let problem = format!("joint \"{}\" has two columns; remove one", names[coordinate]);
            return Err(SimError::row(file, line, problem));
        }
        columns.push(coordinate);
    }
    if let Some(missing) = (0..names.len()).find(|coordinate| !columns.contains(coordinate)) {
        let problem = format!("joint \"{}\" has no column; {}", names[missing], expected());
        return Err(SimError::row(file, line, problem));
    }
    Ok(columns)
}

fn parse_row(text: &str, columns: &[usize], limits: &MotionLimits) -> Result<(f64, Vec<f64>), String> {
    let count = text.split(',').count();
    if count != columns.len() + 1 {
        return Err(format!(
            "has {count} columns instead of {}; complete or remove the row",
            columns.len() + 1
        ));
    }
    let mut values = text.split(',').map(|cell| {
        let number = cell.trim().parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| format!("\"{}\" is not a finite number; correct it", cell.trim()))
    });
    let t_s = values.next().unwrap_or(Ok(0.0))?;
    let mut row = vec![0.0; columns.len()];
    for (coordinate, value) in columns.iter().zip(values) {
        let (value, limit) = (value?, &limits.joints[*coordinate]);
        if value < limit.lower_rad - LIMIT_TOLERANCE || value > limit.upper_rad + LIMIT_TOLERANCE {
            return Err(format!(
                "joint \"{}\" at {value} rad is outside its limits {} .. {} rad; are these degrees?",
                limit.name, limit.lower_rad, limit.upper_rad
            ));
        }
        row[*coordinate] = value;
    }
    Ok((t_s, row))
}

fn check_limits(
    file: &Path,
    spline: &Spline,
    rows: &[(f64, Vec<f64>)],
    numbers: &[usize],
    limits: &MotionLimits,
) -> Result<(), SimError> {
    for (coordinate, limit) in limits.joints.iter().enumerate() {
        let name = &limit.name;
        let (speed, at_s) = spline.fastest(coordinate);
        if speed > limit.velocity_rad_s * (1.0 + LIMIT_TOLERANCE) {
            let begun_s = at_s + rows.first().map_or(0.0, |row| row.0);
            let row = rows.partition_point(|row| row.0 <= begun_s).saturating_sub(1);
            let problem = format!(
                "joint \"{name}\" would move at {speed:.3} rad/s from here on, above its limit of {} rad/s; give it more time (the motion starts and ends at rest)",
                limit.velocity_rad_s
            );
            return Err(SimError::row(file, numbers.get(row).copied().unwrap_or(1), problem));
        }
        let (low, high) = spline.extent(coordinate);
        if low < limit.lower_rad - LIMIT_TOLERANCE || high > limit.upper_rad + LIMIT_TOLERANCE {
            let problem = format!(
                "joint \"{name}\" swings to {low:.4} .. {high:.4} rad between the rows, outside its limits {} .. {} rad; give more rows or keep away from the limits",
                limit.lower_rad, limit.upper_rad
            );
            return Err(SimError::row(file, numbers.first().copied().unwrap_or(1), problem));
        }
    }
    Ok(())
}
