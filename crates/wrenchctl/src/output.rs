//! Standard output that may close early, notes on standard error, files written whole or not at all, aligned tables.

use std::fmt;
use std::io::{self, BufWriter, IsTerminal, StdoutLock, Write};
use std::path::{Path, PathBuf};

use crate::Error;

/// Standard output, buffered; flush where a person waits for it.
pub fn stdout() -> BufWriter<StdoutLock<'static>> {
    BufWriter::new(io::stdout().lock())
}

/// One line on standard error; nothing happens where nobody listens.
pub fn note(text: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "wrenchctl: {text}");
}

/// Whether a person watches standard error.
pub fn watched() -> bool {
    io::stderr().is_terminal()
}

/// Writes a whole file or nothing; `-` is standard output.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    if path == Path::new("-") {
        let mut out = stdout();
        out.write_all(bytes)?;
        return Ok(out.flush()?);
    }
    Ok(can::atomic::write(path, bytes)?)
}

/// Fails where a file to be written is one of those that are read. A device or pipe may be both.
pub fn refuse_to_overwrite<'a>(
    outputs: impl IntoIterator<Item = Option<&'a PathBuf>>,
    inputs: &[PathBuf],
) -> Result<(), Error> {
    let file = |path: &Path| std::fs::canonicalize(path).ok().filter(|path| path.is_file());
    let read: Vec<PathBuf> = inputs.iter().filter_map(|input| file(input)).collect();
    for out in outputs.into_iter().flatten().filter(|out| out.as_path() != Path::new("-")) {
        if file(out).is_some_and(|out| read.contains(&out)) {
            let text = format!("{} is one of the inputs; give another file to write", out.display());
            return Err(Error::usage(text));
        }
    }
    Ok(())
}

/// Fails where two results are to go to standard output, each of which would spoil the other.
pub fn one_at_most_to_stdout<const N: usize>(paths: [Option<&PathBuf>; N]) -> Result<(), Error> {
    match paths.into_iter().flatten().filter(|path| path.as_path() == Path::new("-")).count() {
        0 | 1 => Ok(()),
        n => Err(Error::usage(format!(
            "{n} results are to go to standard output; give a file for all but one"
        ))),
    }
}

/// Writes a value as indented JSON; `-` is standard output.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), Error> {
    let mut bytes = serde_json::to_vec_pretty(value).map_err(|error| Error::Output(error.into()))?;
    bytes.push(b'\n');
    write_file(path, &bytes)
}

/// Which side of its column a cell keeps to.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Side {
    /// Text.
    Left,
    /// Numbers.
    Right,
}

/// Rows of cells, aligned when printed.
#[derive(Clone, Debug)]
pub struct Table {
    sides: Vec<Side>,
    rows: Vec<Vec<String>>,
    indent: usize,
}

impl Table {
    /// A table with these columns, indented by so many spaces.
    pub fn new(sides: &[Side], indent: usize) -> Self {
        Self { sides: sides.to_vec(), rows: Vec::new(), indent }
    }

    /// Adds a row; missing cells are empty.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cell = |row: &[String], column: usize| row.get(column).cloned().unwrap_or_default();
        let widths: Vec<usize> = (0..self.sides.len())
            .map(|column| self.rows.iter().map(|row| cell(row, column).chars().count()).max().unwrap_or(0))
            .collect();
        for row in &self.rows {
            let mut line = " ".repeat(self.indent);
            for (column, (side, width)) in self.sides.iter().zip(&widths).enumerate() {
                if column > 0 {
                    line.push_str("  ");
                }
                let text = cell(row, column);
                match side {
                    Side::Left => line.push_str(&format!("{text:<width$}")),
                    Side::Right => line.push_str(&format!("{text:>width$}")),
                }
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_lines_end_with_text() {
        let mut table = Table::new(&[Side::Left, Side::Right, Side::Left], 1);
        table.row(["a", "1", "x"]);
        table.row(["bcd", "23"]);
        assert_eq!(table.to_string(), " a     1  x\n bcd  23\n");
    }
}
