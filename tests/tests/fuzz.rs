//! Each fuzz target on its seeds, whole and damaged, for a moment; cargo-fuzz goes on for hours (`tests/fuzz/run`).
#![allow(clippy::unwrap_used, clippy::panic)]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

#[allow(unreachable_pub)] // a library of its own for cargo-fuzz
#[path = "../fuzz/src/lib.rs"]
mod targets;

/// How long each target is tried.
const TIME: Duration = Duration::from_secs(1);

/// What parsers are often wrong about.
const WORDS: &[&[u8]] = &[
    b"-1",
    b"0",
    b"1e999",
    b"-1e308",
    b"nan",
    b"inf",
    b"1e-320",
    b"4294967296",
    b"18446744073709551616",
    b"\0",
    b"\xFF",
    b"\xEF\xBB\xBF",
    b"\r\n",
    b"\n",
    b"\"",
    b"[",
    b"{",
    b"<",
    b"#",
    b"= ",
    b",",
    b"\n#---\n",
];

/// A seed repeats all that is done (xorshift64*).
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        ((u128::from(self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)) * end.max(1) as u128) >> 64) as usize
    }

    /// A stretch of so many bytes at most.
    fn stretch(&mut self, length: usize, most: usize) -> std::ops::Range<usize> {
        let start = self.below(length + 1);
        start..start + self.below(most.min(length - start) + 1)
    }

    /// Changes some places, as another seed has it, by a word, or at random.
    fn damage(&mut self, data: &mut Vec<u8>, other: &[u8]) {
        for _ in 0..=self.below(4) {
            let place = self.stretch(data.len(), 16);
            match self.below(6) {
                0 if !place.is_empty() => data[place.start] ^= 1 << self.below(8),
                1 => drop(data.splice(place, [])),
                2 => drop(data.splice(place, WORDS[self.below(WORDS.len())].iter().copied())),
                3 => drop(data.splice(place, other[self.stretch(other.len(), 64)].iter().copied())),
                4 => {
                    let again = data[self.stretch(data.len(), 200)].to_vec();
                    drop(data.splice(place.start..place.start, again));
                }
                _ => data.truncate(data.len() - self.below(data.len() / 8 + 1)),
            }
        }
    }
}

/// The seeds of a target with their files, in the order of their names.
fn seeds(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.into_iter().map(|file| (file.clone(), std::fs::read(file).unwrap())).collect()
}

fn attack(name: &str) {
    let target = targets::target(name);
    let seeds = seeds(name);
    assert!(!seeds.is_empty(), "{name} has no seeds");
    for (file, data) in &seeds {
        assert!(target(data), "{} is refused", file.display());
    }
    let mut dice = Dice(0x9E37_79B9_7F4A_7C15);
    let begun = Instant::now();
    let mut tried = 0;
    while begun.elapsed() < TIME {
        let mut data = seeds[dice.below(seeds.len())].1.clone();
        let other = &seeds[dice.below(seeds.len())].1;
        dice.damage(&mut data, other);
        tried += 1;
        if catch_unwind(AssertUnwindSafe(|| target(&data))).is_err() {
            let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-broken"));
            std::fs::write(&file, &data).unwrap();
            panic!("{name} is broken by its {tried}th input, {}", file.display());
        }
    }
    println!("{name}: {tried} damaged inputs");
}

/// One test a target, so that they run beside each other and are told apart.
macro_rules! attacked {
    ($($name:ident),*) => {
        $(#[test] fn $name() { attack(stringify!($name)); })*

        #[test]
        fn every_target_is_attacked_here() {
            let names: Vec<&str> = targets::TARGETS.iter().map(|(name, _)| *name).collect();
            assert_eq!(names, [$(stringify!($name)),*]);
        }
    };
}

attacked!(candump, dbc, frames, urdf, config, model, run, comparison, rdt, http, control);

/// What once broke a parser is kept in `fuzz/found`: by now it is accepted, or refused in words.
#[test]
fn what_was_found_stays_mended() {
    for (name, target) in targets::TARGETS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/found").join(name);
        for file in std::fs::read_dir(folder).into_iter().flatten() {
            target(&std::fs::read(file.unwrap().path()).unwrap());
        }
    }
}
