//! The manual page is made from the program's own arguments.
#![allow(clippy::unwrap_used)] // a test may

use std::path::Path;

use clap::CommandFactory;

use crate::Arguments;

/// What follows the arguments.
const MORE: &str = r#".SH FILES
.TP
\fI/etc/wrenchd/wrenchd.toml\fR
The daemon's configuration. The service reads it when it starts: \fBsystemctl restart wrenchd-ros2\fR after a change of \fB[publish.ros2]\fR.
.TP
\fI/run/wrenchd/control.sock\fR
Where it hears the daemon, as a member of the group \fBwrenchd\fR.
.SH SEE ALSO
\fBwrenchd\fR(1), \fBwrenchctl\fR(1)
"#;

/// The package ships it: `UPDATE_GOLDEN=1 cargo test -p wrenchd-ros2 manual` writes it.
#[test]
fn the_manual_says_what_the_program_takes() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("debian/man/wrenchd-ros2.1");
    let page = clap_mangen::Man::new(Arguments::command().disable_help_subcommand(true));
    let page = page.source(concat!("wrenchd ", env!("CARGO_PKG_VERSION")));
    let mut text = Vec::new();
    page.render(&mut text).unwrap();
    text.extend(MORE.bytes());
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&shipped, &text).unwrap();
    }
    let shipped = std::fs::read(&shipped).unwrap();
    assert!(shipped == text, "UPDATE_GOLDEN=1 accepts what it is now");
}
