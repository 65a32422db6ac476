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

/// Where the longest bar is so many times the shortest, the shorter ones could not be told apart: the axis is a logarithmic one.
const LOGARITHMIC_FROM: f64 = 50.0;

/// The axis of the bars, linear in a value or in its decimal logarithm.
struct Axis {
    scale: Scale,
    logarithmic: bool,
}

impl Axis {
    fn new(values: &[f64], left: f64, right: f64) -> Self {
        let (low, high) = extent(values.iter().copied());
        let logarithmic = low > 0.0 && high >= LOGARITHMIC_FROM * low;
        if logarithmic {
            // A whole decade below the shortest bar or a part of it, so that it has a length.
            let scale = Scale::new(((0.7 * low).log10().floor(), high.log10()), 4).onto(left, right);
            return Self { scale, logarithmic };
        }
        let (low, high) = extent(values.iter().copied().chain([0.0]));
        let left = left + if low < 0.0 { 58.0 } else { 0.0 };
        Self { scale: Scale::new((low, high), 4).onto(left, right), logarithmic }
    }

    /// Where a value is drawn, px.
    fn at(&self, value: f64) -> f64 {
        self.scale.at(if self.logarithmic { value.log10() } else { value })
    }

    /// Where bars begin, px.
    fn begin(&self) -> f64 {
        if self.logarithmic { self.scale.at_low() } else { self.scale.at(0.0) }
    }

    /// Places (px) and names of the marks.
    fn marks(&self) -> Vec<(f64, String)> {
        let marks = self.scale.marks().into_iter();
        if self.logarithmic {
            // Whole decades only.
            let whole = marks.filter(|m| (m - m.round()).abs() < 1e-6);
            return whole.map(|m| (self.scale.at(m), decade(m.round() as i32))).collect();
        }
        marks.map(|m| (self.scale.at(m), self.scale.name(m))).collect()
    }
}

/// A power of ten as a mark is called.
fn decade(power: i32) -> String {
    match power {
        0..=6 => format!("{:.0}", 10f64.powi(power)),
        -4..0 => format!("{:.*}", power.unsigned_abs() as usize, 10f64.powi(power)),
        _ => format!("1e{power}").replace('-', "\u{2212}"),
    }
}

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
        let values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
        let longest = self.rows.iter().map(|(name, _)| text_width(&short(name, 28))).fold(0.0, f64::max);
        // Values stand behind their bars.
        let (left, right) = (longest + 8.0, BREADTH_PX - 66.0);
        let x = Axis::new(&values, left, right);
        let group = self.series.len() as f64 * BAR_PX + BETWEEN_PX;
        let height = self.rows.len() as f64 * group + 38.0;
        let bottom = height - 34.0;
        let mut canvas = Canvas::default();
        for (at, name) in x.marks() {
            canvas.line((at, 0.0), (at, bottom), "grid-line");
            canvas.text((at, bottom + 16.0), &name, "m c");
        }
        let kind = if x.logarithmic { ", logarithmic" } else { "" };
        canvas.text((right, bottom + 31.0), &format!("{}{kind}", self.unit), "m e");
        for (k, (name, values)) in self.rows.iter().enumerate() {
            let top = k as f64 * group + BETWEEN_PX / 2.0;
            let middle = top + (group - BETWEEN_PX) / 2.0 + 4.0;
            canvas.text((left - 8.0, middle), &short(name, 28), "e");
            for (i, series) in self.series.iter().enumerate() {
                let y = top + i as f64 * BAR_PX;
                let value = values.get(i).copied().flatten().filter(|v| v.is_finite());
                let from = x.begin();
                let to = value.map_or(from, |v| x.at(v));
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
        canvas.line((x.begin(), 0.0), (x.begin(), bottom), "axis");
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
        assert!(!html.contains("logarithmic"), "{html}");
    }

    #[test]
    fn what_is_a_hundred_times_smaller_has_a_bar_to_see() {
        let axis = Axis::new(&[0.3, 120.0, 12.0], 40.0, 440.0);
        assert!(axis.logarithmic && axis.at(0.3) - axis.begin() > 20.0 && axis.at(120.0) <= 440.0);
        let names: Vec<String> = axis.marks().into_iter().map(|(_, name)| name).collect();
        assert_eq!(names, ["0.1", "1", "10", "100"]);
        assert!(!Axis::new(&[0.0, 120.0], 40.0, 440.0).logarithmic, "nothing has no logarithm");
    }
}
