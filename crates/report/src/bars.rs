//! Bars side by side for a few things under several names, each with its value.

use crate::escape::{number, short};
use crate::figure::{self, Mark};
use crate::page::Part;
use crate::scale::{Scale, extent};
use crate::svg::{Canvas, Ink, text_width};

/// Height of a bar and the room between groups, px.
const BAR_PX: f64 = 15.0;
const BETWEEN_PX: f64 = 9.0;
/// Breadth of the drawing, px.
const BREADTH_PX: f64 = 500.0;

/// Groups of horizontal bars.
#[derive(Clone, Debug)]
pub struct Bars {
    title: String,
    remark: String,
    unit: String,
    series: Vec<String>,
    rows: Vec<(String, Vec<Option<f64>>)>,
}

impl Bars {
    /// Bars of `unit` for each of the series in each group.
    #[must_use]
    pub fn new(title: impl Into<String>, unit: impl Into<String>, series: &[&str]) -> Self {
        let series = series.iter().map(|name| (*name).to_owned()).collect();
        Self { title: title.into(), remark: String::new(), unit: unit.into(), series, rows: Vec::new() }
    }

    /// With a remark beside the title.
    #[must_use]
    pub fn remark(mut self, remark: impl Into<String>) -> Self {
        self.remark = remark.into();
        self
    }

    /// With a group: its name and a value for each series.
    #[must_use]
    pub fn row(mut self, name: impl Into<String>, values: &[Option<f64>]) -> Self {
        self.rows.push((name.into(), values.to_vec()));
        self
    }

    fn draw(&self) -> String {
        let values = self.rows.iter().flat_map(|(_, values)| values.iter().flatten().copied());
        let (low, high) = extent(values.chain([0.0]));
        let longest = self.rows.iter().map(|(name, _)| text_width(&short(name, 28))).fold(0.0, f64::max);
        // Values stand behind their bars.
        let (left, right) = (longest + 8.0, BREADTH_PX - 66.0);
        let x = Scale::new((low, high), 4).onto(left + if low < 0.0 { 58.0 } else { 0.0 }, right);
        let group = self.series.len() as f64 * BAR_PX + BETWEEN_PX;
        let height = self.rows.len() as f64 * group + 38.0;
        let bottom = height - 34.0;
        let mut canvas = Canvas::default();
        for mark in x.marks() {
            canvas.line((x.at(mark), 0.0), (x.at(mark), bottom), "grid-line");
            canvas.text((x.at(mark), bottom + 16.0), &x.name(mark), "m c");
        }
        canvas.text((right, bottom + 31.0), &self.unit, "m e");
        for (k, (name, values)) in self.rows.iter().enumerate() {
            let top = k as f64 * group + BETWEEN_PX / 2.0;
            let middle = top + (group - BETWEEN_PX) / 2.0 + 4.0;
            canvas.text((left - 8.0, middle), &short(name, 28), "e");
            for (i, series) in self.series.iter().enumerate() {
                let y = top + i as f64 * BAR_PX;
                let value = values.get(i).copied().flatten().filter(|v| v.is_finite());
                let from = x.at(0.0);
                let to = x.at(value.unwrap_or(0.0));
                let words =
                    format!("{name}, {series}: {} {}", number(value.unwrap_or(f64::NAN), 4), self.unit);
                let place = [from.min(to), y + 1.0, (to - from).abs(), BAR_PX - 2.0];
                canvas.rect(place, &format!("bar {}", Ink::Series(i).fill()), 1.0, &words);
                let said = number(value.unwrap_or(f64::NAN), 3);
                match value {
                    Some(v) if v < 0.0 => canvas.text((to - 5.0, y + 12.0), &said, "e"),
                    _ => canvas.text((to + 5.0, y + 12.0), &said, ""),
                }
            }
        }
        canvas.line((x.at(0.0), 0.0), (x.at(0.0), bottom), "axis");
        canvas.finish(BREADTH_PX, height, &format!("{}, {}", self.title, self.unit))
    }
}

impl Part for Bars {
    fn write(&self, out: &mut String) {
        let legend: Vec<_> = self
            .series
            .iter()
            .enumerate()
            .map(|(k, name)| (name.clone(), Ink::Series(k), Mark::Area))
            .collect();
        figure::write(out, &self.title, &self.remark, &legend, &self.draw());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_stands_at_its_bar_and_absent_ones_are_dashes() {
        let mut html = String::new();
        Bars::new("e", "N", &["a", "b"])
            .row("x", &[Some(2.5), None])
            .row("y", &[Some(-1.0), Some(0.0)])
            .write(&mut html);
        for said in [">2.50<", ">\u{2013}<", ">\u{2212}1.00<", ">0<", "x, a: 2.500 N"] {
            assert!(html.contains(said), "{said} is not in {html}");
        }
        assert!(!html.contains("width=\"-"), "{html}");
    }
}
