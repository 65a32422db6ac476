//! Counters that boards put into their frames: what was lost, repeated, or began anew

/// What a counter says about the frame that carries it
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Step {
    /// The first frame
    First,
    /// The next frame
    Next,
    /// This many frames in between are missing
    Gap(u64),
    /// The counter did not move: a duplicate, or a board that stands still
    Repeated,
    /// A little behind: an older frame that was overtaken
    Behind,
    /// Elsewhere altogether: the board began anew
    Jump,
}

/// Totals since the start
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct SequenceCounts {
    /// Frames that advanced the counter
    pub advanced: u64,
    /// Frames that never came
    pub missing: u64,
    /// Frames with the same counter again
    pub repeated: u64,
    /// Frames that came too late
    pub behind: u64,
    /// New beginnings
    pub jumps: u64,
}

/// Follows one counter modulo its width
#[derive(Clone, Debug)]
pub struct Sequence {
    mask: u64,
    /// Steps forward up to this many are a gap
    max_gap: u64,
    /// Steps backward up to this many are frames that were overtaken
    max_behind: u64,
    last: Option<u64>,
    /// The last frame that was behind: if the next one follows it, the board began anew there
    candidate: Option<u64>,
    counts: SequenceCounts,
}

impl Sequence {
    /// A counter of this many bits
    pub fn new(bits: u8) -> Self {
        let bits = bits.clamp(1, 64);
        let mask = u64::MAX >> (64 - bits);
        let max_behind = if bits >= 4 { 4 } else { 0 };
        Self {
            mask,
            max_gap: (mask / 2).max(1),
            max_behind,
            last: None,
            candidate: None,
            counts: SequenceCounts::default(),
        }
    }

    /// Judges the next frame's counter
    pub fn observe(&mut self, raw: u64) -> Step {
        let raw = raw & self.mask;
        let step = self.judge(raw);
        match step {
            Step::First | Step::Next => self.counts.advanced += 1,
            Step::Gap(missing) => {
                self.counts.advanced += 1;
                self.counts.missing += missing;
            }
            Step::Repeated => self.counts.repeated += 1,
            Step::Behind => self.counts.behind += 1,
            Step::Jump => {
                self.counts.advanced += 1;
                self.counts.jumps += 1;
            }
        }
        match step {
            Step::Repeated => {}
            Step::Behind => self.candidate = Some(raw),
            _ => {
                self.last = Some(raw);
                self.candidate = None;
            }
        }
        step
    }

    fn judge(&self, raw: u64) -> Step {
        let Some(last) = self.last else { return Step::First };
        let ahead = raw.wrapping_sub(last) & self.mask;
        let behind = last.wrapping_sub(raw) & self.mask;
        if ahead == 0 {
            Step::Repeated
        } else if ahead == 1 {
            Step::Next
        } else if behind <= self.max_behind {
            let follows =
                self.candidate.is_some_and(|candidate| raw == candidate.wrapping_add(1) & self.mask);
            if follows { Step::Jump } else { Step::Behind }
        } else if ahead <= self.max_gap {
            Step::Gap(ahead - 1)
        } else {
            Step::Jump
        }
    }

    /// Forgets the last counter, keeps the totals
    pub fn restart(&mut self) {
        self.last = None;
        self.candidate = None;
    }

    /// Totals since the start
    pub fn counts(&self) -> SequenceCounts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(bits: u8, raws: &[u64]) -> Vec<Step> {
        let mut sequence = Sequence::new(bits);
        raws.iter().map(|&raw| sequence.observe(raw)).collect()
    }

    #[test]
    fn wraps_at_its_width() {
        use Step::*;
        assert_eq!(steps(8, &[254, 255, 0, 1]), [First, Next, Next, Next]);
        assert_eq!(steps(8, &[254, 1, 1, 0]), [First, Gap(2), Repeated, Behind]);
        assert_eq!(steps(1, &[0, 1, 1, 0]), [First, Next, Repeated, Next]);
        assert_eq!(steps(2, &[0, 2, 1]), [First, Jump, Jump], "two bits cannot tell gaps from reboots");
        assert_eq!(steps(64, &[u64::MAX, 0, 2]), [First, Next, Gap(1)]);
    }

    #[test]
    fn a_reboot_is_taken_up_again() {
        use Step::*;
        assert_eq!(
            steps(8, &[200, 0, 1]),
            [First, Gap(55), Next],
            "56 ahead modulo 256 cannot be told from a loss"
        );
        assert_eq!(steps(16, &[60000, 0, 1]), [First, Gap(5535), Next]);
        assert_eq!(steps(16, &[1000, 0, 1]), [First, Jump, Next]);
        assert_eq!(steps(8, &[3, 0, 1, 2]), [First, Behind, Jump, Next], "a few frames after power-up");
    }

    #[test]
    fn totals() {
        let mut sequence = Sequence::new(4);
        for raw in [0, 1, 4, 4, 3, 5] {
            sequence.observe(raw);
        }
        let expected = SequenceCounts { advanced: 4, missing: 2, repeated: 1, behind: 1, jumps: 0 };
        assert_eq!(sequence.counts(), expected);
    }
}
