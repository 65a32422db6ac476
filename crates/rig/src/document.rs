//! A TOML file read into a type, with errors that point at the line.

use std::path::Path;

use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};

use crate::error::{RigError, nearest};

/// One step from a document's root to a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Into a table, by key.
    Key(&'static str),
    /// Into an array, by position.
    Index(usize),
}

/// A value that parses but cannot be used, and where it stands in the document.
#[derive(Debug)]
pub struct Problem {
    /// The way to the value; a key that is absent stands for the table that lacks it.
    pub at: Vec<Step>,
    /// Fact, value and what to do.
    pub text: String,
}

impl Problem {
    /// A problem at the end of the way `at`.
    #[must_use]
    pub fn new(at: &[Step], text: impl Into<String>) -> Self {
        Self { at: at.to_vec(), text: text.into() }
    }
}

/// `text` as a `T`, for documents that say `format = 1`.
///
/// # Errors
/// The line of what is no TOML, no `T` or of another format.
pub fn parse<T: DeserializeOwned>(file: &Path, text: &str) -> Result<T, RigError> {
    let root = DeTable::parse(text).map_err(|error| of_toml(file, text, &error))?;
    check_format(file, text, root.get_ref())?;
    toml::from_str(text).map_err(|error| of_toml(file, text, &error))
}

/// `problem` as an error that names the line it is at.
#[must_use]
pub fn locate(file: &Path, text: &str, problem: Problem) -> RigError {
    match line_of(text, &problem.at) {
        Some(line) => RigError::at_line(file, line, problem.text),
        None => RigError::of_file(file, problem.text),
    }
}

fn check_format(file: &Path, text: &str, root: &DeTable<'_>) -> Result<(), RigError> {
    let Some(value) = root.get("format") else {
        return Err(RigError::of_file(file, "does not say which format it has; write format = 1 at the top"));
    };
    let is_one = value
        .get_ref()
        .as_integer()
        .is_some_and(|number| i64::from_str_radix(number.as_str(), number.radix()) == Ok(1));
    if is_one {
        return Ok(());
    }
    let found = text.get(value.span()).unwrap_or("?");
    let problem = format!(
        "format = {found} is not one that this version reads; it reads format = 1 (is the program too old?)"
    );
    Err(RigError::at_line(file, line_at(text, value.span().start), problem))
}

/// The line of the value at the end of `way`, or of the last table on the way that exists.
fn line_of(text: &str, way: &[Step]) -> Option<usize> {
    let root = DeTable::parse(text).ok()?;
    let (first, rest) = way.split_first()?;
    let Step::Key(key) = first else { return None };
    let (name, mut value) = root.get_ref().get_key_value(*key)?;
    let mut at = name.span().start;
    for step in rest {
        match (step, value.get_ref()) {
            (Step::Key(key), DeValue::Table(table)) => match table.get_key_value(*key) {
                Some((name, next)) => (at, value) = (name.span().start, next),
                None => break,
            },
            (Step::Index(index), DeValue::Array(items)) => match items.get(*index) {
                Some(next) => (at, value) = (next.span().start, next),
                None => break,
            },
            _ => break,
        }
    }
    Some(line_at(text, at))
}

fn line_at(text: &str, offset: usize) -> usize {
    text.as_bytes().iter().take(offset).filter(|byte| **byte == b'\n').count() + 1
}

fn of_toml(file: &Path, text: &str, error: &toml::de::Error) -> RigError {
    let message = in_words(error.message());
    let Some(span) = error.span() else { return RigError::of_file(file, message) };
    let line = line_at(text, span.start);
    let line_start = text.get(..span.start).and_then(|before| before.rfind('\n')).map_or(0, |at| at + 1);
    let content = text.get(line_start..).and_then(|rest| rest.lines().next()).unwrap_or("");
    let indent = text.get(line_start..span.start).map_or(0, |before| before.chars().count());
    let marked =
        text.get(span).and_then(|marked| marked.lines().next()).map_or(1, |marked| marked.chars().count());
    let gutter = " ".repeat(line.to_string().len());
    let caret = format!("{}{}", " ".repeat(indent), "^".repeat(marked.max(1)));
    RigError::at_line(file, line, format!("{message}\n{gutter} |\n{line} | {content}\n{gutter} | {caret}"))
}

/// The parser's message in the words of somebody who writes the file.
fn in_words(message: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    if message.starts_with("unknown field")
        && let Some(wrong) = quoted.next()
    {
        let known: Vec<&str> = quoted.collect();
        return match nearest(wrong, known.iter().copied()) {
            Some(name) => format!("unknown key \"{wrong}\"; did you mean \"{name}\"?"),
            None => format!("unknown key \"{wrong}\"; known here: {}", known.join(", ")),
        };
    }
    if message.starts_with("missing field")
        && let Some(name) = quoted.next()
    {
        return format!("the key \"{name}\" is missing; add it to this table");
    }
    message
        .replace("expected f64", "expected a number")
        .replace("expected a sequence", "expected an array")
        .replace("struct ", "a table of ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_lead_to_lines() {
        let text = "format = 1\n[a]\nb = 2\n[[c]]\nd = 1\n[[c]]\nd = { e = 4 }\n";
        let line = |way: &[Step]| line_of(text, way);
        assert_eq!(line(&[Step::Key("a"), Step::Key("b")]), Some(3));
        assert_eq!(line(&[Step::Key("a")]), Some(2));
        assert_eq!(line(&[Step::Key("a"), Step::Key("absent")]), Some(2));
        assert_eq!(line(&[Step::Key("c"), Step::Index(1)]), Some(6));
        assert_eq!(line(&[Step::Key("c"), Step::Index(1), Step::Key("d"), Step::Key("e")]), Some(7));
        assert_eq!(line(&[Step::Key("absent")]), None);
    }
}
