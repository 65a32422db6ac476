//! From one number to another in steps: what each of several causes adds or takes.

use crate::escape::{number, short};
use crate::figure::{self, Mark};
use crate::page::Part;
use crate::scale::{Scale, extent};
use crate::svg::{Canvas, Ink, text_width};

const ROW_PX: f64 = 24.0;

/// Steps between two totals, one below the other.
#[derive(Clone, Debug)]
pub struct Waterfall {
    title: String,
    remark: String,
    unit: String,
    start: (String, f64),
    steps: Vec<(String, f64)>,
    end: String,
}

impl Waterfall {
    /// From a named total; the end is the total with all steps.
    #[must_use]
    pub fn new(
        title: impl Into<String>,
        unit: impl Into<String>,
        start: (impl Into<String>, f64),
        end: impl Into<String>,
    ) -> Self {
        Self {
            title: title.into(),
            remark: String::new(),
            unit: unit.into(),
            start: (start.0.into(), start.1),
            steps: Vec::new(),
            end: end.into(),
        }
    }

    /// With a remark beside the title.
    #[must_use]
    pub fn remark(mut self, remark: impl Into<String>) -> Self {
        self.remark = remark.into();
        self
    }

    /// With a step by so much.
    #[must_use]
    pub fn step(mut self, name: impl Into<String>, by: f64) -> Self {
        self.steps.push((name.into(), by));
        self
    }

    /// Name, where its bar begins and ends, and its colour.
    fn bars(&self) -> Vec<(&str, f64, f64, Ink)> {
        let mut level = self.start.1;
        let mut bars = vec![(self.start.0.as_str(), 0.0, level, Ink::Muted)];
        for (name, by) in &self.steps {
            bars.push((name, level, level + by, if *by < 0.0 { Ink::Series(2) } else { Ink::Series(7) }));
            level += by;
        }
        bars.push((&self.end, 0.0, level, Ink::Series(0)));
        bars
    }

    fn draw(&self) -> String {
        let bars = self.bars();
        let width = 640.0;
        let left = bars.iter().map(|(name, ..)| text_width(&short(name, 32))).fold(0.0, f64::max) + 8.0;
        let x = Scale::new(extent(bars.iter().flat_map(|b| [b.1, b.2])), 5).onto(left, width - 70.0);
        let bottom = bars.len() as f64 * ROW_PX;
        let mut canvas = Canvas::default();
        for mark in x.marks() {
            canvas.line((x.at(mark), 0.0), (x.at(mark), bottom), "grid-line");
            canvas.text((x.at(mark), bottom + 16.0), &x.name(mark), "m c");
        }
        canvas.text((width - 70.0, bottom + 31.0), &self.unit, "m e");
        for (k, (name, from, to, ink)) in bars.iter().enumerate() {
            let y = k as f64 * ROW_PX;
            let is_step = k > 0 && k + 1 < bars.len();
            let value = if is_step { to - from } else { *to };
            let sign = if is_step && value > 0.0 { "+" } else { "" };
            let said = format!("{sign}{}", number(value, 3));
            canvas.text((left - 8.0, y + 16.0), &short(name, 32), "e");
            let (a, b) = (x.at(from.min(*to)), x.at(from.max(*to)));
            let words = format!("{name}: {said} {}", self.unit);
            canvas.rect(
                [a, y + 4.0, (b - a).max(1.0), ROW_PX - 8.0],
                &format!("bar {}", ink.fill()),
                1.0,
                &words,
            );
            canvas.text((b + 5.0, y + 16.0), &said, "");
            if k + 1 < bars.len() {
                canvas.line((x.at(*to), y + ROW_PX - 4.0), (x.at(*to), y + ROW_PX + 4.0), "axis");
            }
        }
        canvas.finish(width, bottom + 38.0, &format!("{}, {}", self.title, self.unit))
    }
}

impl Part for Waterfall {
    fn write(&self, out: &mut String) {
        let legend = [
            ("takes".to_owned(), Ink::Series(2), Mark::Area),
            ("adds".to_owned(), Ink::Series(7), Mark::Area),
        ];
        figure::write(out, &self.title, &self.remark, &legend, &self.draw());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_lead_from_start_to_end() {
        let fall =
            Waterfall::new("gap", "N", ("before", 2.0), "after").step("gain", -1.5).step("drift", 0.25);
        let bars = fall.bars();
        let ends: Vec<(f64, f64)> = bars.iter().map(|b| (b.1, b.2)).collect();
        assert_eq!(ends, [(0.0, 2.0), (2.0, 0.5), (0.5, 0.75), (0.0, 0.75)]);
        let mut html = String::new();
        fall.write(&mut html);
        assert!(
            html.contains(">\u{2212}1.50<") && html.contains(">+0.250<") && html.contains(">0.750<"),
            "{html}"
        );
    }
}
