//! Why a check did not hold, in words.

use std::fmt;
use std::path::Path;

/// What went wrong, ready to be read by a person. Any error converts into it with `?`.
pub struct Failure(String);

/// The outcome of a check or of a step towards one.
pub type Check<T = ()> = Result<T, Failure>;

impl Failure {
    /// A failure in these words.
    pub fn new(words: impl Into<String>) -> Self {
        Self(words.into())
    }

    /// The words.
    pub fn words(&self) -> &str {
        &self.0
    }
}

impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}

impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Names the file in an input or output error.
pub trait IoContext<T> {
    /// The same outcome, its error preceded by what was done to which file.
    fn at(self, deed: &str, path: &Path) -> Check<T>;
}

impl<T> IoContext<T> for std::io::Result<T> {
    fn at(self, deed: &str, path: &Path) -> Check<T> {
        self.map_err(|error| Failure::new(format!("cannot {deed} {}: {error}", path.display())))
    }
}

/// Returns a [`Failure`] in the words given unless the condition holds.
#[macro_export]
macro_rules! ensure {
    ($condition:expr, $($words:tt)+) => {
        if !$condition {
            return Err($crate::Failure::new(format!($($words)+)));
        }
    };
}
