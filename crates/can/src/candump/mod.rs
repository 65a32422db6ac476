//! The candump log format (`candump -L`): lines to frames and back, from and to plain, gzip and zstd files

mod ahead;
mod format;
mod parse;
mod reader;
mod writer;

pub use ahead::ReadAhead;
pub use format::{MAX_LINE, StampDigits, format_line};
pub use parse::{Line, LineFault, parse_line};
pub use reader::{LogCounts, LogEvent, LogReader};
pub use writer::LogWriter;

/// Names of CAN interfaces, in the order of their indices
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Interfaces {
    names: Vec<String>,
    learn: bool,
}

impl Interfaces {
    /// A fixed list, as configured: frames of others are foreign. At most 255 are kept.
    pub fn fixed<S: AsRef<str>>(names: &[S]) -> Self {
        Self { names: names.iter().take(255).map(|name| name.as_ref().to_string()).collect(), learn: false }
    }

    /// A list that grows with every new name that a log has
    pub fn learned() -> Self {
        Self { names: Vec::new(), learn: true }
    }

    /// Names by index
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Name of an index, `?` where there is none
    pub fn name(&self, index: u8) -> &str {
        self.names.get(usize::from(index)).map_or("?", String::as_str)
    }

    /// Index of a name
    pub fn find(&self, name: &[u8]) -> Option<u8> {
        self.names.iter().position(|known| known.as_bytes() == name).map(|index| index as u8)
    }

    fn find_or_learn(&mut self, name: &[u8]) -> Option<u8> {
        if let Some(index) = self.find(name) {
            return Some(index);
        }
        if !self.learn || self.names.len() >= 255 {
            return None;
        }
        self.names.push(String::from_utf8_lossy(name).into_owned());
        Some((self.names.len() - 1) as u8)
    }
}
