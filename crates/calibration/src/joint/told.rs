//! What the recordings told of the arm's numbers, and what would tell the rest, in words.

use super::Joint;
use super::parameters::Group;

/// A number of which so much of its prior's standard deviation is left was not told by the recordings.
const TOLD_TO: f64 = 0.7;

/// Numbers of one group that the recordings do not tell apart from others.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Untold {
    /// The group, as in the model's `admitted`.
    pub group: &'static str,
    /// Its numbers that are hardly better known than before.
    pub parameters: Vec<String>,
    /// What that means.
    pub words: &'static str,
    /// What would tell them.
    pub remedy: &'static str,
}

impl Joint {
    /// Whether the recordings told one of the arm's free numbers (its place among them).
    pub(super) fn is_told(&self, free: usize) -> bool {
        let width = self.parameters.list[self.solution.arm_free[free]].width;
        self.solution.arm_covariance[(free, free)].sqrt() <= TOLD_TO * width
    }

    /// What the recordings leave open, group by group.
    pub fn untold(&self) -> Vec<Untold> {
        let of =
            |group: &Group| {
                let names =
                    self.solution.arm_free.iter().enumerate().filter(|(k, index)| {
                        self.parameters.list[**index].group == *group && !self.is_told(*k)
                    });
                let parameters: Vec<String> =
                    names.map(|(_, index)| self.parameters.list[*index].name.clone()).collect();
                let (words, remedy) = words(*group);
                Untold { group: group.name(), parameters, words, remedy }
            };
        self.admitted.arm.iter().map(of).filter(|untold| !untold.parameters.is_empty()).collect()
    }
}

impl std::fmt::Display for Untold {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        /// More names than a person reads.
        const SHOWN: usize = 3;
        let names = self.parameters.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
        write!(f, "{}: {}: {names}", self.group, self.words)?;
        if let more @ 1.. = self.parameters.len().saturating_sub(SHOWN) {
            write!(f, " and {more} more (--json names them)")?;
        }
        write!(f, "; to tell them, {}", self.remedy)
    }
}

/// What it means that numbers of a group stay open, and what would tell them.
fn words(group: Group) -> (&'static str, &'static str) {
    match group {
        Group::LinkMasses => (
            "known only in sums with other links, gauges and zeros, which the wrench is computed with",
            "turn every joint through its whole range, bare and with weights, or weigh the links",
        ),
        Group::EncoderZeros => (
            "a joint that turns about the direction of gravity, or one whose zero looks like a placement, stays as it was",
            "tilt the base by some degrees, or push with a reference sensor in more poses",
        ),
        Group::JointFlexibility => (
            "never loaded enough to yield by what could be seen",
            "hang a heavier weight in poses in which it turns that joint",
        ),
        Group::BaseTilt => (
            "a lean that looks like the first joints' zeros",
            "measure it with a level, or turn the first joint through its whole range",
        ),
        Group::Weights => (
            "a weight's mass looks like the scale of all gauges",
            "weigh it, and hang another one of known mass",
        ),
        Group::Reference => (
            "no better known than its data sheet says",
            "push in all directions in more poses, or calibrate the reference sensor",
        ),
        Group::JointPlacement => (
            "known only in sums with zeros and the gauges' own axes, which the wrench is computed with",
            "hang weights and push with a reference sensor in more poses, or measure the arm",
        ),
    }
}
