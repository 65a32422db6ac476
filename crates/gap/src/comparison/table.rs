//! A table of numbers in a CSV file, plain, gzip or zstd by content: only the columns that somebody asks for.

use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use rig::error::{read_bytes, suggest};

use crate::Error;

/// Larger than any table that fits the memory this is for, bytes after decompression.
const LARGEST_BYTES: u64 = 4 << 30;

/// The text of a table with its header split.
#[derive(Debug)]
pub(super) struct Table {
    file: PathBuf,
    text: String,
    header: Vec<String>,
}

/// Columns of a table, row by row without those that lack a value.
#[derive(Debug, Default)]
pub(super) struct Columns {
    /// Per asked column its values.
    pub(super) numbers: Vec<Vec<f64>>,
    /// Values of the text column, if one was asked for.
    pub(super) texts: Vec<String>,
    /// Line of every row, counted from 1.
    pub(super) lines: Vec<usize>,
    /// Rows that were left out because a value is missing.
    pub(super) incomplete: usize,
}

impl Table {
    /// Reads and decompresses the file.
    pub(super) fn load(file: &Path) -> Result<Self, Error> {
        let bytes = read_bytes(file, "the comparison's table (CSV)")?;
        let text = decompress(bytes).map_err(|reason| Error::Table {
            file: file.to_owned(),
            line: None,
            problem: format!("{reason}; write the table again"),
        })?;
        Self::parse(file, text)
    }

    fn parse(file: &Path, text: String) -> Result<Self, Error> {
        let first = text.lines().next().unwrap_or("").trim_start_matches('\u{feff}');
        let header: Vec<String> =
            first.split(',').map(|name| name.trim().trim_matches('"').to_owned()).collect();
        let table = Self { file: file.to_owned(), text, header };
        let mut seen = HashMap::new();
        for name in table.header.iter().filter(|name| !name.is_empty()) {
            if seen.insert(name.clone(), ()).is_some() {
                return Err(table.problem(Some(1), format!("two columns are called \"{name}\"; rename one")));
            }
        }
        if seen.is_empty() {
            return Err(table.problem(None, "is empty; its first line must name the columns"));
        }
        Ok(table)
    }

    /// The position of a column, or what to write instead.
    pub(super) fn column(&self, name: &str) -> Result<usize, String> {
        self.header.iter().position(|known| known == name).ok_or_else(|| {
            let known = self.header.iter().map(String::as_str);
            format!("\"{name}\" is no column of {}; {}", self.file.display(), suggest(name, known))
        })
    }

    /// Values of these columns; a row without one of them is left out and counted.
    pub(super) fn read(&self, numbers: &[usize], text: Option<usize>) -> Result<Columns, Error> {
        let mut out = Columns { numbers: vec![Vec::new(); numbers.len()], ..Columns::default() };
        let mut row = vec![0.0; numbers.len()];
        let mut cells: Vec<&str> = Vec::new();
        for (index, line) in self.text.lines().enumerate().skip(1) {
            if line.trim().is_empty() {
                continue;
            }
            cells.clear();
            cells.extend(line.split(',').map(|cell| cell.trim().trim_matches('"')));
            if cells.len() != self.header.len() {
                let problem = format!(
                    "has {} cells, the header {}; complete or remove the line",
                    cells.len(),
                    self.header.len()
                );
                return Err(self.problem(Some(index + 1), problem));
            }
            let mut complete = text.is_none_or(|column| !cells[column].is_empty());
            for (value, &column) in row.iter_mut().zip(numbers) {
                match number(cells[column]) {
                    Ok(Some(number)) => *value = number,
                    Ok(None) => complete = false,
                    Err(()) => {
                        let (name, cell) = (&self.header[column], cells[column]);
                        let problem = format!(
                            "{name} = \"{}\" is no finite number; correct it or leave the cell empty",
                            cell.chars().take(40).collect::<String>()
                        );
                        return Err(self.problem(Some(index + 1), problem));
                    }
                }
            }
            if !complete {
                out.incomplete += 1;
                continue;
            }
            for (column, value) in out.numbers.iter_mut().zip(&row) {
                column.push(*value);
            }
            out.texts.extend(text.map(|column| cells[column].to_owned()));
            out.lines.push(index + 1);
        }
        Ok(out)
    }

    /// A problem of this file.
    pub(super) fn problem(&self, line: Option<usize>, problem: impl Into<String>) -> Error {
        Error::Table { file: self.file.clone(), line, problem: problem.into() }
    }
}

/// A cell's number; nothing where it is empty or says that there is none.
fn number(cell: &str) -> Result<Option<f64>, ()> {
    if cell.is_empty() || ["nan", "na", "null"].iter().any(|none| cell.eq_ignore_ascii_case(none)) {
        return Ok(None);
    }
    cell.parse::<f64>().ok().filter(|value| value.is_finite()).map(Some).ok_or(())
}

fn decompress(bytes: Vec<u8>) -> Result<String, String> {
    let mut out = Vec::new();
    let read = match bytes.get(..4) {
        Some([0x1F, 0x8B, ..]) => {
            flate2::read::MultiGzDecoder::new(&bytes[..]).take(LARGEST_BYTES).read_to_end(&mut out)
        }
        Some([0x28, 0xB5, 0x2F, 0xFD]) => zstd::stream::read::Decoder::new(&bytes[..])
            .and_then(|decoder| decoder.take(LARGEST_BYTES).read_to_end(&mut out)),
        _ => {
            out = bytes;
            Ok(out.len())
        }
    };
    let length = read.map_err(|error| format!("cannot be decompressed: {error}"))?;
    if length as u64 >= LARGEST_BYTES {
        return Err("is larger than 4 GiB".to_owned());
    }
    String::from_utf8(out).map_err(|_| "is not UTF-8 text".to_owned())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::io::Write;

    use super::*;

    fn table(text: &str) -> Result<Table, Error> {
        Table::parse(Path::new("t.csv"), text.to_owned())
    }

    #[test]
    fn rows_without_a_value_are_left_out_and_counted() {
        let table = table("a,b,run\n1,2,x\n,3,x\n4,nan,y\n5,6,y\n\n").unwrap();
        let columns = table.read(&[1, 0], Some(2)).unwrap();
        assert_eq!(columns.numbers, [[2.0, 6.0], [1.0, 5.0]]);
        assert_eq!(columns.texts, ["x", "y"]);
        assert_eq!((columns.lines.as_slice(), columns.incomplete), ([2, 5].as_slice(), 2));
    }

    #[test]
    fn what_cannot_be_read_is_told_with_its_line() {
        let words = |text: &str| table(text).and_then(|t| t.read(&[0], None)).unwrap_err().to_string();
        assert!(words("a,b\n1,2\nx,2\n").starts_with("t.csv:3: a = \"x\" is no finite number"));
        assert!(words("a,b\n1,2\n1\n").starts_with("t.csv:3: has 1 cells, the header 2"));
        assert!(words("a,a\n").contains("two columns are called \"a\""));
        assert!(words("").contains("is empty"));
        let missing = table("tau1,tau2\n").unwrap().column("tau_1").unwrap_err();
        assert!(missing.contains("did you mean \"tau1\"?"), "{missing}");
    }

    #[test]
    fn compression_is_told_by_content() {
        let text = "a\n1\n";
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gzip.write_all(text.as_bytes()).unwrap();
        assert_eq!(decompress(gzip.finish().unwrap()).unwrap(), text);
        assert_eq!(decompress(zstd::encode_all(text.as_bytes(), 1).unwrap()).unwrap(), text);
        assert_eq!(decompress(text.as_bytes().to_vec()).unwrap(), text);
        assert!(decompress(vec![0x1F, 0x8B, 0, 0, 1]).unwrap_err().contains("decompressed"));
    }
}
