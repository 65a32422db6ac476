use std::path::PathBuf;
use calibration::Recording;
use rig::{ModelFile, Rig, Run};
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let dirs: Vec<PathBuf> = args[1..].iter().map(PathBuf::from).collect();
    let runs: Vec<Run> = dirs.iter().map(|d| Run::load(d).unwrap()).collect();
    let rig = Rig::load(runs[0].config.clone()).unwrap();
    let model = ModelFile::load(&PathBuf::from(&args[0]), &rig).unwrap();
    let recordings: Vec<Recording> = runs.iter().map(|r| Recording::read(r, &rig, |_| {}).unwrap()).collect();
    let pairs: Vec<(&Run, &Recording)> = runs.iter().zip(&recordings).collect();
    let s = wrenchd_gap::runs::session(&rig, &model, &pairs).unwrap();
    for r in 0..s.rows() {
        print!("{:.4}", s.time_s.as_ref().unwrap()[r]);
        for c in &s.channels { print!(" {:.2}", c.gap[r] / c.scale); }
        for c in &s.channels { print!(" {:.2}", c.simulated[r] / c.scale); } for j in &s.joints { print!(" {:.5} {:.4} {:.3}", j.position_rad[r], j.velocity_rad_s.as_ref().unwrap()[r], j.acceleration_rad_s2.as_ref().unwrap()[r]); }
        println!();
    }
}
