//! Things in space, drawn from a distance: an arm, its axes, whatever has a place.

use std::fmt::Write;

use crate::figure::{self, Mark};
use crate::labels;
use crate::page::Part;
use crate::svg::{Canvas, Ink};

/// How a line in space is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    /// Thick and pale: a body.
    Body,
    /// Plain.
    Plain,
    /// Thin and pale: something to go by.
    Thin,
    /// Dashed: what was meant to be.
    Dashed,
}

/// Lines and names in space, seen from a side without perspective, so that lengths compare.
#[derive(Clone, Debug)]
pub struct Scene {
    title: String,
    remark: String,
    width: f64,
    height: f64,
    turn_rad: f64,
    tilt_rad: f64,
    lines: Vec<(Vec<[f64; 3]>, Ink, Stroke)>,
    points: Vec<[f64; 3]>,
    names: Vec<([f64; 3], String)>,
    legend: Vec<(String, Ink, Mark)>,
    half_width_m: Option<f64>,
}

impl Scene {
    /// An empty scene of a size (px).
    #[must_use]
    pub fn new(title: impl Into<String>, width: f64, height: f64) -> Self {
        Self {
            title: title.into(),
            remark: String::new(),
            width,
            height,
            turn_rad: 0.9,
            tilt_rad: 0.35,
            lines: Vec::new(),
            points: Vec::new(),
            names: Vec::new(),
            legend: Vec::new(),
            half_width_m: None,
        }
    }

    /// With a remark beside the title.
    #[must_use]
    pub fn remark(mut self, remark: impl Into<String>) -> Self {
        self.remark = remark.into();
        self
    }

    /// Seen from this direction: turned about the vertical, then tilted down (rad).
    #[must_use]
    pub fn from_direction(mut self, turn_rad: f64, tilt_rad: f64) -> Self {
        (self.turn_rad, self.tilt_rad) = (turn_rad, tilt_rad);
        self
    }

    /// With a fixed scale about the origin: so many metres from the middle to the nearest edge, so that scenes compare.
    #[must_use]
    pub fn about_origin(mut self, half_width_m: f64) -> Self {
        self.half_width_m = Some(half_width_m);
        self
    }

    /// Adds a line through points (m).
    pub fn line(&mut self, points_m: &[[f64; 3]], ink: Ink, stroke: Stroke) {
        self.lines.push((points_m.to_vec(), ink, stroke));
    }

    /// Adds a dot (m).
    pub fn point(&mut self, point_m: [f64; 3]) {
        self.points.push(point_m);
    }

    /// Adds a name beside a point (m).
    pub fn name(&mut self, point_m: [f64; 3], name: impl Into<String>) {
        self.names.push((point_m, name.into()));
    }

    /// Adds an entry to the legend, for lines of this kind.
    pub fn explain(&mut self, name: impl Into<String>, ink: Ink, stroke: Stroke) {
        let mark = match stroke {
            Stroke::Dashed => Mark::Dashed,
            Stroke::Body => Mark::Area,
            Stroke::Plain | Stroke::Thin => Mark::Line,
        };
        self.legend.push((name.into(), ink, mark));
    }

    /// How far apart two points (m) appear from where the scene is seen, m.
    #[must_use]
    pub fn apparent_distance_m(&self, a: [f64; 3], b: [f64; 3]) -> f64 {
        let (a, b) = (self.flat(a), self.flat(b));
        (a.0 - b.0).hypot(a.1 - b.1)
    }

    /// To the right and up on the drawing, m.
    fn flat(&self, [x, y, z]: [f64; 3]) -> (f64, f64) {
        let (st, ct) = self.turn_rad.sin_cos();
        let (se, ce) = self.tilt_rad.sin_cos();
        let (right, away) = (ct * y - st * x, -(ct * x + st * y));
        (right, z * ce + away * se)
    }

    /// Takes metres on the drawing to pixels.
    fn to_px(&self) -> impl Fn((f64, f64)) -> (f64, f64) {
        let all: Vec<(f64, f64)> =
            self.lines.iter().flat_map(|(p, ..)| p).chain(&self.points).map(|p| self.flat(*p)).collect();
        let (x0, x1) = crate::scale::extent(all.iter().map(|p| p.0));
        let (y0, y1) = crate::scale::extent(all.iter().map(|p| p.1));
        let margin = 34.0;
        let (width, height) = (self.width, self.height);
        let fit = ((width - 2.0 * margin) / (x1 - x0)).min((height - 2.0 * margin) / (y1 - y0));
        let (scale, middle) = match self.half_width_m {
            Some(half) => (width.min(height) / (2.0 * half), (0.0, 0.0)),
            None => (fit, ((x0 + x1) / 2.0, (y0 + y1) / 2.0)),
        };
        let scale = if scale.is_finite() { scale } else { 1.0 };
        move |(x, y)| (width / 2.0 + (x - middle.0) * scale, height / 2.0 - (y - middle.1) * scale)
    }

    fn draw(&self) -> String {
        let px = self.to_px();
        let place = |p: [f64; 3]| px(self.flat(p));
        let mut canvas = Canvas::default();
        for (points, ink, stroke) in &self.lines {
            let mut d = String::new();
            for (k, point) in points.iter().map(|p| place(*p)).enumerate() {
                let _ = write!(d, "{}{:.1} {:.1}", if k == 0 { 'M' } else { 'L' }, point.0, point.1);
            }
            let style = match stroke {
                Stroke::Body => "line body",
                Stroke::Plain => "line axis3",
                Stroke::Thin => "line thin",
                Stroke::Dashed => "line dashed",
            };
            canvas.path(&d, &format!("{style} {}", ink.stroke()));
        }
        self.points.iter().for_each(|p| canvas.circle(place(*p), 3.0, "fi"));
        let lines: Vec<Vec<_>> =
            self.lines.iter().map(|(points, ..)| points.iter().map(|p| place(*p)).collect()).collect();
        let wanted: Vec<_> = self.names.iter().map(|(p, name)| (place(*p), name.clone())).collect();
        for ((x, y), (_, name)) in labels::place(&wanted, &lines, self.width, self.height).iter().zip(&wanted)
        {
            canvas.text((*x, *y), name, "");
        }
        canvas.finish(self.width, self.height, &self.title)
    }
}

impl Part for Scene {
    fn write(&self, out: &mut String) {
        figure::write(out, &self.title, &self.remark, &self.legend, &self.draw());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_is_up_and_lengths_compare() {
        let scene = Scene::new("s", 200.0, 200.0).from_direction(0.0, 0.0).about_origin(1.0);
        let px = scene.to_px();
        let at = |p: [f64; 3]| px(scene.flat(p));
        assert_eq!(at([0.0, 0.0, 0.5]), (100.0, 50.0));
        assert_eq!(at([0.0, 0.5, 0.0]), (150.0, 100.0), "seen along x, y goes to the right");
        assert_eq!(at([3.0, 0.0, 0.0]), (100.0, 100.0), "depth is not seen");
        let tilted = Scene::new("s", 200.0, 200.0).from_direction(0.3, 0.5);
        let (x, y) = tilted.flat([0.0, 0.0, 1.0]);
        assert!(x == 0.0 && (y - 0.5f64.cos()).abs() < 1e-15, "the vertical stays vertical");
        let ground = tilted.flat([1.0, 0.0, 0.0]);
        assert!(ground.1 < 0.0, "seen from above, what is nearer lies lower: {ground:?}");
    }

    #[test]
    fn an_empty_scene_and_one_of_a_single_point_are_drawn() {
        let mut html = String::new();
        let mut scene = Scene::new("s", 100.0, 100.0);
        scene.write(&mut html);
        scene.point([1.0, 1.0, 1.0]);
        scene.name([1.0, 1.0, 1.0], "<a>");
        scene.write(&mut html);
        assert!(!html.contains("NaN") && !html.contains("inf") && html.contains("&lt;a&gt;"), "{html}");
    }
}
