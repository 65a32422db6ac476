//! A matrix of numbers as shades.

use crate::escape::{number, short};
use crate::figure;
use crate::page::Part;
use crate::svg::{Canvas, Ink, text_width};

/// Rows and columns of numbers, each shaded by its size; positive and negative in two colours.
#[derive(Clone, Debug)]
pub struct Heat {
    title: String,
    remark: String,
    columns: Vec<String>,
    rows: Vec<(String, Vec<Option<f64>>)>,
    /// Size that is drawn darkest; the largest there is where none is given.
    full: Option<f64>,
}

impl Heat {
    /// A matrix with these columns.
    #[must_use]
    pub fn new(title: impl Into<String>, columns: impl IntoIterator<Item = String>) -> Self {
        let columns = columns.into_iter().collect();
        Self { title: title.into(), remark: String::new(), columns, rows: Vec::new(), full: None }
    }

    /// With a remark beside the title.
    #[must_use]
    pub fn remark(mut self, remark: impl Into<String>) -> Self {
        self.remark = remark.into();
        self
    }

    /// With the size that is drawn darkest.
    #[must_use]
    pub fn full(mut self, full: f64) -> Self {
        self.full = Some(full);
        self
    }

    /// With a row; a number that is absent leaves its place empty.
    pub fn row(&mut self, name: impl Into<String>, values: impl IntoIterator<Item = Option<f64>>) {
        self.rows.push((name.into(), values.into_iter().collect()));
    }

    fn draw(&self) -> String {
        let left = self.rows.iter().map(|(name, _)| text_width(&short(name, 28))).fold(0.0, f64::max) + 8.0;
        let widest = self.columns.iter().map(|name| text_width(&short(name, 14))).fold(52.0, f64::max) + 6.0;
        let (cell_height, top) = (26.0, 22.0);
        let all = self.rows.iter().flat_map(|(_, row)| row.iter().flatten()).filter(|v| v.is_finite());
        let full = self.full.unwrap_or_else(|| all.map(|v| v.abs()).fold(0.0, f64::max));
        let mut canvas = Canvas::default();
        for (k, name) in self.columns.iter().enumerate() {
            canvas.text((left + (k as f64 + 0.5) * widest, top - 7.0), &short(name, 14), "m c");
        }
        for (i, (name, values)) in self.rows.iter().enumerate() {
            let y = top + i as f64 * cell_height;
            canvas.text((left - 8.0, y + 17.0), &short(name, 28), "e");
            for (k, (column, value)) in self.columns.iter().zip(values).enumerate() {
                let x = left + k as f64 * widest;
                let Some(value) = value.filter(|v| v.is_finite()) else {
                    canvas.text((x + widest / 2.0, y + 17.0), "\u{2013}", "m c");
                    continue;
                };
                let ink = Ink::Series(usize::from(value < 0.0));
                let shade = if full > 0.0 { 0.7 * (value.abs() / full).min(1.0) } else { 0.0 };
                let words = format!("{name}, {column}: {}", number(value, 4));
                canvas.rect([x + 1.0, y + 1.0, widest - 2.0, cell_height - 2.0], &ink.fill(), shade, &words);
                canvas.text((x + widest / 2.0, y + 17.0), &number(value, 2), "c");
            }
        }
        let width = left + self.columns.len() as f64 * widest;
        // As large as it is drawn: a small matrix is not blown up to the page's width.
        let height = top + self.rows.len() as f64 * cell_height + 4.0;
        let drawing = canvas.finish(width, height, &self.title);
        format!("<div class=\"scroll\"><div style=\"width:{width:.0}px\">{drawing}</div></div>")
    }
}

impl Part for Heat {
    fn write(&self, out: &mut String) {
        figure::write(out, &self.title, &self.remark, &[], &self.draw());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_have_colours_and_absent_numbers_no_shade() {
        let mut heat = Heat::new("h", ["x".to_owned(), "y".to_owned(), "z".to_owned()]);
        heat.row("a", [Some(4.0), Some(-2.0), None]);
        let mut html = String::new();
        heat.write(&mut html);
        assert!(html.contains("class=\"f0\"") && html.contains("class=\"f1\""), "{html}");
        assert!(html.contains("opacity=\"0.70\"") && html.contains("opacity=\"0.35\""), "{html}");
        assert_eq!(html.matches("<rect").count(), 2);
    }
}
