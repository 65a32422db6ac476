//! Charts over two axes: lines, dots and bands.

use crate::dots;
use crate::figure::{self, Mark};
use crate::page::Part;
use crate::scale::{Scale, extent};
use crate::svg::{Canvas, Ink, text_width};
use crate::trace::{Band, Trace};

/// How much room a chart takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// The page's width.
    Wide,
    /// One of several side by side.
    Small,
}

impl Size {
    /// Width and height of the drawing, px.
    #[must_use]
    pub fn px(self) -> (f64, f64) {
        match self {
            Self::Wide => (1060.0, 230.0),
            Self::Small => (334.0, 210.0),
        }
    }
}

#[derive(Clone, Debug)]
enum Data {
    Line(Trace),
    Dots(Vec<(f64, f64)>),
    Band(Band),
}

/// Series over two axes, each named with its unit.
#[derive(Clone, Debug)]
pub struct Chart {
    title: String,
    remark: String,
    x: String,
    y: String,
    size: Size,
    series: Vec<(String, Ink, Data)>,
    /// Levels of y to compare with, and places of x at which something changes, with their names.
    levels: Vec<f64>,
    places: Vec<(f64, String)>,
}

impl Chart {
    /// An empty chart; axes are named with quantity and unit.
    #[must_use]
    pub fn new(title: impl Into<String>, x: impl Into<String>, y: impl Into<String>, size: Size) -> Self {
        Self {
            title: title.into(),
            remark: String::new(),
            x: x.into(),
            y: y.into(),
            size,
            series: Vec::new(),
            levels: Vec::new(),
            places: Vec::new(),
        }
    }

    /// With a remark beside the title.
    #[must_use]
    pub fn remark(mut self, remark: impl Into<String>) -> Self {
        self.remark = remark.into();
        self
    }

    /// With a line.
    #[must_use]
    pub fn line(mut self, name: impl Into<String>, ink: Ink, trace: Trace) -> Self {
        self.series.push((name.into(), ink, Data::Line(trace)));
        self
    }

    /// With dots; those that others cover are left out.
    #[must_use]
    pub fn dots(mut self, name: impl Into<String>, ink: Ink, points: &[(f64, f64)]) -> Self {
        let (width, height) = self.size.px();
        self.series.push((name.into(), ink, Data::Dots(dots::thinned(points, width, height))));
        self
    }

    /// With an area behind the lines.
    #[must_use]
    pub fn band(mut self, name: impl Into<String>, ink: Ink, band: Band) -> Self {
        self.series.push((name.into(), ink, Data::Band(band)));
        self
    }

    /// With a thin line across at a value of y.
    #[must_use]
    pub fn level(mut self, y: f64) -> Self {
        self.levels.push(y);
        self
    }

    /// With a thin line upwards at a value of x, and what begins there.
    #[must_use]
    pub fn place(mut self, x: f64, name: impl Into<String>) -> Self {
        self.places.push((x, name.into()));
        self
    }

    fn extents(&self) -> ((f64, f64), (f64, f64)) {
        let both = |pairs: Vec<(f64, f64)>| extent(pairs.into_iter().flat_map(|(a, b)| [a, b]));
        let x = self.series.iter().map(|(_, _, data)| match data {
            Data::Line(trace) => trace.extent_x(),
            Data::Dots(points) => extent(points.iter().map(|p| p.0)),
            // A band has no place of its own: it goes with a line.
            Data::Band(_) => (f64::NAN, f64::NAN),
        });
        let y = self.series.iter().map(|(_, _, data)| match data {
            Data::Line(trace) => trace.extent_y(),
            Data::Dots(points) => extent(points.iter().map(|p| p.1)),
            Data::Band(band) => band.extent_y(),
        });
        let levels = self.levels.iter().map(|level| (*level, *level));
        (both(x.collect()), both(y.chain(levels).collect()))
    }

    fn draw(&self) -> String {
        let (width, height) = self.size.px();
        let (over_x, over_y) = self.extents();
        let y = Scale::new(over_y, 4).widened();
        let left = text_width(&y.longest_name()) + 10.0;
        let top = if self.places.is_empty() { 26.0 } else { 40.0 };
        let bottom = height - 36.0;
        let y = y.onto(bottom, top);
        let x = marked_within(over_x, width - left);
        // The last mark's name may stand out by half of itself.
        let right = width - text_width(&x.longest_name()) / 2.0 - 2.0;
        let x = x.onto(left + 4.0, right - 4.0);
        let mut canvas = Canvas::default();
        for mark in y.marks() {
            canvas.line((left, y.at(mark)), (right, y.at(mark)), "grid-line");
            canvas.text((left - 6.0, y.at(mark) + 4.0), &y.name(mark), "m e");
        }
        for mark in x.marks() {
            canvas.line((x.at(mark), bottom), (x.at(mark), bottom + 4.0), "axis");
            canvas.text((x.at(mark), bottom + 17.0), &x.name(mark), "m c");
        }
        canvas.line((left, bottom), (right, bottom), "axis");
        canvas.text((0.0, 12.0), &self.y, "m");
        canvas.text((right, height - 3.0), &self.x, "m e");
        self.draw_places(&mut canvas, &x, top, bottom, right);
        for level in &self.levels {
            canvas.line((left, y.at(*level)), (right, y.at(*level)), "axis");
        }
        for (_, ink, data) in &self.series {
            match data {
                Data::Band(band) => canvas.path(&band.path(&x, &y), &format!("band {}", ink.fill())),
                Data::Line(trace) => canvas.path(&trace.path(&x, &y), &format!("line {}", ink.stroke())),
                Data::Dots(points) => {
                    canvas.path(&dots::path(points, &x, &y), &format!("dots {}", ink.stroke()));
                }
            }
        }
        let words = format!("{}: {} over {}", self.title, self.y, self.x);
        canvas.finish(width, height, &words)
    }

    /// A name is left out where the one before reaches into it, or the drawing ends.
    fn draw_places(&self, canvas: &mut Canvas, x: &Scale, top: f64, bottom: f64, right: f64) {
        let mut free_from = f64::NEG_INFINITY;
        for (place, name) in &self.places {
            let at = x.at(*place);
            canvas.line((at, top), (at, bottom), "axis");
            if at >= free_from && at + 3.0 + text_width(name) <= right {
                canvas.text((at + 3.0, top - 4.0), name, "m");
                free_from = at + 3.0 + text_width(name);
            }
        }
    }
}

/// As many marks as there is room (px) for their names.
fn marked_within(over: (f64, f64), room_px: f64) -> Scale {
    const APART_PX: f64 = 14.0;
    let mut scales = (2..=10).rev().map(|marks| Scale::new(over, marks));
    let fits = |x: &Scale| {
        let name = text_width(&x.longest_name());
        x.marks().len() as f64 * (name + APART_PX) <= room_px - name
    };
    scales.find(fits).unwrap_or_else(|| Scale::new(over, 2))
}

impl Part for Chart {
    fn write(&self, out: &mut String) {
        let legend: Vec<_> = self
            .series
            .iter()
            .map(|(name, ink, data)| {
                let mark = match data {
                    Data::Line(_) => Mark::Line,
                    Data::Dots(_) => Mark::Dots,
                    Data::Band(_) => Mark::Area,
                };
                (name.clone(), *ink, mark)
            })
            .collect();
        figure::write(out, &self.title, &self.remark, &legend, &self.draw());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_without_data_is_still_a_chart() {
        let mut html = String::new();
        Chart::new("none", "t, s", "f, N", Size::Small).dots("d", Ink::Text, &[]).level(0.0).write(&mut html);
        assert!(html.contains("f, N") && html.contains("t, s") && !html.contains("NaN"), "{html}");
    }

    #[test]
    fn what_is_not_finite_is_never_drawn() {
        let points = [(0.0, f64::INFINITY), (1.0, 2.0), (f64::NAN, 1.0), (2.0, 4.0)];
        let mut html = String::new();
        let chart = Chart::new("a", "x", "y", Size::Wide).dots("d", Ink::Series(0), &points);
        chart.line("l", Ink::Series(9), Trace::of(&points)).place(1.0, "<here>").write(&mut html);
        assert!(!html.contains("NaN") && !html.contains("inf") && html.contains("&lt;here&gt;"), "{html}");
        assert!(html.contains("class=\"line s1\""), "the ninth colour is the first again but one: {html}");
    }
}
