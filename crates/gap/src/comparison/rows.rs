//! The order of a table's rows: recordings together, time increasing, cut where it was interrupted.

use super::description::Description;
use super::table::{Columns, Table};
use crate::Error;
use crate::division::Recording;

/// A step in time so much longer than usual is an interruption.
const INTERRUPTION: f64 = 20.0;

/// Puts the rows of a recording together, in the order in which recordings first appear.
pub(super) fn gather(columns: &mut Columns) -> Vec<Recording> {
    let rows = columns.lines.len();
    if columns.texts.is_empty() {
        return vec![Recording { name: "the recording".to_owned(), rows: 0..rows, repeats: None }];
    }
    let mut names: Vec<&str> = Vec::new();
    let mut places: Vec<usize> = Vec::with_capacity(rows);
    for text in &columns.texts {
        places.push(names.iter().position(|name| name == text).unwrap_or_else(|| {
            names.push(text);
            names.len() - 1
        }));
    }
    let mut order: Vec<usize> = (0..rows).collect();
    order.sort_by_key(|row| places[*row]);
    for column in &mut columns.numbers {
        *column = order.iter().map(|row| column[*row]).collect();
    }
    columns.lines = order.iter().map(|row| columns.lines[*row]).collect();
    let mut first = 0;
    let mut recordings = Vec::new();
    for (place, name) in names.iter().enumerate() {
        let count = places.iter().filter(|p| **p == place).count();
        recordings.push(Recording { name: (*name).to_owned(), rows: first..first + count, repeats: None });
        first += count;
    }
    recordings
}

pub(super) fn check_time(
    description: &Description,
    table: &Table,
    time_s: &[f64],
    recordings: &[Recording],
    lines: &[usize],
) -> Result<(), Error> {
    let name = description.time.as_deref().unwrap_or("time");
    for recording in recordings {
        for row in recording.rows.clone().skip(1) {
            if time_s[row] <= time_s[row - 1] {
                let problem = format!(
                    "{name} = {} is not after {} of the row before it in {}; sort the rows, or tell recordings apart with \
                     recording = \"COLUMN\"",
                    time_s[row],
                    time_s[row - 1],
                    recording.name
                );
                return Err(table.problem(Some(lines[row]), problem));
            }
        }
    }
    Ok(())
}

/// Recordings, cut where they were interrupted.
pub(super) fn segments(time_s: Option<&[f64]>, recordings: &[Recording]) -> Vec<std::ops::Range<usize>> {
    let Some(time_s) = time_s else { return recordings.iter().map(|r| r.rows.clone()).collect() };
    let mut segments = Vec::new();
    for rows in recordings.iter().map(|r| r.rows.clone()) {
        let mut steps: Vec<f64> = time_s[rows.clone()].windows(2).map(|pair| pair[1] - pair[0]).collect();
        let middle = steps.len() / 2;
        let usual =
            if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 };
        let mut first = rows.start;
        for row in rows.clone().skip(1) {
            if time_s[row] - time_s[row - 1] > INTERRUPTION * usual {
                segments.push(first..row);
                first = row;
            }
        }
        segments.push(first..rows.end);
    }
    segments
}
