//! The linear stage against numpy's lstsq and Eigen's QR: a million samples of eight gauges, in the same run
//!
//! `cargo bench -p wrenchd-calibration --bench linear`; needs python3 with numpy, and c++ with Eigen (Debian: python3-numpy, libeigen3-dev).
//! `PYTHON` names another interpreter. All three get the samples in memory; both cores are theirs to use.

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Instant;

use nalgebra::{SMatrix, SVector};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use wrenchd_calibration::triangle::Triangle;

const ROWS: usize = 1_000_000;
/// Six loads and one.
const COLUMNS: usize = 7;
const WIDTH: usize = COLUMNS + 1;
const GAUGES: usize = 8;
const RUNS: usize = 5;

type Seconds = f64;

fn samples() -> Vec<[f64; WIDTH]> {
    let mut rng = StdRng::seed_from_u64(1);
    let row = |_| {
        let mut row = [1.0; WIDTH];
        row[..6].iter_mut().for_each(|load| *load = rng.random_range(-10.0..10.0));
        row[COLUMNS] =
            (0..COLUMNS).map(|k| (k as f64 - 2.5) * row[k]).sum::<f64>() + rng.random_range(-1.0..1.0);
        row
    };
    (0..ROWS).map(row).collect()
}

/// One gauge's last number.
fn solve(rows: &[[f64; WIDTH]]) -> f64 {
    let mut triangle = Triangle::<WIDTH>::default();
    rows.iter().for_each(|row| triangle.add(row));
    let r = triangle.finish();
    let a = SMatrix::<f64, COLUMNS, COLUMNS>::from_fn(|i, k| r[i][k]);
    let z = SVector::<f64, COLUMNS>::from_fn(|i, _| r[i][COLUMNS]);
    a.solve_upper_triangular(&z).map_or(f64::NAN, |x| x[COLUMNS - 1])
}

fn ours(rows: &[[f64; WIDTH]]) -> (Seconds, f64) {
    let begun = Instant::now();
    let cores = thread::available_parallelism().map_or(1, usize::from).min(GAUGES);
    let share = |core: usize| (core..GAUGES).step_by(cores).map(|_| solve(rows)).sum::<f64>();
    let total: f64 = thread::scope(|scope| {
        let threads: Vec<_> = (0..cores).map(|core| scope.spawn(move || share(core))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap_or(f64::NAN)).sum()
    });
    (begun.elapsed().as_secs_f64(), total / GAUGES as f64)
}

/// Runs a peer, which prints its seconds and its result.
fn peer(command: &mut Command, data: &Path) -> Result<(Seconds, f64), Box<dyn Error>> {
    let out = command.arg(data).args([ROWS, COLUMNS, GAUGES].map(|n| n.to_string())).output()?;
    if !out.status.success() {
        return Err(format!("{command:?}: {}", String::from_utf8_lossy(&out.stderr)).into());
    }
    let text = String::from_utf8(out.stdout)?;
    let mut words = text.split_ascii_whitespace().map(str::parse::<f64>);
    match (words.next(), words.next()) {
        (Some(seconds), Some(result)) => Ok((seconds?, result?)),
        _ => Err(format!("{command:?} printed {text:?}").into()),
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches");
    let scratch = tempfile::tempdir()?;
    let (data, eigen) = (scratch.path().join("samples"), scratch.path().join("eigen_qr"));
    let rows = samples();
    fs::write(&data, rows.as_flattened().iter().flat_map(|v| v.to_ne_bytes()).collect::<Vec<u8>>())?;
    let compiled = Command::new("c++")
        .args(["-O3", "-march=native", "-DNDEBUG", "-isystem", "/usr/include/eigen3", "-o"])
        .args([&eigen, &here.join("eigen_qr.cpp")])
        .status()?;
    if !compiled.success() {
        return Err("c++ cannot compile the peer: is libeigen3-dev installed?".into());
    }
    let python = std::env::var_os("PYTHON").unwrap_or_else(|| "python3".into());
    let mut ratios = [Vec::new(), Vec::new()];
    for _ in 0..RUNS {
        let (own_s, own) = ours(&rows);
        let peers = [
            peer(Command::new(&python).arg(here.join("numpy_lstsq.py")), &data)?,
            peer(&mut Command::new(&eigen), &data)?,
        ];
        for ((seconds, result), ratios) in peers.iter().zip(&mut ratios) {
            if (result - own).abs() > 1e-9 * own.abs().max(1.0) {
                return Err(format!("a peer found {result}, we {own}").into());
            }
            ratios.push(own_s / seconds);
        }
        println!("{own_s:.3} s, numpy {:.3} s, Eigen {:.3} s", peers[0].0, peers[1].0);
    }
    for (name, mut ratios) in ["numpy lstsq", "Eigen Householder QR"].into_iter().zip(ratios) {
        ratios.sort_by(f64::total_cmp);
        let (least, middle, most) = (ratios[0], ratios[RUNS / 2], ratios[RUNS - 1]);
        println!("time over that of {name}: {middle:.3} ({least:.3} to {most:.3}); goal 0.25");
    }
    Ok(())
}
