//! A signal that comes late: what was simulated so long ago, less what is simulated now.

use super::*;

/// A signal that comes late: what was simulated so long ago, less what is simulated now.
pub(super) struct Delay;

impl Effect for Delay {
    fn id(&self) -> &'static str {
        "delay"
    }

    fn words(&self) -> &'static str {
        "a delay between simulation and measurement"
    }

    fn remedy(&self) -> &'static str {
        "correct the time stamps, or delay the simulation"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_time_or_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("s", "s")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        latenesses(session)
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let Some(time_s) = &session.time_s else { return Vec::new() };
        let mut values = vec![0.0; session.rows()];
        for rows in &session.segments {
            let mut after = rows.start;
            for row in rows.clone() {
                let wanted_s = time_s[row] - shape[0];
                while after < row && time_s[after] < wanted_s {
                    after += 1;
                }
                let before = after.saturating_sub(1).max(rows.start);
                let part = if after > before {
                    (wanted_s - time_s[before]) / (time_s[after] - time_s[before])
                } else {
                    0.0
                };
                let late =
                    own.simulated[before] + part.max(0.0) * (own.simulated[after] - own.simulated[before]);
                values[row] = late - own.simulated[row];
            }
        }
        vec![Column::pinned(channel, values)]
    }

    fn experiment(&self) -> &'static str {
        "motion of several frequencies up to the fastest: a delay and a lag differ there"
    }
}
