//! The page and what stands on it.

use crate::escape::escape;

/// Something on a page; it writes its own HTML and escapes every text in it.
pub trait Part {
    /// Appends the part's HTML.
    fn write(&self, out: &mut String);
}

/// One page: a title, a line about what it is of, and parts from top to bottom.
pub struct Page {
    title: String,
    subtitle: String,
    parts: Vec<Box<dyn Part>>,
}

impl Page {
    /// A page without parts.
    #[must_use]
    pub fn new(title: impl Into<String>, subtitle: impl Into<String>) -> Self {
        Self { title: title.into(), subtitle: subtitle.into(), parts: Vec::new() }
    }

    /// Adds a part at the bottom.
    pub fn add(&mut self, part: impl Part + 'static) {
        self.parts.push(Box::new(part));
    }

    /// The whole document.
    #[must_use]
    pub fn html(&self) -> String {
        let (title, subtitle) = (escape(&self.title), escape(&self.subtitle));
        // The policy forbids what the page does not need anyway, should a text ever get through unescaped.
        let mut out = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n<style>\n{}</style>\n</head>\n\
             <body>\n<main>\n<h1>{title}</h1>\n<p class=\"subtitle\">{subtitle}</p>\n",
            include_str!("style.css")
        );
        self.parts.iter().for_each(|part| part.write(&mut out));
        out.push_str("</main>\n</body>\n</html>\n");
        out
    }
}

/// Parts side by side, as many in a row as the window is wide.
#[derive(Default)]
pub struct Grid {
    parts: Vec<Box<dyn Part>>,
    broad: bool,
}

impl Grid {
    /// For parts that are broader than small charts: two in a row of a large window.
    #[must_use]
    pub fn broad() -> Self {
        Self { parts: Vec::new(), broad: true }
    }

    /// Adds a part.
    #[must_use]
    pub fn with(mut self, part: impl Part + 'static) -> Self {
        self.parts.push(Box::new(part));
        self
    }
}

impl Part for Grid {
    fn write(&self, out: &mut String) {
        let class = if self.broad { "grid broad" } else { "grid" };
        out.push_str(&format!("<div class=\"{class}\">\n"));
        self.parts.iter().for_each(|part| part.write(out));
        out.push_str("</div>\n");
    }
}
