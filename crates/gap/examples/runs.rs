//! Development: diagnose sessions of runs, one line each.
use std::path::{Path, PathBuf};
use std::time::Instant;
use calibration::Recording;
use rig::{ModelFile, Rig, Run};

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let verbose = args.contains(&"-v".to_owned());
    let model = PathBuf::from(&args[0]);
    for dir in args[1..].iter().filter(|a| *a != "-v") {
        let dir = Path::new(dir);
        let mut dirs: Vec<PathBuf> = if dir.join("run.toml").exists() { vec![dir.to_owned()] } else {
            std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).filter(|p| p.join("run.toml").exists()).collect() };
        dirs.sort();
        let begin = Instant::now();
        let runs: Vec<Run> = dirs.iter().map(|d| Run::load(d).unwrap()).collect();
        let rig = Rig::load(runs[0].config.clone()).unwrap();
        let model = ModelFile::load(&model, &rig).unwrap();
        let recordings: Vec<Recording> = runs.iter().map(|r| Recording::read(r, &rig, |_| {}).unwrap()).collect();
        let read = begin.elapsed().as_secs_f64();
        let pairs: Vec<(&Run, &Recording)> = runs.iter().zip(&recordings).collect();
        let session = wrenchd_gap::runs::session(&rig, &model, &pairs).unwrap();
        let built = begin.elapsed().as_secs_f64();
        let d = wrenchd_gap::diagnose(&session, |_, _| {});
        let all = begin.elapsed().as_secs_f64();
        println!("{} {:?} {:.2}->{:.2} floor {:.3} shrink {:?} [read {read:.1} built {built:.1} all {all:.1} s]", dir.display(), d.verdict, d.gap.before, d.gap.after, d.gap.floor, d.gap.shrink.map(|s| (s * 1e4).round() / 1e4));
        for f in &d.findings {
            let p: Vec<String> = f.parameters.iter().map(|(n, p)| format!("{n}={:.4e}±{:.1e}", p.value, p.sigma.unwrap_or(0.0))).collect();
            println!("    {} {:?} {:?} {:?} share {:.3} conf {:.2} like {:?} | {}", f.effect, f.sensors, f.joints, f.links, f.share, f.confidence, f.indistinguishable_from, p.join(" "));
        }
        if verbose { println!("{d:#?}"); }
    }
}
