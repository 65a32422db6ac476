//! Which corrections are worth having: those with which poses and times that were left out are predicted better.
//!
//! Forward selection in a fixed order on the linearised problem. Poses leave in five interleaved folds and times in five
//! contiguous ones; a group stays if its gain over the poses is clear against the gain's own scatter from pose to pose, and
//! times do not get worse.

use super::effects::Family;
use super::parameters::Group;
use super::rows::Row;
use super::system::{Normal, Selection, System};
use crate::gauges::in_parallel;

/// Folds of either kind.
const FOLDS: usize = 5;

/// A gain counts when it is so many times its scatter: one in a thousand by chance, for some twenty questions asked.
const CLEAR_SIGMA: f64 = 3.0;

/// and when it takes at least this share of the squared error away: less is not worth a state in the cycle.
const WORTHWHILE: f64 = 0.01;

/// Passes over all groups; a later one sees what an earlier one uncovered.
const PASSES: usize = 3;

/// One question: a group of the arm's numbers, or a family of effects.
#[derive(Clone, Copy, Debug)]
enum Candidate {
    Arm(Group),
    Gauges(Family),
}

/// Large things first: what they leave unexplained hides the small ones.
const ORDER: [Candidate; 11] = [
    Candidate::Gauges(Family::Temperature),
    Candidate::Arm(Group::LinkMasses),
    Candidate::Arm(Group::EncoderZeros),
    Candidate::Arm(Group::JointFlexibility),
    Candidate::Arm(Group::BaseTilt),
    Candidate::Arm(Group::Weights),
    Candidate::Arm(Group::Reference),
    Candidate::Gauges(Family::Hysteresis),
    Candidate::Arm(Group::JointPlacement),
    Candidate::Gauges(Family::Creep),
    Candidate::Gauges(Family::Nonlinearity),
];

/// What was admitted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Admitted {
    /// Groups of the arm's numbers.
    pub arm: Vec<Group>,
    /// Families of effects of each gauge.
    pub gauges: Vec<Vec<Family>>,
}

impl Admitted {
    /// Nothing beyond compliance and bias.
    pub fn nothing(gauges: usize) -> Self {
        Self { arm: Vec::new(), gauges: vec![Vec::new(); gauges] }
    }

    /// Everything there is.
    pub fn everything(gauges: usize) -> Self {
        Self { arm: Group::ALL.to_vec(), gauges: vec![Family::ALL.to_vec(); gauges] }
    }

    /// Whether nothing was.
    pub fn is_nothing(&self) -> bool {
        self.arm.is_empty() && self.gauges.iter().all(Vec::is_empty)
    }

    /// The free numbers, `linear` of each gauge's own being compliance and biases.
    pub fn selection(&self, groups: &[Group], linear: usize, own: usize) -> Selection {
        let free = |families: &Vec<Family>| {
            (0..own)
                .map(|k| k < linear || families.iter().any(|f| f.range().contains(&(k - linear))))
                .collect()
        };
        Selection {
            own: self.gauges.iter().map(free).collect(),
            arm: groups.iter().map(|group| self.arm.contains(group)).collect(),
        }
    }

    fn has(&self, candidate: Candidate) -> bool {
        match candidate {
            Candidate::Arm(group) => self.arm.contains(&group),
            Candidate::Gauges(family) => self.gauges.iter().all(|own| own.contains(&family)),
        }
    }

    fn with(&self, candidate: Candidate, gauges: &[bool]) -> Self {
        let mut out = self.clone();
        match candidate {
            Candidate::Arm(group) => out.arm.push(group),
            Candidate::Gauges(family) => {
                for (own, _) in out.gauges.iter_mut().zip(gauges).filter(|(_, wanted)| **wanted) {
                    if !own.contains(&family) {
                        own.push(family);
                    }
                }
            }
        }
        out
    }
}

/// Which fold each row is in, by pose and by time.
struct Folds([Vec<usize>; 2]);

impl Folds {
    fn new(rows: &[Row]) -> Self {
        let by_time = (0..rows.len()).map(|k| k * FOLDS / rows.len().max(1)).collect();
        Self([rows.iter().map(|row| row.pose % FOLDS).collect(), by_time])
    }
}

/// Squared held-out errors in units of their variances: `[kind of fold][gauge][pose]`.
type Errors = [Vec<Vec<f64>>; 2];

struct Trial<'a> {
    system: &'a mut System,
    rows: &'a [Row],
    folds: Folds,
    groups: &'a [Group],
    linear: usize,
    /// `[kind][fold][gauge]`.
    normals: [Vec<Vec<Normal>>; 2],
}

/// Forward selection; leaves each gauge's misfit in the system as held-out poses show it.
pub fn admit(system: &mut System, rows: &[Row], groups: &[Group], linear: usize) -> Admitted {
    let gauges = system.gauges.len();
    let mut trial =
        Trial { system, rows, folds: Folds::new(rows), groups, linear, normals: [Vec::new(), Vec::new()] };
    let mut admitted = Admitted::nothing(gauges);
    let mut best = trial.weigh(&admitted);
    for _ in 0..PASSES {
        let before = admitted.clone();
        for candidate in ORDER {
            if admitted.has(candidate) {
                continue;
            }
            let tried = admitted.with(candidate, &vec![true; gauges]);
            let Some(errors) = trial.errors(&tried) else { continue };
            let next = match candidate {
                Candidate::Arm(_) => {
                    is_better(&best, &errors, &|_| true).then(|| admitted.with(candidate, &[]))
                }
                Candidate::Gauges(_) => {
                    let wanted: Vec<bool> =
                        (0..gauges).map(|g| is_better(&best, &errors, &|k| k == g)).collect();
                    wanted.contains(&true).then(|| admitted.with(candidate, &wanted))
                }
            };
            if let Some(next) = next.filter(|next| *next != admitted) {
                admitted = next;
                best = trial.weigh(&admitted);
            }
        }
        if admitted == before {
            break;
        }
    }
    admitted
}

/// Whether the errors of the wanted gauges became clearly smaller over poses, and no larger over times.
fn is_better(before: &Errors, after: &Errors, wanted: &dyn Fn(usize) -> bool) -> bool {
    let gain = |kind: usize| -> (f64, f64, f64) {
        let mut by_pose = vec![0.0; before[kind].first().map_or(0, Vec::len)];
        let mut whole = 0.0;
        for gauge in (0..before[kind].len()).filter(|g| wanted(*g)) {
            for (pose, sum) in by_pose.iter_mut().enumerate() {
                *sum += before[kind][gauge][pose] - after[kind][gauge][pose];
                whole += before[kind][gauge][pose];
            }
        }
        let squares: f64 = by_pose.iter().map(|gain| gain * gain).sum();
        (by_pose.iter().sum(), squares.sqrt(), whole)
    };
    let (gain_poses, scatter, whole) = gain(0);
    gain_poses > CLEAR_SIGMA * scatter && gain_poses > WORTHWHILE * whole && gain(1).0 > 0.0
}

impl Trial<'_> {
    /// Takes the misfit from held-out poses under what is admitted, weighs all rows with it and scores anew.
    fn weigh(&mut self, admitted: &Admitted) -> Errors {
        // The misfit depends on the weights a little: twice is enough.
        for _ in 0..2 {
            self.collect();
            let residuals = self.held_out(admitted, 0);
            for (gauge, residuals) in residuals.into_iter().flatten().enumerate() {
                self.system.gauges[gauge].misfit = self.system.misfit(gauge, &residuals, 0.0);
            }
        }
        self.collect();
        self.errors(admitted).unwrap_or_else(|| [Vec::new(), Vec::new()])
    }

    fn collect(&mut self) {
        let (system, gauges) = (&*self.system, self.system.gauges.len());
        for kind in 0..2 {
            let of = &self.folds.0[kind];
            let flat =
                in_parallel(FOLDS * gauges, |k| system.normal(k % gauges, |row| of[row] == k / gauges));
            self.normals[kind] = flat.chunks(gauges).map(<[Normal]>::to_vec).collect();
        }
    }

    /// Residual of each row when its fold is left out: `[gauge][row of the gauge]`.
    fn held_out(&self, admitted: &Admitted, kind: usize) -> Option<Vec<Vec<f64>>> {
        let system = &*self.system;
        let selection = admitted.selection(self.groups, self.linear, system.own);
        let solutions = in_parallel(FOLDS, |fold| {
            let rest = |gauge: usize| {
                let others = (0..FOLDS).filter(|f| *f != fold).map(|f| &self.normals[kind][f][gauge]);
                let n = system.columns() + 1;
                others.fold(Normal::zeros(n, n), |sum, normal| sum + normal)
            };
            let normals: Vec<Normal> = (0..system.gauges.len()).map(rest).collect();
            let solution = system.solve(&normals, &selection)?;
            Some((0..system.gauges.len()).map(|gauge| system.residuals(gauge, &solution)).collect::<Vec<_>>())
        });
        let solutions: Vec<Vec<Vec<f64>>> = solutions.into_iter().collect::<Option<_>>()?;
        let of = &self.folds.0[kind];
        let mine = |gauge: usize| {
            let index = &system.gauges[gauge].index;
            index.iter().enumerate().map(|(k, row)| solutions[of[*row]][gauge][k]).collect()
        };
        Some((0..system.gauges.len()).map(mine).collect())
    }

    fn errors(&self, admitted: &Admitted) -> Option<Errors> {
        let poses = self.rows.iter().map(|row| row.pose + 1).max().unwrap_or(0);
        let kind = |kind: usize| -> Option<Vec<Vec<f64>>> {
            let held_out = self.held_out(admitted, kind)?;
            let sum = |(residuals, rows): (&Vec<f64>, &super::system::GaugeRows)| {
                let mut by_pose = vec![0.0; poses];
                for (k, residual) in residuals.iter().enumerate() {
                    let square = rows.trust[k] * residual * residual / rows.total_variance(k);
                    by_pose[self.rows[rows.index[k]].pose] += square;
                }
                by_pose
            };
            Some(held_out.iter().zip(&self.system.gauges).map(sum).collect())
        };
        Some([kind(0)?, kind(1)?])
    }
}
