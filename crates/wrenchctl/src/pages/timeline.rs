//! Several recordings one after another on one axis of time.

use calibration::Recording;
use report::Chart;

/// Where each recording begins and how long all are, s.
#[derive(Clone, Debug)]
pub struct Timeline {
    starts: Vec<(i64, f64, String)>,
    length_s: f64,
    current: usize,
    last_s: f64,
}

impl Timeline {
    /// The recordings in their order.
    pub fn new<'a>(recordings: impl Iterator<Item = &'a Recording>) -> Self {
        let mut this = Self { starts: Vec::new(), length_s: 0.0, current: 0, last_s: f64::NEG_INFINITY };
        for recording in recordings {
            let name = std::path::Path::new(&recording.name).file_name();
            let name =
                name.map_or_else(|| recording.name.clone(), |name| name.to_string_lossy().into_owned());
            this.starts.push((recording.start_ns, this.length_s, name));
            let last = recording.len().checked_sub(1).map_or(0.0, |k| recording.time_s(k));
            this.length_s += last.max(0.0);
        }
        this
    }

    /// All of it, s.
    pub fn length_s(&self) -> f64 {
        self.length_s
    }

    /// A time of a recording (s from its first frame) on the common axis, s.
    pub fn at(&self, recording: usize, t_s: f64) -> f64 {
        self.starts.get(recording).map_or(t_s, |(_, from, _)| from + t_s)
    }

    /// Which recording an instant belongs to whose clock says `t_s`; instants come in the recordings' order.
    pub fn recording_of(&mut self, instant_ns: i64, t_s: f64) -> usize {
        let begins = |k: &usize| (instant_ns - self.starts[*k].0 - (t_s * 1e9) as i64).abs() < 1_000;
        // A clock that goes back is another recording's, even one of the same beginning.
        let from = self.current + usize::from(t_s < self.last_s);
        if let Some(found) = (from..self.starts.len()).find(begins) {
            self.current = found;
        }
        self.last_s = t_s;
        self.current
    }

    /// Name of the axis.
    pub fn axis(&self) -> &'static str {
        if self.starts.len() > 1 { "time, s (recordings one after another)" } else { "time, s" }
    }

    /// The chart with the recordings' beginnings, where there are several.
    pub fn mark(&self, mut chart: Chart) -> Chart {
        if self.starts.len() > 1 {
            for (_, from, name) in &self.starts {
                chart = chart.place(*from, name.clone());
            }
        }
        chart
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn instants_find_their_recording_even_where_one_is_given_twice() {
        let starts = [(1_000_000_000, 0.0), (1_000_000_000, 5.0), (9_000_000_000, 10.0)];
        let starts = starts.map(|(start_ns, from_s)| (start_ns, from_s, "run".to_owned())).to_vec();
        let mut line = Timeline { starts, length_s: 15.0, current: 0, last_s: f64::NEG_INFINITY };
        let mut found = Vec::new();
        for start_ns in [1_000_000_000, 1_000_000_000, 9_000_000_000] {
            for t_s in [0.5, 4.9] {
                found.push(line.recording_of(start_ns + (t_s * 1e9) as i64, t_s));
            }
        }
        assert_eq!(found, [0, 0, 1, 1, 2, 2]);
        assert_eq!(line.at(2, 1.0), 11.0);
    }
}
