fn main() {
    let dir = std::env::args().nth(1).unwrap();
    let s = wrenchd_gap::comparison::load(std::path::Path::new(&dir)).unwrap_or_else(|e| {
        eprintln!("{e}");
        std::process::exit(2)
    });
    let t = std::time::Instant::now();
    let d = wrenchd_gap::diagnose(&s, |_, _| {});
    println!("{:?} {:?} took {:?}", d.verdict, d.gap, t.elapsed());
    for f in &d.findings {
        println!(
            "{} {:?}\n  {:?}{:?}{:?} share {:.3} {:?} conf {:.2} ind {:?}",
            f.words,
            f.parameters
                .iter()
                .map(|(k, p)| format!("{k}={:.4}±{:.4}", p.value, p.sigma.unwrap_or(f64::NAN)))
                .collect::<Vec<_>>(),
            f.sensors,
            f.joints,
            f.links,
            f.share,
            f.share_ci95,
            f.confidence,
            f.indistinguishable_from
        );
    }
    for s in &d.location.sensors {
        println!("  {} {:.4} -> {:.4} {}", s.name, s.before_raw, s.after_raw, s.unit);
    }
    println!("{}\n{:?}", d.next_experiment, d.notes);
}
