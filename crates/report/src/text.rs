//! Headings, sentences and lists.

use crate::escape::escape;
use crate::page::Part;

/// A heading that begins a section, or a smaller one within.
#[derive(Clone, Debug)]
pub struct Heading {
    level: u8,
    text: String,
}

impl Heading {
    /// Begins a section.
    #[must_use]
    pub fn section(text: impl Into<String>) -> Self {
        Self { level: 2, text: text.into() }
    }

    /// Within a section.
    #[must_use]
    pub fn small(text: impl Into<String>) -> Self {
        Self { level: 3, text: text.into() }
    }
}

impl Part for Heading {
    fn write(&self, out: &mut String) {
        let (level, text) = (self.level, escape(&self.text));
        out.push_str(&format!("<h{level}>{text}</h{level}>\n"));
    }
}

/// Sentences.
#[derive(Clone, Debug)]
pub struct Text(String);

impl Text {
    /// One paragraph.
    #[must_use]
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

impl Part for Text {
    fn write(&self, out: &mut String) {
        out.push_str(&format!("<p>{}</p>\n", escape(&self.0)));
    }
}

/// Points one below the other.
#[derive(Clone, Debug)]
pub struct List(Vec<String>);

impl List {
    /// One point an entry; nothing is written for none.
    #[must_use]
    pub fn new(points: impl IntoIterator<Item = String>) -> Self {
        Self(points.into_iter().collect())
    }
}

impl Part for List {
    fn write(&self, out: &mut String) {
        if self.0.is_empty() {
            return;
        }
        out.push_str("<ul>\n");
        self.0.iter().for_each(|point| out.push_str(&format!("<li>{}</li>\n", escape(point))));
        out.push_str("</ul>\n");
    }
}
