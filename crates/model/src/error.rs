//! What keeps a URDF from becoming a chain with its sections, each as one message: where, what, and what to do.

use thiserror::Error;

/// Why no chain or section could be made of a URDF (names as in the file; SI).
#[derive(Debug, Clone, PartialEq, Error)]
pub enum UrdfError {
    /// The text is not XML, or not the XML of a URDF.
    #[error("{}: not a readable URDF: {reason}; correct the file there", place(file, *line))]
    Malformed {
        /// File as named by the caller.
        file: String,
        /// Line of the text, from 1, where it is known.
        line: Option<usize>,
        /// What the parser says.
        reason: String,
    },
    /// Base or tip is no link of the file.
    #[error(
        "{file}: the {role} link \"{name}\" does not exist{suggestion}; name a link of the URDF in [robot] {role}"
    )]
    UnknownLink {
        /// File as named by the caller.
        file: String,
        /// "base" or "tip".
        role: &'static str,
        /// The name that was asked for.
        name: String,
        /// The nearest name as ` (nearest: "x")`, or empty.
        suggestion: String,
    },
    /// The tip does not hang on the base.
    #[error(
        "{file}: base \"{base}\" is not an ancestor of tip \"{tip}\", whose ancestors are {ancestors}; choose a base among these, or another tip"
    )]
    NotAncestor {
        /// File as named by the caller.
        file: String,
        /// Name of the base link.
        base: String,
        /// Name of the tip link.
        tip: String,
        /// The links that the tip hangs on, from it to the root.
        ancestors: String,
    },
    /// Base and tip are one link.
    #[error("{file}: base and tip are both \"{link}\"; name two links with at least one joint between them")]
    SameLink {
        /// File as named by the caller.
        file: String,
        /// Name of the link.
        link: String,
    },
    /// Two elements of the same name, a link with two parents, a joint that names a link that is not there, or a loop.
    #[error("{file}: {what}; a URDF is a tree of uniquely named links and joints, correct it")]
    Structure {
        /// File as named by the caller.
        file: String,
        /// What is wrong with the tree.
        what: String,
    },
    /// A joint between base and tip is of a kind that the arm cannot have.
    #[error(
        "{file}: joint \"{joint}\" between base and tip is {kind}; only revolute, continuous and fixed joints are supported, choose base and tip so that it is not between them"
    )]
    Unsupported {
        /// File as named by the caller.
        file: String,
        /// Name of the joint.
        joint: String,
        /// Its kind, or "a mimic of ...".
        kind: String,
    },
    /// A number of a link or joint makes no sense.
    #[error("{file}: {element} \"{name}\" has {what}; correct it in the URDF")]
    Number {
        /// File as named by the caller.
        file: String,
        /// "link" or "joint".
        element: &'static str,
        /// Name of the link or joint.
        name: String,
        /// Which number and why not.
        what: String,
    },
    /// Gravity is not a vector of finite numbers.
    #[error("gravity is [{}, {}, {}] m/s^2; give three finite numbers in [robot] gravity", gravity_mps2[0], gravity_mps2[1], gravity_mps2[2])]
    Gravity {
        /// Gravity as given, base frame, m/s^2.
        gravity_mps2: [f64; 3],
    },
    /// A section names a joint that the chain lacks.
    #[error(
        "{file}: section \"{name}\" is no joint of the URDF{suggestion}; name a joint between base and tip"
    )]
    UnknownSection {
        /// File that the chain came from.
        file: String,
        /// The name that was asked for.
        name: String,
        /// The nearest name as ` (nearest: "x")`, or empty.
        suggestion: String,
    },
    /// A section names a joint that is not between base and tip.
    #[error(
        "joint \"{name}\" is in the URDF but not between base \"{base}\" and tip \"{tip}\", so it feels no wrench at the tip; name a joint between them"
    )]
    OffChain {
        /// Name of the joint.
        name: String,
        /// Name of the base link.
        base: String,
        /// Name of the tip link.
        tip: String,
    },
    /// A sensing axis without direction.
    #[error(
        "section \"{name}\" has the sensing axis {axis:?}, which has no direction; give three finite numbers that are not all zero, or leave axis out"
    )]
    SectionAxis {
        /// Name of the section's joint.
        name: String,
        /// The axis as given, child link's frame.
        axis: [f64; 3],
    },
}

/// "file:line", or the file alone.
fn place(file: &str, line: Option<usize>) -> String {
    line.map_or_else(|| file.to_owned(), |line| format!("{file}:{line}"))
}

/// ` (nearest: "x")` for the known name nearest to the one given, empty if there is none at all.
pub(crate) fn suggestion<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    known
        .map(|candidate| (strsim::damerau_levenshtein(name, candidate), candidate))
        .min_by_key(|(distance, _)| *distance)
        .map_or_else(String::new, |(_, nearest)| format!(" (nearest: \"{nearest}\")"))
}
