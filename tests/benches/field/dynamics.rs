//! The estimator's tick and the simulator's step, beside what one would build of Pinocchio and Eigen, and MuJoCo's inverse dynamics.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use model::chain::Section;
use model::dynamics::Dynamics;
use model::estimator::{GaugeModel, GaugeReading, Gls, WrenchEstimator};
use model::motion::JointMotion;
use model::spatial::Wrench;
use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};
use rig::Rig;
use wrenchd_tests::programs::workspace;
use wrenchd_tests::{Check, Failure, ensure, packages, process};

use crate::peers::{self, processor_s};
use crate::table::{Compared, Line};

const GAUGES: usize = 8;
const ROWS: usize = 20_000;
const RUNS: usize = 7;
/// What is known of each joint: position (rad), velocity (rad/s), acceleration (rad/s^2).
const SIGMA: [f64; 3] = [2e-5, 1e-3, 1e-1];
const READ_LIMIT: Duration = Duration::from_secs(120);
const NOISE_COUNTS2: f64 = 600.0 * 600.0;

/// The example arm on its way, and readings without noise: all solvers must find the same wrench, however they weigh.
struct Problem {
    rig: Rig,
    gauges: Vec<GaugeModel>,
    rows: Vec<Row>,
    wrench: Vector6<f64>,
}

struct Row {
    motion: Vec<JointMotion>,
    readings: Vec<Option<GaugeReading>>,
}

impl Row {
    fn rates(&self) -> [Vec<f64>; 3] {
        let take = |of: fn(&JointMotion) -> f64| self.motion.iter().map(of).collect();
        [take(|m| m.position_rad), take(|m| m.velocity_rad_s), take(|m| m.acceleration_rad_s2)]
    }
}

/// A number between -1 and 1, the same for the same place.
fn scatter(place: usize) -> f64 {
    (place as f64 * 12.9898).sin() * 43758.5453 % 1.0
}

fn gauge(number: usize) -> GaugeModel {
    let compliance = Vector6::from_fn(|k, _| match k {
        0..3 => 2e4 * scatter(7 * number + k),
        3 | 4 => 5e4 * scatter(7 * number + k),
        _ => 3e5,
    });
    GaugeModel {
        compliance,
        bias_counts: 1e5 * scatter(number + 100),
        covariance: SMatrix::identity() * 1e2,
        assumed: None,
        noise_counts2: NOISE_COUNTS2,
        terms: Default::default(),
    }
}

fn motion(row: usize, joint: usize) -> JointMotion {
    let (t_s, rate) = (row as f64 * 1e-3, 1.0 + joint as f64 * 0.3);
    let phase = t_s * rate + joint as f64;
    JointMotion {
        position_rad: 0.4 * phase.sin() - 0.2,
        velocity_rad_s: 0.4 * rate * phase.cos(),
        acceleration_rad_s2: -0.4 * rate * rate * phase.sin(),
        covariance: Matrix3::from_diagonal(&Vector3::from(SIGMA.map(|sigma| sigma * sigma))),
    }
}

impl Problem {
    fn new() -> Check<Self> {
        let rig = Rig::load_file(&workspace().join("config/arm.toml"))?;
        let gauges: Vec<GaugeModel> = (0..GAUGES).map(gauge).collect();
        ensure!(rig.sections.len() == GAUGES, "the example arm has {} gauges", rig.sections.len());
        let wrench = Vector6::new(5.0, -3.0, 8.0, 0.4, -0.2, 0.3);
        let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
        let joints = rig.chain.coordinates();
        let rows = (0..ROWS).map(|row| {
            let mut row = Row { motion: (0..joints).map(|k| motion(row, k)).collect(), readings: Vec::new() };
            let [q, v, a] = row.rates();
            dynamics.update(&q, &v, &a);
            let tip = Wrench::from_vector(&wrench);
            let read = |(number, gauge): (usize, &GaugeModel)| {
                let load = dynamics.load(number) + dynamics.load_of_tip_wrench(number, &tip).to_vector();
                Some(GaugeReading::from(gauge.compliance.dot(&load) + gauge.bias_counts))
            };
            row.readings = gauges.iter().enumerate().map(read).collect();
            row
        });
        let rows = rows.collect();
        Ok(Self { rig, gauges, rows, wrench })
    }

    fn sections(&self) -> &[Section] {
        &self.rig.sections
    }

    /// Names of the joints that the gauges sit in.
    fn joints(&self) -> impl Iterator<Item = &str> {
        self.rig.config.sensors.iter().map(|sensor| sensor.section.as_str())
    }

    /// Writes arm and instants for the peers: fixed joints with a gauge become joints that rest, for there they tell of loads too.
    fn write(&self, folder: &Path) -> Check<[PathBuf; 2]> {
        let [urdf, data] = ["arm.urdf", "instants"].map(|name| folder.join(name));
        let path = workspace().join("config/arm.urdf");
        let mut text = std::fs::read_to_string(&path)?;
        for name in self.joints() {
            let fixed = format!("<joint name=\"{name}\" type=\"fixed\">");
            let turning = format!(
                "<joint name=\"{name}\" type=\"revolute\"><axis xyz=\"0 0 1\"/>\
                 <limit lower=\"-9\" upper=\"9\" effort=\"60\" velocity=\"3\"/>"
            );
            text = text.replace(&fixed, &turning);
        }
        std::fs::write(&urdf, text)?;
        let mut numbers = Vec::new();
        for gauge in &self.gauges {
            numbers.extend(gauge.compliance.iter().copied());
            numbers.extend([gauge.bias_counts, gauge.noise_counts2]);
            numbers.extend([0.0; 8]);
        }
        let turning: Vec<Option<usize>> = self.joints().map(|name| self.coordinate(name)).collect();
        for row in &self.rows {
            for rate in row.rates() {
                numbers.extend(turning.iter().map(|coordinate| coordinate.map_or(0.0, |k| rate[k])));
            }
            numbers.extend(row.readings.iter().flatten().map(|reading| reading.counts));
        }
        std::fs::write(&data, numbers.iter().flat_map(|number| number.to_ne_bytes()).collect::<Vec<u8>>())?;
        Ok([urdf, data])
    }

    /// Which coordinate a joint is; none for a fixed one.
    fn coordinate(&self, name: &str) -> Option<usize> {
        self.rig.chain.joints.iter().find(|joint| joint.name == name).and_then(|joint| joint.coordinate)
    }

    fn estimate(&self) -> Check<(f64, f64)> {
        let mut estimator = WrenchEstimator::new(&self.rig.chain, self.sections(), self.gauges.clone());
        let mut found = Vector6::zeros();
        let begun = processor_s();
        for row in &self.rows {
            let solution = estimator.estimate(&row.motion, &row.readings);
            let solution = solution.map_err(|why| Failure::new(format!("no wrench: {why:?}")))?;
            found = black_box(solution).wrench.to_vector();
        }
        Ok((per_row_ns(begun), found.sum()))
    }

    /// The least that an arm at rest needs: its load by gravity, a wrench weighed by the gauges' own noise, and its covariance.
    fn estimate_at_rest(&self) -> Check<(f64, f64)> {
        let mut dynamics = Dynamics::new(&self.rig.chain, self.sections());
        let mut solver = Gls::new(GAUGES);
        let mut positions_rad = vec![0.0; dynamics.coordinates()];
        let mut found = Vector6::zeros();
        let begun = processor_s();
        for row in &self.rows {
            let to = positions_rad.iter_mut().zip(&row.motion);
            to.for_each(|(to, joint)| *to = joint.position_rad);
            dynamics.update_static(&positions_rad);
            solver.clear();
            for (number, (gauge, reading)) in
                self.gauges.iter().zip(row.readings.iter().flatten()).enumerate()
            {
                let own = gauge.bias_counts + gauge.compliance.dot(&dynamics.load(number));
                let to_tip = dynamics.row_to_tip(number, &gauge.compliance);
                solver.push(&to_tip, reading.counts - own, gauge.noise_counts2);
            }
            found = solver.estimate(&[1.0; 6]).map_err(|why| Failure::new(format!("no wrench: {why:?}")))?;
            black_box(solver.unknowns_covariance());
        }
        Ok((per_row_ns(begun), found.sum()))
    }

    fn simulate(&self) -> (f64, f64) {
        let mut dynamics = Dynamics::new(&self.rig.chain, self.sections());
        let rates: Vec<[Vec<f64>; 3]> = self.rows.iter().map(Row::rates).collect();
        let mut sum = 0.0;
        let begun = processor_s();
        for [q, v, a] in &rates {
            dynamics.update_loads(q, v, a);
            for (number, gauge) in self.gauges.iter().enumerate() {
                sum += gauge.compliance.dot(&dynamics.load(number)) + gauge.bias_counts;
            }
        }
        (per_row_ns(begun), black_box(sum))
    }
}

fn per_row_ns(begun_s: f64) -> f64 {
    (processor_s() - begun_s) * 1e9 / ROWS as f64
}

fn folder(name: &str) -> Check<PathBuf> {
    let folder = std::env::temp_dir().join(format!("wrenchd-field-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    Ok(folder)
}

/// The program, and the arm as it reads it.
fn pinocchio(folder: &Path, urdf: &Path) -> Check<[PathBuf; 2]> {
    let eigen = Path::new("/usr/include/eigen3");
    if !eigen.is_dir() {
        packages::install(&["libeigen3-dev"])?;
    }
    // .../cmeel.prefix/lib/python3.x/site-packages/pinocchio
    let inside = peers::package("pinocchio")?;
    let prefix = inside.ancestors().find(|dir| dir.join("include/pinocchio").is_dir());
    let prefix = prefix.ok_or_else(|| Failure::new(format!("no headers near {}", inside.display())))?;
    let include = [eigen, &prefix.join("include")].map(|path| format!("-isystem{}", path.display()));
    let program = peers::compile("pinocchio.cpp", &include)?;
    let mut read = Command::new(peers::interpreter()?);
    let said = process::run(read.arg(peers::sources().join("arm.py")).arg(urdf).arg("tool0"), READ_LIMIT)?;
    let arm = folder.join("arm");
    std::fs::write(&arm, said.stdout())?;
    Ok([program, arm])
}

fn mujoco() -> Check<PathBuf> {
    let package = peers::package("mujoco")?;
    let library = std::fs::read_dir(&package)?.flatten().map(|entry| entry.path());
    let library = library.into_iter().find(|path| path.to_string_lossy().contains("libmujoco.so"));
    let library = library.ok_or_else(|| Failure::new(format!("no library in {}", package.display())))?;
    let arguments = [
        format!("-I{}", package.join("include").display()),
        library.display().to_string(),
        format!("-Wl,-rpath,{}", package.display()),
    ];
    peers::compile("mujoco.c", &arguments)
}

/// Set for a process that only runs the estimator.
pub(crate) const ALONE: &str = "WRENCHD_FIELD_TICK";

/// The estimator alone: prints what a peer prints.
pub(crate) fn alone() -> Check {
    let (cost, sum) = Problem::new()?.estimate()?;
    println!("{cost} {sum}");
    Ok(())
}

/// The estimator, beside the same by Pinocchio and Eigen.
pub(crate) fn tick() -> Check<Vec<Line>> {
    let folder = folder("tick")?;
    let problem = Problem::new()?;
    let [urdf, data] = problem.write(&folder)?;
    let [program, arm] = pinocchio(&folder, &urdf)?;
    let peer = |work: &str| {
        let mut command = Command::new(&program);
        command.args([&arm, &data]).args([&ROWS.to_string(), work]).args(problem.joints());
        peers::run(&mut command)
    };
    let native = peers::native()?;
    // What each finds of the instants must be what is asked of it: without noise the wrench, however it is weighed; at rest, where motion is left out, what the
    // peer finds.
    let truth = problem.wrench.sum();
    let mut costs: [Vec<f64>; 6] = Default::default();
    for _ in 0..RUNS {
        let (own, resting) = (problem.estimate()?, problem.estimate_at_rest()?);
        let native = peers::run(Command::new(&native).env(ALONE, "1"))?;
        let all = [own, resting, peer("weighed")?, peer("wrench")?, peer("resting")?, native];
        let should_be = [truth, resting.1, truth, truth, resting.1, truth];
        for (at, ((cost, sum), should_be)) in all.into_iter().zip(should_be).enumerate() {
            ensure!((sum - should_be).abs() < 1e-6, "solver {at} found {sum}, not {should_be}");
            costs[at].push(cost);
        }
    }
    let _ = std::fs::remove_dir_all(&folder);
    let [own, resting, weighed, wrench, peer_resting, native] = &costs;
    let (tick, at_rest) = (
        "estimator tick, time",
        "at rest, the gauges' own noise alone: kinematics, gravity, weighted QR, covariance",
    );
    let compared = |what, peer, goal| Compared { what, peer, unit: "ns", goal };
    Ok(vec![
        compared(tick, "Pinocchio and Eigen, covariance too", "<= 0.5").cost(own, weighed),
        compared(at_rest, "Pinocchio and Eigen", "<= 0.5").cost(resting, peer_resting),
        compared(tick, "the same built for this processor", "<= 1.4").cost(own, native),
        compared(tick, "Pinocchio and Eigen, unweighted wrench alone", "").cost(own, wrench),
    ])
}

/// The simulator's step, beside inverse dynamics elsewhere.
pub(crate) fn simulator() -> Check<Vec<Line>> {
    let folder = folder("simulator")?;
    let problem = Problem::new()?;
    let [urdf, data] = problem.write(&folder)?;
    let [program, arm] = pinocchio(&folder, &urdf)?;
    let mujoco = mujoco()?;
    let mut costs = [Vec::new(), Vec::new(), Vec::new()];
    let mut sums = [0.0; 2];
    for _ in 0..RUNS {
        costs[0].push(problem.simulate().0);
        let mut rnea = Command::new(&program);
        rnea.args([&arm, &data]).args([&ROWS.to_string(), "rnea"]).args(problem.joints());
        let mut inverse = Command::new(&mujoco);
        inverse.args([&urdf, &data]).arg(ROWS.to_string()).args(problem.joints());
        for (at, command) in [rnea, inverse].iter_mut().enumerate() {
            let (cost, sum) = peers::run(command)?;
            costs[at + 1].push(cost);
            sums[at] = sum;
        }
    }
    let _ = std::fs::remove_dir_all(&folder);
    let apart = (sums[0] - sums[1]).abs() / sums[0].abs();
    ensure!(apart < 1e-3, "Pinocchio and MuJoCo move different arms: {sums:?}");
    let compared = |peer, goal| Compared { what: "simulator step, speed", peer, unit: "ns", goal };
    Ok(vec![
        compared("Pinocchio rnea", ">= 3").speed(&costs[0], &costs[1]),
        compared("MuJoCo mj_inverse", ">= 5").speed(&costs[0], &costs[2]),
    ])
}
