//! Tables.

use crate::escape::{escape, number};
use crate::page::Part;

/// What stands in one place of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Words, to the left.
    Words(String),
    /// A number with so many significant digits, to the right; a dash where there is none.
    Number(Option<f64>, usize),
    /// A number as text that is ready, to the right.
    Right(String),
    /// A number, marked as good (true) or bad.
    Judged(Option<f64>, usize, bool),
}

impl From<&str> for Cell {
    fn from(words: &str) -> Self {
        Self::Words(words.to_owned())
    }
}

impl From<String> for Cell {
    fn from(words: String) -> Self {
        Self::Words(words)
    }
}

/// Rows of cells under named columns.
#[derive(Clone, Debug)]
pub struct Table {
    caption: String,
    columns: Vec<(String, String)>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// A table with these columns: name and unit (may be empty).
    #[must_use]
    pub fn new(caption: impl Into<String>, columns: &[(&str, &str)]) -> Self {
        let columns = columns.iter().map(|(name, unit)| ((*name).to_owned(), (*unit).to_owned())).collect();
        Self { caption: caption.into(), columns, rows: Vec::new() }
    }

    /// Adds a row; missing cells stay empty.
    pub fn row(&mut self, cells: impl IntoIterator<Item = Cell>) {
        self.rows.push(cells.into_iter().collect());
    }

    /// A column is of words where its first cell is.
    fn is_words(&self, column: usize) -> bool {
        self.rows.first().and_then(|row| row.get(column)).is_none_or(|cell| matches!(cell, Cell::Words(_)))
    }
}

impl Part for Table {
    fn write(&self, out: &mut String) {
        out.push_str(&format!(
            "<div class=\"scroll\"><table><caption>{}</caption>\n<tr>",
            escape(&self.caption)
        ));
        for (k, (name, unit)) in self.columns.iter().enumerate() {
            let class = if self.is_words(k) { " class=\"l\"" } else { "" };
            let unit =
                if unit.is_empty() { String::new() } else { format!("<small>{}</small>", escape(unit)) };
            out.push_str(&format!("<th{class}>{}{unit}</th>", escape(name)));
        }
        out.push_str("</tr>\n");
        for row in &self.rows {
            out.push_str("<tr>");
            for cell in row {
                let show = |value: &Option<f64>, digits: &usize| number(value.unwrap_or(f64::NAN), *digits);
                out.push_str(&match cell {
                    Cell::Words(words) => format!("<td class=\"l\">{}</td>", escape(words)),
                    Cell::Right(text) => format!("<td>{}</td>", escape(text)),
                    Cell::Number(value, digits) => format!("<td>{}</td>", show(value, digits)),
                    Cell::Judged(value, digits, good) => {
                        format!(
                            "<td class=\"{}\">{}</td>",
                            if *good { "good" } else { "bad" },
                            show(value, digits)
                        )
                    }
                });
            }
            out.push_str("</tr>\n");
        }
        out.push_str("</table></div>\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_escaped_and_absent_numbers_are_dashes() {
        let mut table = Table::new("a < b", &[("gauge", ""), ("r", "counts/Nm")]);
        table.row([Cell::from("<s1>"), Cell::Number(Some(1234.56), 3)]);
        table.row([Cell::from("s2"), Cell::Judged(None, 3, false)]);
        let mut html = String::new();
        table.write(&mut html);
        assert!(
            html.contains("a &lt; b") && html.contains("<td class=\"l\">&lt;s1&gt;</td><td>1235</td>"),
            "{html}"
        );
        assert!(
            html.contains("<td class=\"bad\">\u{2013}</td>") && html.contains("<small>counts/Nm</small>"),
            "{html}"
        );
    }
}
