//! The status byte that goes out with every wrench.

use std::fmt;

/// Eight flags; none set: all good. The bits are the wire format's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status(u8);

impl Status {
    /// Nothing to report.
    pub const GOOD: Self = Self(0);
    /// Do not use this wrench.
    pub const INVALID: Self = Self(1);
    /// A gauge is left out.
    pub const DEGRADED: Self = Self(1 << 1);
    /// A gauge is beyond its range (and left out).
    pub const SATURATED: Self = Self(1 << 2);
    /// An input is older than it should be.
    pub const STALE: Self = Self(1 << 3);
    /// Pose, motion or calibration leave a direction poorly known.
    pub const UNCERTAIN: Self = Self(1 << 4);
    /// The spare gauges disagree.
    pub const PARITY: Self = Self(1 << 5);
    /// A tare is applied.
    pub const TARED: Self = Self(1 << 6);

    /// The byte on the wire.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// From the byte on the wire.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// These flags and those.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether any of the flags of `other` is set.
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

/// Names of the flags from bit 0 up.
const NAMES: [&str; 8] =
    ["invalid", "degraded", "saturated", "stale", "uncertain", "parity", "tared", "reserved"];

impl Status {
    /// Names of the flags that are set; "good" where none is.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        let set = (0..8).filter(move |bit| self.0 & (1 << bit) != 0).map(|bit| NAMES[bit]);
        set.chain((self.0 == 0).then_some("good"))
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, name) in self.names().enumerate() {
            f.write_str(if k > 0 { "+" } else { "" })?;
            f.write_str(name)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_its_flags() {
        assert_eq!(Status::GOOD.to_string(), "good");
        assert_eq!(Status::INVALID.with(Status::STALE).to_string(), "invalid+stale");
        assert_eq!(Status::from_bits(34).to_string(), "degraded+parity");
    }
}
