//! The blind benchmark: sessions with known effects from the simulator, whose forms are not those that a diagnosis fits (and which
//! the library cannot use: it is a dependency of tests and examples only), and what the diagnosis makes of them.
//!
//! ```text
//! cargo run --release -p wrenchd-gap --example blind [-- OPTIONS]
//!   --short             a minute's worth of it
//!   --arms N            arms of other lengths, masses and gauges (4)
//!   --seed S            seed of all (1000); development and reported figures want different ones
//!   --sizes A,B,..      sizes in noise floors (0.3,1,3,10)
//!   --nulls N --pairs N --triples N    sessions of these an arm
//!   --only NAME,..      only effects whose names begin so
//!   --most N            at most so many sessions
//!   --session A,B,..    only the sessions of these seeds, as --lines gives them (hexadecimal)
//!   --jobs N            sessions at a time (2)
//!   --readme            writes the tables into README.md between its marks
//!   --lines FILE        every session in a line
//! ```
//!
//! A *size* is the RMS change over the session, in noise floors, on the gauge that shows the effect most.

mod arms;
mod plan;
mod random;
mod score;
mod session;
mod table;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use arms::Arm;
use plan::{Case, Extent};
use score::Outcome;

type Error = Box<dyn std::error::Error + Send + Sync>;
type Result<T> = std::result::Result<T, Error>;

struct Options {
    extent: Extent,
    most: usize,
    sessions: Vec<u64>,
    jobs: usize,
    readme: bool,
    lines: Option<PathBuf>,
}

fn main() -> Result<()> {
    let options = options(std::env::args().skip(1))?;
    let began = Instant::now();
    let arms =
        (0..options.extent.arms as u64).map(|arm| Arm::new(options.extent.seed.wrapping_mul(31) + arm));
    let arms = arms.collect::<Result<Vec<Arm>>>()?;
    let mut cases = options.extent.cases();
    cases.retain(|case| options.sessions.is_empty() || options.sessions.contains(&case.seed));
    cases.truncate(options.most);
    eprintln!(
        "{} arms calibrated in {:.0} s, {} sessions",
        arms.len(),
        began.elapsed().as_secs_f64(),
        cases.len()
    );
    let outcomes = all(&cases, &arms, &options, began)?;
    let text = format!(
        "{} sessions of {} arms, seed {}, in {:.0} s, {} at a time. *Size*: RMS change in noise floors on the gauge that shows it most.\n\n{}",
        outcomes.len(),
        arms.len(),
        options.extent.seed,
        began.elapsed().as_secs_f64(),
        options.jobs,
        table::of(&outcomes)
    );
    println!("{text}");
    if options.readme {
        let readme = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../README.md"));
        std::fs::write(readme, between_marks(&std::fs::read_to_string(readme)?, &text)?)?;
    }
    Ok(())
}

/// All cases, several at a time; what cannot be recorded (an effect that does not show in that motion) is said and left out.
fn all(cases: &[Case], arms: &[Arm], options: &Options, began: Instant) -> Result<Vec<Outcome>> {
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::with_capacity(cases.len())));
    let lines = options.lines.as_ref().map(std::fs::File::create).transpose()?.map(Mutex::new);
    let work = || {
        while let Some((index, case)) = cases
            .get(next.load(Ordering::Relaxed))
            .map(|_| next.fetch_add(1, Ordering::Relaxed))
            .and_then(|k| Some((k, cases.get(k)?)))
        {
            let (outcome, line) = match score::run(case, &arms[case.arm]) {
                Ok(outcome) => (Some(outcome.clone()), outcome.line),
                Err(error) => (None, format!("skipped: {error}")),
            };
            if let Some(Ok(mut file)) = lines.as_ref().map(Mutex::lock) {
                let _written = writeln!(file, "{line}");
            }
            eprint!("\r{} of {} sessions, {:.0} s ", index + 1, cases.len(), began.elapsed().as_secs_f64());
            if let Ok(mut done) = done.lock() {
                done.extend(outcome.map(|outcome| (index, outcome)));
            }
        }
    };
    std::thread::scope(|scope| (0..options.jobs).for_each(|_| drop(scope.spawn(work))));
    eprintln!();
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(index, _)| *index);
    Ok(done.into_iter().map(|(_, outcome)| outcome).collect())
}

fn options(mut args: impl Iterator<Item = String>) -> Result<Options> {
    let extent = Extent {
        arms: 4,
        sizes: vec![0.3, 1.0, 3.0, 10.0],
        nulls: 25,
        pairs: 15,
        triples: 8,
        seed: 1000,
        only: None,
    };
    let mut options =
        Options { extent, most: usize::MAX, sessions: Vec::new(), jobs: 2, readme: false, lines: None };
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or_else(|| format!("{arg} wants a value"));
        let extent = &mut options.extent;
        match arg.as_str() {
            "--short" => (extent.arms, extent.nulls, options.most) = (1, 8, 24),
            "--arms" => extent.arms = value()?.parse()?,
            "--seed" => extent.seed = value()?.parse()?,
            "--sizes" => {
                extent.sizes = value()?.split(',').map(str::parse).collect::<std::result::Result<_, _>>()?;
            }
            "--nulls" => extent.nulls = value()?.parse()?,
            "--pairs" => extent.pairs = value()?.parse()?,
            "--triples" => extent.triples = value()?.parse()?,
            "--only" => extent.only = Some(value()?),
            "--most" => options.most = value()?.parse()?,
            "--session" => {
                let seeds = value()?;
                let seeds = seeds.split(',').map(|seed| u64::from_str_radix(seed, 16));
                options.sessions = seeds.collect::<std::result::Result<_, _>>()?;
            }
            "--jobs" => options.jobs = value()?.parse()?,
            "--readme" => options.readme = true,
            "--lines" => options.lines = Some(value()?.into()),
            _ => return Err(format!("{arg} is no option; see the top of examples/blind/main.rs").into()),
        }
    }
    Ok(options)
}

const FROM: &str = "<!-- blind benchmark: from here -->";
const TO: &str = "<!-- blind benchmark: to here -->";

/// The page with the text between its marks.
fn between_marks(page: &str, text: &str) -> Result<String> {
    let missing = || format!("README.md has no line \"{FROM}\" with \"{TO}\" after it");
    let from = page.find(FROM).ok_or_else(missing)? + FROM.len();
    let to = from + page[from..].find(TO).ok_or_else(missing)?;
    Ok(format!("{}\n{}\n{}", &page[..from], text.trim_end(), &page[to..]))
}
