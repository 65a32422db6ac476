//! What is kept of a recording that is longer than memory should hold: fewer instants, evenly spread, decided while it is read.

use crate::recording::Recording;

/// Length of the stretches of [`Keep::Stretches`], ns: many times what a gauge or a joint remembers of its motion.
const STRETCH_NS: i64 = 60_000_000_000;

/// What is kept of a long recording. One within the limit is kept whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// Everything, however much it is.
    Everything,
    /// At most so many instants: all, or every second, fourth, eighth ... one. Every held pose and all slow histories (temperature, creep)
    /// stay, each with fewer readings; each reading stays as noisy as it was.
    Spread(usize),
    /// At most so many instants: all, or every second, fourth, eighth ... minute, and the first one whatever its length. Fast motion and
    /// what is periodic stay as they were read.
    Stretches(usize),
}

/// Decides instant by instant.
#[derive(Clone, Debug)]
pub(crate) struct Thinning {
    keep: Keep,
    /// One of so many is kept.
    every: usize,
    /// Instants met.
    met: usize,
}

impl Thinning {
    pub(crate) fn new(keep: Keep) -> Self {
        Self { keep, every: 1, met: 0 }
    }

    /// Whether the next instant is to be kept; makes room for it where there is none.
    pub(crate) fn admits(&mut self, recording: &mut Recording, at_ns: i64) -> bool {
        let number = match self.keep {
            Keep::Everything => return true,
            Keep::Spread(_) => self.met,
            Keep::Stretches(_) => stretch(recording, at_ns),
        };
        self.met += 1;
        while number.is_multiple_of(self.every) && number > 0 && recording.len() >= self.limit() {
            self.every *= 2;
            self.thin(recording);
        }
        number.is_multiple_of(self.every)
    }

    /// What became of the recording, for a person; `None` where all of it is there.
    pub(crate) fn words(&self, recording: &Recording) -> Option<String> {
        let unit = match self.keep {
            Keep::Stretches(_) => "minute",
            _ => "instant",
        };
        (self.every > 1).then(|| {
            format!(
                "{}: too long to be held in memory as a whole, one {unit} of {} is used ({} instants); cut the log to have another part of it",
                recording.name,
                self.every,
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
            Keep::Stretches(_) => stretch(recording, recording.at_ns[k]).is_multiple_of(self.every),
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
}

fn stretch(recording: &Recording, at_ns: i64) -> usize {
    usize::try_from((at_ns - recording.start_ns) / STRETCH_NS).unwrap_or(0)
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
        let minutes: Vec<i64> = recording.at_ns.iter().map(|t| t / STRETCH_NS).collect();
        assert!(minutes.iter().all(|minute| minute % 8 == 0), "one of eight");
        assert_eq!(recording.len(), 75 * 600);
        // The first minute is kept although it is too much, and the memory with it is bounded.
        assert_eq!(read(Keep::Stretches(100), 360_000, 100_000_000).len(), 600);
    }
}
