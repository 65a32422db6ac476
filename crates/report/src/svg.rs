//! A drawing in the making: a few SVG elements, with coordinates to a tenth of a pixel.

use std::fmt::Write;

use crate::escape::escape;

/// Colour of a line or an area, by what it is for; its shade follows the reader's light or dark mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ink {
    /// One of eight colours that can be told apart; higher numbers begin again.
    Series(usize),
    /// The text's own colour.
    Text,
    /// What stands back.
    Muted,
}

impl Ink {
    fn letter(self) -> char {
        match self {
            Self::Series(k) => char::from(b"01234567"[k % 8]),
            Self::Text => 'i',
            Self::Muted => 'm',
        }
    }

    /// Style class of a stroke.
    pub(crate) fn stroke(self) -> String {
        format!("s{}", self.letter())
    }

    /// Style class of an area.
    pub(crate) fn fill(self) -> String {
        format!("f{}", self.letter())
    }
}

/// Elements of one drawing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Canvas {
    body: String,
}

impl Canvas {
    /// The drawing of this size (px) with a description for those who cannot see it.
    pub(crate) fn finish(self, width: f64, height: f64, words: &str) -> String {
        format!(
            "<svg width=\"{width:.0}\" viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" aria-label=\"{}\">{}</svg>\n",
            escape(words),
            self.body
        )
    }

    pub(crate) fn line(&mut self, from: (f64, f64), to: (f64, f64), class: &str) {
        self.put(format_args!(
            "<path class=\"{class}\" d=\"M{:.1} {:.1}L{:.1} {:.1}\"/>",
            from.0, from.1, to.0, to.1
        ));
    }

    /// A path in SVG's own words.
    pub(crate) fn path(&mut self, d: &str, class: &str) {
        if !d.is_empty() {
            self.put(format_args!("<path class=\"{class}\" d=\"{d}\"/>"));
        }
    }

    /// A rectangle with something to read where the pointer rests on it.
    pub(crate) fn rect(&mut self, [x, y, width, height]: [f64; 4], class: &str, opacity: f64, words: &str) {
        self.put(format_args!(
            "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" opacity=\"{opacity:.2}\"><title>{}</title></rect>",
            width.max(0.0),
            height.max(0.0),
            escape(words)
        ));
    }

    pub(crate) fn circle(&mut self, (x, y): (f64, f64), radius: f64, class: &str) {
        self.put(format_args!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\"/>"));
    }

    /// Text whose class says where it is anchored (`e` end, `c` middle) and whether it stands back (`m`).
    pub(crate) fn text(&mut self, (x, y): (f64, f64), text: &str, class: &str) {
        self.put(format_args!("<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>", escape(text)));
    }

    fn put(&mut self, element: std::fmt::Arguments<'_>) {
        // Writing to memory cannot fail.
        let _ = self.body.write_fmt(element);
    }
}

/// Width of a text in the drawing's type, px: an upper estimate, for leaving room.
pub(crate) fn text_width(text: &str) -> f64 {
    7.3 * text.chars().count() as f64
}
