//! Manual pages are made from the programs' own arguments, and shells complete every command.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::process::Command;

use wrenchctl::commands::completions::Program;

/// What follows the arguments in the manual of the daemon.
const WRENCHD: &str = r#".SH SIGNALS
.TP
\fBSIGHUP\fR
Read configuration and model again; the old ones stay if the new are bad.
.TP
\fBSIGTERM\fR
Stop cleanly.
.SH FILES
.TP
\fI/etc/wrenchd/wrenchd.toml\fR
The configuration of the service, which starts at boot as soon as it is there:
\fI/usr/share/doc/wrenchd/examples/arm.toml\fR has every key with a remark.
.TP
\fI/run/wrenchd/control.sock\fR
The control socket, for members of the group \fBwrenchd\fR.
.TP
\fI/usr/share/wrenchd/wrench.dbc\fR
The published CAN frames.
.SH SEE ALSO
\fBwrenchctl\fR(1), \fBcandump\fR(1)
"#;

/// What follows the commands in the manual of the tool.
const WRENCHCTL: &str = r#".SH FILES
.TP
\fI/run/wrenchd/control.sock\fR
Where a running daemon is asked and told, by members of the group \fBwrenchd\fR.
.SH SEE ALSO
\fBwrenchd\fR(1)
"#;

fn commands() -> Vec<String> {
    let command = Program::Wrenchctl.command();
    command.get_subcommands().map(|command| command.get_name().to_owned()).collect()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The pages of both programs: one each, and one a command.
fn write_pages(folder: &Path) {
    for (program, more) in [(Program::Wrenchd, WRENCHD), (Program::Wrenchctl, WRENCHCTL)] {
        let mut command = program.command().disable_help_subcommand(true);
        command.build();
        write_page(folder, &command, more);
        command.get_subcommands().for_each(|command| write_page(folder, command, ""));
    }
}

fn write_page(folder: &Path, command: &clap::Command, more: &str) {
    let name = command.get_display_name().unwrap_or(command.get_name());
    let page = clap_mangen::Man::new(command.clone()).source(concat!("wrenchd ", env!("CARGO_PKG_VERSION")));
    let mut text = Vec::new();
    page.render(&mut text).unwrap();
    text.extend(more.bytes());
    std::fs::write(folder.join(name).with_extension("1"), text).unwrap();
}

/// The package ships them: `UPDATE_GOLDEN=1 cargo test -p wrenchctl --test manual` writes them.
#[test]
fn the_manual_says_what_the_programs_take() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../wrenchd/debian/man");
    let made = tempfile::tempdir().unwrap();
    write_pages(made.path());
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        let _ = std::fs::remove_dir_all(&shipped);
        std::fs::create_dir_all(&shipped).unwrap();
        write_pages(&shipped);
    }
    assert_eq!(names(&shipped), names(made.path()), "UPDATE_GOLDEN=1 writes them");
    for name in names(made.path()) {
        let page = |folder: &Path| std::fs::read_to_string(folder.join(&name)).unwrap();
        assert_eq!(page(&shipped), page(made.path()), "{name}; UPDATE_GOLDEN=1 accepts what it is now");
    }
}

#[test]
fn every_command_has_a_page_that_the_main_one_names() {
    let made = tempfile::tempdir().unwrap();
    write_pages(made.path());
    let main = std::fs::read_to_string(made.path().join("wrenchctl.1")).unwrap();
    let mut expected: Vec<String> =
        commands().iter().map(|command| format!("wrenchctl-{command}.1")).collect();
    for command in commands() {
        assert!(main.contains(&format!("wrenchctl\\-{command}(1)")), "{command}");
    }
    expected.extend(["wrenchctl.1".to_owned(), "wrenchd.1".to_owned()]);
    expected.sort();
    assert_eq!(names(made.path()), expected);
}

fn script(shell: &str, program: &str) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wrenchctl"));
    let output = command.args(["completions", shell, program]).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn every_shell_knows_every_command() {
    for shell in ["bash", "zsh", "fish"] {
        let tool = script(shell, "wrenchctl");
        for command in commands() {
            assert!(tool.contains(&command), "{shell} lacks {command}");
        }
        let daemon = script(shell, "wrenchd");
        for option in ["config", "model", "record"] {
            assert!(daemon.contains(option), "{shell} lacks --{option} of wrenchd");
        }
    }
}

/// What bash offers for an unfinished word, the last of `words`.
fn completed(words: &[&str]) -> Vec<String> {
    let (program, last) = (words[0], words.len() - 1);
    let folder = tempfile::tempdir().unwrap();
    let file: PathBuf = folder.path().join("script");
    std::fs::write(&file, script("bash", program)).unwrap();
    let ask = format!(
        "source {}; COMP_WORDS=({}) COMP_CWORD={last}; _{program} {program} '{}' '{}'; echo \"${{COMPREPLY[@]}}\"",
        file.display(),
        words.join(" "),
        words[last],
        words[last - 1]
    );
    let output = Command::new("bash").args(["-c", &ask]).output().unwrap();
    assert!(output.stderr.is_empty(), "{output:?}");
    String::from_utf8(output.stdout).unwrap().split_ascii_whitespace().map(str::to_owned).collect()
}

#[test]
fn bash_completes_commands_and_options() {
    for command in commands() {
        assert!(completed(&["wrenchctl", &command]).contains(&command), "{command}");
    }
    assert_eq!(completed(&["wrenchctl", "cali"]), ["calibrate"]);
    assert_eq!(completed(&["wrenchctl", "check", "--mo"]), ["--model"]);
    assert_eq!(completed(&["wrenchd", "--re"]), ["--record"]);
}
