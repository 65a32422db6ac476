//! Whether the published wrench agrees with the truth, by its own standard deviations.

use std::collections::VecDeque;

use nalgebra::Vector6;

/// How much of the end counts, ns.
const WINDOW_NS: i64 = 10_000_000_000;

/// RMS of error over reported standard deviation up to which a component agrees.
pub(super) const LIMIT_SIGMA: f64 = 3.0;

/// Share of the records that must have a wrench.
pub(super) const LEAST_VALID: f64 = 0.9;

/// Squares of one instant.
#[derive(Clone, Copy)]
struct Squares {
    instant_ns: i64,
    /// (error / sigma)^2
    normalised: Vector6<f64>,
    /// error^2, N^2 and Nm^2
    plain: Vector6<f64>,
}

/// The last seconds of errors.
#[derive(Default)]
pub(super) struct Score {
    squares: VecDeque<Squares>,
    nominal: VecDeque<(i64, Vector6<f64>)>,
    records: VecDeque<(i64, bool)>,
}

/// What the last seconds come to.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Verdict {
    /// How much of the end was compared, s.
    pub(super) span_s: f64,
    /// Instants compared.
    pub(super) instants: usize,
    /// Share of the records that had a wrench.
    pub(super) valid: f64,
    /// RMS of error over standard deviation, by component.
    pub(super) sigmas: [f64; 6],
    /// RMS of the error over the three axes: force N, moment Nm.
    pub(super) rms: (f64, f64),
    /// The same with every gauge taken at face value.
    pub(super) nominal_rms: Option<(f64, f64)>,
}

impl Verdict {
    /// Whether every component agrees, on nearly all records.
    pub(super) fn agrees(&self) -> bool {
        let within = self.sigmas.iter().all(|sigmas| *sigmas <= LIMIT_SIGMA);
        self.instants > 0 && self.valid >= LEAST_VALID && within
    }
}

impl Score {
    /// A record was published (ns since the Unix epoch), with a wrench or without.
    pub(super) fn record(&mut self, published_ns: i64, valid: bool) {
        self.records.push_back((published_ns, valid));
        while self.records.front().is_some_and(|(first_ns, _)| published_ns - first_ns > WINDOW_NS) {
            self.records.pop_front();
        }
    }

    /// An instant's error (N, Nm) with its standard deviations.
    pub(super) fn error(&mut self, instant_ns: i64, error: &Vector6<f64>, sigma: &Vector6<f64>) {
        let normalised = error.component_div(sigma).map(|x| x * x);
        self.squares.push_back(Squares { instant_ns, normalised, plain: error.map(|x| x * x) });
        while self.squares.front().is_some_and(|first| instant_ns - first.instant_ns > WINDOW_NS) {
            self.squares.pop_front();
        }
    }

    /// An instant's error (N, Nm) with every gauge taken at face value.
    pub(super) fn nominal_error(&mut self, instant_ns: i64, error: &Vector6<f64>) {
        self.nominal.push_back((instant_ns, error.map(|x| x * x)));
        while self.nominal.front().is_some_and(|(first_ns, _)| instant_ns - first_ns > WINDOW_NS) {
            self.nominal.pop_front();
        }
    }

    /// What the last seconds come to.
    pub(super) fn verdict(&self) -> Verdict {
        let sum =
            |squares: &mut dyn Iterator<Item = Vector6<f64>>| squares.fold(Vector6::zeros(), |a, b| a + b);
        let n = self.squares.len().max(1) as f64;
        let normalised = sum(&mut self.squares.iter().map(|s| s.normalised)) / n;
        let plain = sum(&mut self.squares.iter().map(|s| s.plain)) / n;
        let nominal =
            sum(&mut self.nominal.iter().map(|(_, plain)| *plain)) / self.nominal.len().max(1) as f64;
        let valid = self.records.iter().filter(|(_, valid)| *valid).count();
        let span_ns =
            self.squares.back().zip(self.squares.front()).map_or(0, |(b, a)| b.instant_ns - a.instant_ns);
        Verdict {
            span_s: span_ns as f64 * 1e-9,
            instants: self.squares.len(),
            valid: valid as f64 / self.records.len().max(1) as f64,
            sigmas: normalised.map(f64::sqrt).into(),
            rms: rms(&plain),
            nominal_rms: (!self.nominal.is_empty()).then(|| rms(&nominal)),
        }
    }
}

/// Over the three axes of force and of moment.
fn rms(squares: &Vector6<f64>) -> (f64, f64) {
    let part = |from: usize| (squares.fixed_rows::<3>(from).sum() / 3.0).sqrt();
    (part(0), part(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(error: f64, sigma: f64, valid: bool) -> Verdict {
        let mut score = Score::default();
        for k in 0..100 {
            score.record(k, valid);
            score.error(k, &Vector6::repeat(error), &Vector6::repeat(sigma));
        }
        score.verdict()
    }

    #[test]
    fn agrees_up_to_three_sigmas_and_only_with_wrenches() {
        assert!(score(0.29, 0.1, true).agrees());
        assert!(!score(0.31, 0.1, true).agrees());
        assert!(!score(0.0, 0.1, false).agrees());
        assert!(!Score::default().verdict().agrees(), "no instant is no agreement");
    }

    #[test]
    fn only_the_last_ten_seconds_count() {
        let mut score = Score::default();
        score.error(0, &Vector6::repeat(9.0), &Vector6::repeat(1.0));
        score.error(WINDOW_NS + 1, &Vector6::repeat(2.0), &Vector6::repeat(1.0));
        let verdict = score.verdict();
        assert_eq!((verdict.instants, verdict.sigmas, verdict.rms), (1, [2.0; 6], (2.0, 2.0)));
    }
}
