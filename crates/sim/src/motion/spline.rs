//! Cubic splines through given positions, at rest at both ends.

/// Positions (rad) of all coordinates at given instants (s), joined by cubics with continuous acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    /// Instants from the beginning, s; at least two, increasing.
    times_s: Vec<f64>,
    /// Per coordinate: positions (rad) and accelerations (rad/s^2) at the instants.
    curves: Vec<Curve>,
}

#[derive(Clone, Debug, PartialEq)]
struct Curve {
    positions_rad: Vec<f64>,
    accelerations_rad_s2: Vec<f64>,
}

impl Spline {
    /// The spline through rows of an instant (s) and one position (rad) a coordinate; none for fewer than two rows, rows
    /// of different lengths, or instants that do not increase. The first instant becomes 0.
    #[must_use]
    pub fn new(rows: &[(f64, Vec<f64>)]) -> Option<Self> {
        let (first_s, first) = rows.first()?;
        let ordered = rows.windows(2).all(|pair| pair[0].0 < pair[1].0);
        if rows.len() < 2 || !ordered || rows.iter().any(|(_, row)| row.len() != first.len()) {
            return None;
        }
        let times_s: Vec<f64> = rows.iter().map(|(t_s, _)| t_s - first_s).collect();
        let curve = |coordinate: usize| {
            let positions_rad: Vec<f64> = rows.iter().map(|(_, row)| row[coordinate]).collect();
            let accelerations_rad_s2 = accelerations(&times_s, &positions_rad);
            Curve { positions_rad, accelerations_rad_s2 }
        };
        let curves = (0..first.len()).map(curve).collect();
        Some(Self { times_s, curves })
    }

    /// How long it takes, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(0.0)
    }

    pub(super) fn last_pose(&self) -> Vec<f64> {
        self.curves.iter().map(|curve| curve.positions_rad.last().copied().unwrap_or(0.0)).collect()
    }

    /// Position, velocity and acceleration of a coordinate at an instant (s): rad, rad/s, rad/s^2.
    #[must_use]
    pub fn at(&self, coordinate: usize, t_s: f64) -> [f64; 3] {
        let after = self.times_s.partition_point(|knot| *knot <= t_s).clamp(1, self.times_s.len() - 1);
        self.in_interval(coordinate, after - 1, t_s)
    }

    fn in_interval(&self, coordinate: usize, interval: usize, t_s: f64) -> [f64; 3] {
        let curve = &self.curves[coordinate];
        let (t0, t1) = (self.times_s[interval], self.times_s[interval + 1]);
        let (q0, q1) = (curve.positions_rad[interval], curve.positions_rad[interval + 1]);
        let (m0, m1) = (curve.accelerations_rad_s2[interval], curve.accelerations_rad_s2[interval + 1]);
        let h = t1 - t0;
        let (a, b) = ((t1 - t_s) / h, (t_s - t0) / h);
        [
            a * q0 + b * q1 + ((a * a * a - a) * m0 + (b * b * b - b) * m1) * h * h / 6.0,
            (q1 - q0) / h + ((3.0 * b * b - 1.0) * m1 - (3.0 * a * a - 1.0) * m0) * h / 6.0,
            a * m0 + b * m1,
        ]
    }

    /// Instants (s) between which the extremes of position and speed of a coordinate lie, with the motion there.
    fn candidates(&self, coordinate: usize) -> impl Iterator<Item = (f64, [f64; 3])> + '_ {
        (0..self.times_s.len() - 1).flat_map(move |interval| {
            let (t0, t1) = (self.times_s[interval], self.times_s[interval + 1]);
            // Speed is extreme where the acceleration, linear in the interval, is zero; position is bounded by sampling.
            let [_, _, m0] = self.in_interval(coordinate, interval, t0);
            let [_, _, m1] = self.in_interval(coordinate, interval, t1);
            let turn = if m0 * m1 < 0.0 { t0 + (t1 - t0) * m0 / (m0 - m1) } else { t0 };
            let within = (0..=8).map(move |step| t0 + (t1 - t0) * f64::from(step) / 8.0);
            within.chain([turn]).map(move |t_s| (t_s, self.in_interval(coordinate, interval, t_s)))
        })
    }

    /// Highest speed of a coordinate (rad/s) and when (s).
    pub(super) fn fastest(&self, coordinate: usize) -> (f64, f64) {
        self.candidates(coordinate)
            .map(|(t_s, [_, velocity, _])| (velocity.abs(), t_s))
            .fold((0.0, 0.0), |best, next| if next.0 > best.0 { next } else { best })
    }

    pub(super) fn extent(&self, coordinate: usize) -> (f64, f64) {
        self.candidates(coordinate)
            .map(|(_, [position, ..])| position)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(q), high.max(q)))
    }
}

/// Second derivatives at the knots of the cubic spline with zero slope at both ends (tridiagonal system, Thomas).
fn accelerations(times_s: &[f64], positions: &[f64]) -> Vec<f64> {
    let last = times_s.len() - 1;
    let step = |k: usize| times_s[k + 1] - times_s[k];
    let slope = |k: usize| (positions[k + 1] - positions[k]) / step(k);
    let (mut ratios, mut values) = (vec![0.0; last + 1], vec![0.0; last + 1]);
    for k in 0..=last {
        let (below, diagonal, above, right) = if k == 0 {
            (0.0, 2.0 * step(0), step(0), 6.0 * slope(0))
        } else if k == last {
            (step(k - 1), 2.0 * step(k - 1), 0.0, -6.0 * slope(k - 1))
        } else {
            (step(k - 1), 2.0 * (step(k - 1) + step(k)), step(k), 6.0 * (slope(k) - slope(k - 1)))
        };
        let (ratio, value) = if k == 0 { (0.0, 0.0) } else { (ratios[k - 1], values[k - 1]) };
        let pivot = diagonal - below * ratio;
        ratios[k] = above / pivot;
        values[k] = (right - below * value) / pivot;
    }
    for k in (0..last).rev() {
        values[k] -= ratios[k] * values[k + 1];
    }
    values
}
