//! What is kept of a recording that is longer than memory should hold: fewer instants, evenly spread, decided while it is read.

use crate::recording::Recording;

/// Greatest length of the stretches of [`Keep::Stretches`], ns.
const LONGEST_NS: i64 = 60_000_000_000;

/// Least length of them where there is room for it, ns: many times what a gauge or a joint remembers of its motion.
const SHORTEST_NS: i64 = 2_000_000_000;

/// So many stretches show more of what an arm does than fewer longer ones.
const ENOUGH: usize = 8;

/// What is kept of a long recording. One within the limit is kept whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// Everything, however much it is.
    Everything,
    /// At most so many instants: all, or every second, fourth, eighth ... one. Every held pose and all slow histories (temperature, creep)
    /// stay, each with fewer readings; each reading stays as noisy as it was.
    Spread(usize),
    /// At most so many instants: all, or stretches of a minute, half a minute, ... evenly spread. Fast motion and what is periodic stay as they
    /// were read.
    Stretches(usize),
}

/// Decides instant by instant.
#[derive(Clone, Debug)]
pub(crate) struct Thinning {
    keep: Keep,
    /// One of so many is kept.
    every: usize,
    /// Length of a stretch, ns.
    stretch_ns: i64,
    /// Instants met.
    met: usize,
}

impl Thinning {
    pub(crate) fn new(keep: Keep) -> Self {
        Self { keep, every: 1, stretch_ns: LONGEST_NS, met: 0 }
    }

    /// Whether the next instant is to be kept; makes room for it where there is none.
    pub(crate) fn admits(&mut self, recording: &mut Recording, at_ns: i64) -> bool {
        let met = self.met;
        self.met += 1;
        while self.is_one(recording, met, at_ns) && recording.len() >= self.limit() {
            if !self.halve(recording, at_ns) {
                return false;
            }
        }
        self.is_one(recording, met, at_ns)
    }

    /// Whether an instant, met as this one, is of those that are kept.
    fn is_one(&self, recording: &Recording, met: usize, at_ns: i64) -> bool {
        let number = match self.keep {
            Keep::Everything => return true,
            Keep::Spread(_) => met,
            Keep::Stretches(_) => self.stretch(recording, at_ns),
        };
        number.is_multiple_of(self.every)
    }

    /// Takes away half of what is kept: of minutes the second halves, until they are short, then every second one. False where nothing can be.
    fn halve(&mut self, recording: &mut Recording, at_ns: i64) -> bool {
        if matches!(self.keep, Keep::Stretches(_)) {
            let before = self.stretch(recording, at_ns) / self.every;
            let may_be_shorter = before < ENOUGH && self.stretch_ns / 2 >= SHORTEST_NS;
            if before == 0 && self.stretch_ns < 2 {
                return false;
            }
            if before == 0 || may_be_shorter {
                self.stretch_ns /= 2;
            }
        }
        self.every *= 2;
        self.thin(recording);
        true
    }

    /// What became of the recording, for a person; `None` where all of it is there.
    pub(crate) fn words(&self, recording: &Recording) -> Option<String> {
        let part = match self.keep {
            Keep::Stretches(_) => {
                let length_s = self.stretch_ns as f64 * 1e-9;
                format!("{length_s:.3} s of every {:.3} s are", length_s * self.every as f64)
            }
            _ => format!("one instant of {} is", self.every),
        };
        (self.every > 1).then(|| {
            format!(
                "{}: too long to be held in memory as a whole, {part} used ({} instants); cut the log to have another part of it",
                recording.name,
                recording.len()
            )
        })
    }

    fn limit(&self) -> usize {
        match self.keep {
            Keep::Everything => usize::MAX,
            Keep::Spread(most) | Keep::Stretches(most) => most.max(1),
        }
    }

    /// Takes away what is no longer one of so many.
    fn thin(&self, recording: &mut Recording) {
        let stays = |k: usize| match self.keep {
            Keep::Stretches(_) => self.is_one(recording, k, recording.at_ns[k]),
            // All that are there were one of half as many.
            _ => k.is_multiple_of(2),
        };
        let stays: Vec<bool> = (0..recording.len()).map(stays).collect();
        retain(&mut recording.at_ns, &stays);
        retain(&mut recording.sampled, &stays);
        recording.positions_rad.iter_mut().for_each(|column| retain(column, &stays));
        recording.velocities_rad_s.iter_mut().for_each(|column| retain(column, &stays));
        recording.counts.iter_mut().for_each(|column| retain(column, &stays));
        recording.temperatures_c.iter_mut().for_each(|column| retain(column, &stays));
    }

    fn stretch(&self, recording: &Recording, at_ns: i64) -> usize {
        usize::try_from((at_ns - recording.start_ns) / self.stretch_ns).unwrap_or(0)
    }
}

/// Keeps what stays; a column that is not read at every instant is no use and becomes empty.
fn retain<T>(column: &mut Vec<T>, stays: &[bool]) {
    if column.len() != stays.len() {
        return column.clear();
    }
    let mut stays = stays.iter();
    column.retain(|_| stays.next().copied().unwrap_or(false));
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::motion::Sampled;

    /// Instants `step_ns` apart, as far as they are kept; what is read at each is its number.
    fn read(keep: Keep, instants: i64, step_ns: i64) -> Recording {
        let mut recording = Recording {
            name: "run".to_owned(),
            session: String::new(),
            start_ns: 0,
            end_ns: 0,
            at_ns: Vec::new(),
            sampled: Vec::new(),
            positions_rad: vec![Vec::new(); 2],
            velocities_rad_s: vec![Vec::new(); 2],
            counts: vec![Vec::new(); 2],
            temperatures_c: vec![Vec::new(); 2],
            loads: Default::default(),
            excludes: Vec::new(),
            reference: None,
            met: Default::default(),
            thinned: None,
        };
        let mut thinning = Thinning::new(keep);
        for k in 0..instants {
            if thinning.admits(&mut recording, k * step_ns) {
                recording.at_ns.push(k * step_ns);
                recording.sampled.push(Sampled { at_ns: k * step_ns, walked_s2: 0.0, scatter_s: 0.0 });
                recording.positions_rad.iter_mut().for_each(|column| column.push(k as f64));
                // The second joint's velocity is missing once.
                recording.velocities_rad_s[0].push(k as f64);
                recording.velocities_rad_s[1].extend((k != 2).then_some(k as f64));
                recording.counts.iter_mut().for_each(|column| column.push(Some(k as f64)));
                recording.temperatures_c.iter_mut().for_each(|column| column.push(None));
            }
        }
        recording.thinned = thinning.words(&recording);
        let n = recording.len();
        assert!(recording.at_ns.is_sorted() && recording.sampled.len() == n);
        assert!(recording.positions_rad.iter().chain(&recording.velocities_rad_s[..1]).all(|c| c.len() == n));
        assert!(recording.velocities_rad_s[1].len() < n);
        assert!(recording.counts.iter().chain(&recording.temperatures_c).all(|c| c.len() == n));
        assert!(
            recording.at_ns.iter().zip(&recording.counts[1]).all(|(t, c)| *c == Some((t / step_ns) as f64))
        );
        recording
    }

    #[test]
    fn a_recording_within_the_limit_is_whole() {
        for keep in [Keep::Everything, Keep::Spread(1000), Keep::Stretches(1000)] {
            let recording = read(keep, 1000, 1_000_000_000);
            assert_eq!((recording.len(), &recording.thinned), (1000, &None), "{keep:?}");
        }
    }

    #[test]
    fn a_longer_one_is_spread_evenly() {
        let recording = read(Keep::Spread(1000), 5001, 20_000_000);
        assert!(recording.at_ns.windows(2).all(|pair| pair[1] - pair[0] == 8 * 20_000_000));
        assert_eq!(recording.len(), 5001usize.div_ceil(8));
        let words = recording.thinned.unwrap();
        assert!(words.contains("one instant of 8 is used (626 instants)"), "{words}");
    }

    #[test]
    fn whole_minutes_of_a_longer_one_are_kept() {
        // Ten hours at 10 Hz: 600 minutes of 600 instants, of which room is for a hundred.
        let recording = read(Keep::Stretches(60_000), 360_000, 100_000_000);
        let minutes: Vec<i64> = recording.at_ns.iter().map(|t| t / LONGEST_NS).collect();
        assert!(minutes.iter().all(|minute| minute % 8 == 0), "one of eight");
        assert_eq!(recording.len(), 75 * 600);
    }

    #[test]
    fn where_few_minutes_have_room_shorter_stretches_show_all_of_it() {
        // Six minutes at 1000 Hz, of which there is room for thirteen seconds.
        let recording = read(Keep::Stretches(13_000), 360_000, 1_000_000);
        assert!((6_500..=13_000).contains(&recording.len()), "{}", recording.len());
        let begins: Vec<i64> = (0..recording.len())
            .filter(|k| *k == 0 || recording.at_ns[*k] - recording.at_ns[k - 1] > 1_000_000)
            .map(|k| recording.at_ns[k])
            .collect();
        assert!(
            begins.len() >= 3 && begins.windows(2).all(|pair| pair[1] - pair[0] == begins[1]),
            "{begins:?}"
        );
        assert!(recording.at_ns.last().unwrap() > &200_000_000_000);
        // A limit is one, however short the stretches become for it.
        for limit in [100, 7] {
            let recording = read(Keep::Stretches(limit), 360_000, 100_000_000);
            assert!((1..=limit).contains(&recording.len()), "{limit}: {}", recording.len());
        }
    }
}
