//! The wrench that something other than the loads applies to the tip, over time.

use model::spatial::{Tip, Wrench};

/// Wrench on the tip (N, Nm; about E's origin, in E) over time: straight lines between instants, nothing outside them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Push {
    knots: Vec<(f64, Wrench<Tip>)>,
}

impl Push {
    /// Nothing pushes.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }

    /// Adds an instant (s) with its wrench (N, Nm, about E's origin, in E); one that is not after the last replaces it.
    pub fn knot(&mut self, t_s: f64, wrench: Wrench<Tip>) {
        if self.knots.last().is_some_and(|last| last.0 >= t_s) {
            self.knots.pop();
        }
        self.knots.push((t_s, wrench));
    }

    /// A wrench (N, Nm, in E) that grows during `ramp_s` from `from_s`, stays, and is gone again at `to_s`.
    pub fn trapezoid(&mut self, from_s: f64, to_s: f64, ramp_s: f64, wrench: Wrench<Tip>) {
        self.knot(from_s, Wrench::zero());
        self.knot(from_s + ramp_s, wrench);
        self.knot(to_s - ramp_s, wrench);
        self.knot(to_s, Wrench::zero());
    }

    /// The wrench at an instant (s): N and Nm about E's origin, in E.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Wrench<Tip> {
        let after = self.knots.partition_point(|knot| knot.0 <= t_s);
        let earlier = after.checked_sub(1).and_then(|index| self.knots.get(index));
        match (earlier, self.knots.get(after)) {
            (Some((from, a)), Some((to, b))) => {
                let part = (t_s - from) / (to - from);
                *a * (1.0 - part) + *b * part
            }
            _ => Wrench::zero(),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn straight_between_knots_and_nothing_outside() {
        let full = Wrench::new(Vector3::new(4.0, 0.0, -2.0), Vector3::new(0.0, 1.0, 0.0));
        let mut push = Push::none();
        push.trapezoid(1.0, 5.0, 1.0, full);
        assert_eq!(push.at(0.9), Wrench::zero());
        assert_eq!(push.at(1.25), full * 0.25);
        assert_eq!(push.at(3.0), full);
        assert_eq!(push.at(4.75), full * 0.25);
        assert_eq!(push.at(5.0), Wrench::zero());
    }
}
