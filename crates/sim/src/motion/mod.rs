//! Motions of the arm's joints as formulas: position, velocity and acceleration at any instant, exactly.

mod csv;
mod limits;
mod quintic;
mod sines;
mod spline;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

pub use limits::{JointLimits, MAX_ACCELERATION_RAD_S2, MotionLimits, SPEED_SHARE};
pub use quintic::Move;
pub use sines::{Sine, Sines};
pub use spline::Spline;

/// Motion of all coordinates of a chain at one instant, base to tip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointState {
    /// Positions, rad.
    pub positions_rad: Vec<f64>,
    /// Velocities, rad/s.
    pub velocities_rad_s: Vec<f64>,
    /// Accelerations, rad/s^2.
    pub accelerations_rad_s2: Vec<f64>,
}

impl JointState {
    /// All of so many coordinates at zero (rad, rad/s, rad/s^2).
    #[must_use]
    pub fn at_rest(coordinates: usize) -> Self {
        let zeros = vec![0.0; coordinates];
        Self { positions_rad: zeros.clone(), velocities_rad_s: zeros.clone(), accelerations_rad_s2: zeros }
    }

    fn set(&mut self, coordinate: usize, [position, velocity, acceleration]: [f64; 3]) {
        if let Some(slot) = self.positions_rad.get_mut(coordinate) {
            *slot = position;
        }
        if let Some(slot) = self.velocities_rad_s.get_mut(coordinate) {
            *slot = velocity;
        }
        if let Some(slot) = self.accelerations_rad_s2.get_mut(coordinate) {
            *slot = acceleration;
        }
    }
}

/// One piece of a trajectory; times are seconds from its own beginning.
#[derive(Clone, Debug, PartialEq)]
enum Piece {
    Hold(Vec<f64>),
    Move(Move),
    Sines(Sines),
    Spline(Spline),
}

impl Piece {
    fn at(&self, coordinate: usize, t_s: f64) -> [f64; 3] {
        match self {
            Self::Hold(pose) => [pose[coordinate], 0.0, 0.0],
            Self::Move(quintic) => quintic.at(coordinate, t_s),
            Self::Sines(sines) => sines.at(coordinate, t_s),
            Self::Spline(spline) => spline.at(coordinate, t_s),
        }
    }

    /// Lowest and highest position of a coordinate, rad.
    fn extent(&self, coordinate: usize) -> (f64, f64) {
        match self {
            Self::Hold(pose) => (pose[coordinate], pose[coordinate]),
            Self::Move(quintic) => quintic.extent(coordinate),
            Self::Sines(sines) => sines.extent(coordinate),
            Self::Spline(spline) => spline.extent(coordinate),
        }
    }
}

/// Pieces of motion one after another, without jumps of position or velocity; at rest before and after.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    coordinates: usize,
    /// Beginning (s) and piece.
    pieces: Vec<(f64, Piece)>,
    duration_s: f64,
    /// Where it ends, rad.
    pose: Vec<f64>,
}

impl Trajectory {
    /// A trajectory that begins in a pose (rad, base to tip) and has no length yet.
    #[must_use]
    pub fn from_pose(pose: Vec<f64>) -> Self {
        Self {
            coordinates: pose.len(),
            pieces: vec![(0.0, Piece::Hold(pose.clone()))],
            duration_s: 0.0,
            pose,
        }
    }

    /// A spline through the rows of a file, for the joints of `limits`.
    fn from_spline(spline: Spline) -> Self {
        let (duration_s, pose) = (spline.duration_s(), spline.last_pose());
        Self { coordinates: pose.len(), pieces: vec![(0.0, Piece::Spline(spline))], duration_s, pose }
    }

    /// Stays where it is for `seconds`.
    pub fn hold(&mut self, seconds: f64) {
        let pose = self.pose.clone();
        self.push(Piece::Hold(pose), seconds);
    }

    /// Goes to a pose (rad) as fast as `speed_share` of the joints' speed limits and their accelerations allow.
    pub fn move_to(&mut self, pose: Vec<f64>, limits: &MotionLimits, speed_share: f64) {
        let quintic = Move::new(self.pose.clone(), pose.clone(), limits, speed_share);
        let seconds = quintic.duration_s();
        self.push(Piece::Move(quintic), seconds);
        self.pose = pose;
    }

    /// Swings about where it is; ends there again.
    pub fn swing(&mut self, sines: Sines) {
        let seconds = sines.duration_s();
        self.push(Piece::Sines(sines), seconds);
    }

    fn push(&mut self, piece: Piece, seconds: f64) {
        if seconds > 0.0 && seconds.is_finite() {
            self.pieces.push((self.duration_s, piece));
            self.duration_s += seconds;
        }
    }

    /// How long it lasts, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Where it ends (rad, base to tip).
    #[must_use]
    pub fn last_pose(&self) -> &[f64] {
        &self.pose
    }

    /// Number of coordinates (rad).
    #[must_use]
    pub fn coordinates(&self) -> usize {
        self.coordinates
    }

    /// Motion at an instant (s; rad, rad/s, rad/s^2); before the beginning and after the end, at rest there.
    pub fn at(&self, t_s: f64, state: &mut JointState) {
        let resting = t_s < 0.0 || t_s >= self.duration_s;
        let t_s = t_s.clamp(0.0, self.duration_s);
        let after = self.pieces.partition_point(|(from_s, _)| *from_s <= t_s);
        let Some((from_s, piece)) = self.pieces.get(after.saturating_sub(1)) else { return };
        for coordinate in 0..self.coordinates {
            let [position, velocity, acceleration] = piece.at(coordinate, t_s - from_s);
            let rates = if resting { [0.0, 0.0] } else { [velocity, acceleration] };
            state.set(coordinate, [position, rates[0], rates[1]]);
        }
    }

    /// Lowest and highest position of a coordinate, rad.
    #[must_use]
    pub fn extent(&self, coordinate: usize) -> (f64, f64) {
        self.pieces
            .iter()
            .map(|(_, piece)| piece.extent(coordinate))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (a, b)| (low.min(a), high.max(b)))
    }
}
