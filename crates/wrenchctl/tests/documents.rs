//! What the pages say is so: links lead somewhere, commands exist with their options, quoted messages are printed.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};

use wrenchctl::commands::completions::Program;

const README: &str = "README.md";
const ARCHITECTURE: &str = "crates/ARCHITECTURE.md";
const TROUBLESHOOTING: &str = "crates/TROUBLESHOOTING.md";
const PAGES: [&str; 5] = [README, ARCHITECTURE, TROUBLESHOOTING, "CHANGELOG.md", "tests/captures/README.md"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn page(name: &str) -> String {
    std::fs::read_to_string(root().join(name)).unwrap()
}

/// Targets of `[text](target)`.
fn links(text: &str) -> Vec<&str> {
    text.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target).collect()
}

/// What stands between backticks, and the lines that are set in by four spaces.
fn code(text: &str) -> Vec<&str> {
    let spans = text.split('`').skip(1).step_by(2).filter(|span| !span.contains('\n'));
    spans.chain(text.lines().filter_map(|line| line.strip_prefix("    "))).map(str::trim).collect()
}

/// The name that a heading is linked by.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).collect::<String>().replace(' ', "-")
}

fn broken_link(from: &str, target: &str) -> Option<String> {
    if target.starts_with("http") {
        return None;
    }
    let (file, heading) = target.split_once('#').unwrap_or((target, ""));
    let path =
        if file.is_empty() { root().join(from) } else { root().join(from).parent().unwrap().join(file) };
    let known = |text: String| {
        text.lines().any(|line| line.starts_with('#') && anchor(line.trim_start_matches('#')) == heading)
    };
    let is_good = path.exists() && (heading.is_empty() || known(std::fs::read_to_string(&path).unwrap()));
    (!is_good).then(|| format!("{from}: {target} leads nowhere"))
}

#[test]
fn links_lead_somewhere() {
    let mut seen = 0;
    for from in PAGES {
        let text = page(from);
        let broken: Vec<String> =
            links(&text).into_iter().filter_map(|target| broken_link(from, target)).collect();
        assert_eq!(broken, Vec::<String>::new());
        seen += links(&text).len();
    }
    assert!(seen >= 8, "{seen} links");
    assert!(
        broken_link(README, "crates/NONE.md").is_some() && broken_link(README, "#no-such-heading").is_some()
    );
    assert_eq!(broken_link(README, "#install-it"), None);
}

/// Files and folders that are named in code, by their path from the top.
#[test]
fn named_paths_exist() {
    let mut seen = 0;
    for from in [README, ARCHITECTURE, TROUBLESHOOTING] {
        let text = page(from);
        let tops = ["crates/", "config/", "systemd/", "tests/"];
        let words = code(&text).into_iter().flat_map(str::split_whitespace);
        for path in words.filter(|word| tops.iter().any(|top| word.starts_with(top))) {
            let path = path.split([':', ',', ';', ')']).next().unwrap();
            assert!(root().join(path).exists(), "{from}: {path} is not there");
            seen += 1;
        }
    }
    assert!(seen >= 20, "{seen} paths");
}

/// What is wrong with a command line of one of the programs, as far as names go; none where it is no such line.
fn wrong_name(line: &str) -> Option<String> {
    let words: Vec<&str> =
        line.split('#').next()?.split_whitespace().map(|word| word.trim_matches(['[', ']', '.'])).collect();
    let place = |name: &str| words.iter().position(|word| word.rsplit('/').next() == Some(name));
    let mut command;
    let daemon = place("wrenchd").filter(|_| words[0] != "cargo");
    let rest =
        if let Some(at) = daemon.filter(|at| words.get(at + 1).is_some_and(|word| word.starts_with("--"))) {
            command = Program::Wrenchd.command();
            &words[at + 1..]
        } else {
            command = Program::Wrenchctl.command();
            command.build();
            // `wrenchctl COMMAND ...`, `cargo run --bin wrenchctl -- COMMAND ...`, or the command with an option alone.
            let rest = match place("wrenchctl") {
                Some(at) => &words[at + 1..],
                None if words.get(1).is_some_and(|word| word.starts_with("--"))
                    && command.find_subcommand(words[0]).is_some() =>
                {
                    &words[..]
                }
                None => return None,
            };
            let rest = rest.strip_prefix(&["--"]).unwrap_or(rest);
            // Its name alone, other programs' options, or words of a sentence in a shell's remark.
            let name = rest.first().filter(|word| {
                word.chars().all(|c| c.is_ascii_lowercase()) && !line.contains("cargo build")
            })?;
            let Some(found) = command.find_subcommand(name) else {
                return Some(format!("{line}: wrenchctl has no {name}"));
            };
            command = found.clone();
            &rest[1..]
        };
    let known = |option: &str| command.get_arguments().any(|argument| argument.get_long() == Some(option));
    let options = rest
        .iter()
        .filter_map(|word| word.strip_prefix("--"))
        .map(|word| word.split(['=', '|']).next().unwrap_or(word));
    options
        .into_iter()
        .find(|option| !known(option))
        .map(|option| format!("{line}: {} has no --{option}", command.get_name()))
}

#[test]
fn named_commands_and_options_exist() {
    let mut seen = 0;
    for from in [README, ARCHITECTURE, TROUBLESHOOTING] {
        let text = page(from);
        for line in code(&text) {
            assert_eq!(wrong_name(line), None, "{from}");
            seen += usize::from(line.contains("wrenchctl ") || line.contains("wrenchd --"));
        }
    }
    assert!(seen >= 20, "{seen} commands");
    for wrong in [
        "wrenchctl calibrat runs",
        "sudo wrenchctl check --modle m",
        "wrenchd --conf x",
        "validate --jsn -",
        "cargo run --bin wrenchctl -- dmo",
    ] {
        assert!(wrong_name(wrong).is_some(), "{wrong}");
    }
    for right in [
        "wrenchctl check arm.toml [--model m]",
        "wrenchd --config a --model b",
        "calibrate --report",
        "cargo run --bin wrenchctl -- demo",
    ] {
        assert_eq!(wrong_name(right), None);
    }
}

/// Every command is named where a user begins.
#[test]
fn the_readme_names_every_command() {
    let text = page(README);
    for command in Program::Wrenchctl.command().get_subcommands() {
        assert!(text.contains(command.get_name()), "the README lacks {}", command.get_name());
    }
}

/// All string literals of the programs, as the compiler reads them, those of tests included.
fn literals() -> Vec<String> {
    let mut folders = vec![root().join("crates")];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let is_test = path
                .file_name()
                .is_some_and(|name| name == "tests" || name == "tests.rs" || name == "benches");
            if path.is_dir() && !is_test {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") && !is_test {
                let text = std::fs::read_to_string(path).unwrap();
                collect_literals(text.split("#[cfg(test)]\nmod tests {").next().unwrap(), &mut found);
            }
        }
    }
    found
}

/// Reads code roughly: comments of a line are skipped, a backslash at a line's end joins it with the next.
fn collect_literals(code: &str, found: &mut Vec<String>) {
    let mut rest = code;
    while let Some(at) = rest.find(['"', '/', '\'']) {
        let (here, after) = (rest.as_bytes()[at], &rest[at + 1..]);
        match here {
            b'/' if after.starts_with('/') => rest = after.split_once('\n').map_or("", |(_, next)| next),
            // A quotation mark as a character.
            b'\'' if after.starts_with("\"'") => rest = &after[2..],
            b'"' => rest = literal(after, found),
            _ => rest = after,
        }
    }
}

/// Takes one literal behind its opening mark; what follows it.
fn literal<'a>(text: &'a str, found: &mut Vec<String>) -> &'a str {
    let mut words = String::new();
    let mut characters = text.char_indices().peekable();
    while let Some((at, character)) = characters.next() {
        match character {
            '"' => {
                found.push(words);
                return &text[at + 1..];
            }
            '\\' => match characters.next() {
                Some((_, '\n')) => while characters.next_if(|(_, c)| c.is_whitespace()).is_some() {},
                Some((_, other)) => words.push(other),
                None => {}
            },
            other => words.push(other),
        }
    }
    ""
}

/// Whether all parts are there in this order.
fn holds(literal: &str, parts: &[&str]) -> bool {
    let mut rest = literal;
    parts.iter().all(|part| {
        let found = rest.split_once(part);
        rest = found.map_or("", |(_, after)| after);
        found.is_some()
    })
}

#[test]
fn quoted_messages_are_printed() {
    let literals = literals();
    let text = page(TROUBLESHOOTING);
    let printed = |message: &str| {
        let parts: Vec<&str> = message.split('…').filter(|part| !part.is_empty()).collect();
        literals.iter().any(|literal| holds(literal, &parts))
    };
    let quoted: Vec<&str> = text
        .lines()
        .filter(|line| line.starts_with("- `"))
        .flat_map(|line| line.split("`:").next().unwrap().split('`').skip(1).step_by(2))
        .collect();
    assert!(quoted.len() >= 25, "{quoted:?}");
    let missing: Vec<&&str> = quoted.iter().filter(|message| !printed(message)).collect();
    assert!(missing.is_empty(), "nothing in the sources prints {missing:#?}");
    assert!(!printed("the daemon has … a headache"));
}
