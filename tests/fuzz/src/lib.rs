//! Every parser of bytes from outside, as a function of those bytes that panics where a promise is broken.
//!
//! cargo-fuzz runs them for hours (`tests/fuzz/run`), `tests/tests/fuzz.rs` for a moment each on a stable compiler. Each
//! says whether it accepted its input, so that a seed that is refused at once is noticed.

mod bus;
mod files;
mod network;

/// A target: whether the bytes were accepted.
pub type Target = fn(&[u8]) -> bool;

/// Every target by its name, which is also that of its corpus.
pub const TARGETS: [(&str, Target); 11] = [
    ("candump", bus::candump),
    ("dbc", bus::dbc),
    ("frames", bus::frames),
    ("urdf", files::urdf),
    ("config", files::config),
    ("model", files::model),
    ("run", files::run),
    ("comparison", files::comparison),
    ("rdt", network::rdt),
    ("http", network::http),
    ("control", network::control),
];

/// The target of this name.
///
/// # Panics
/// There is none.
#[must_use]
pub fn target(name: &str) -> Target {
    TARGETS.iter().find(|(known, _)| *known == name).expect("a name of the table").1
}
