//! Pages as a person sees them: laid out by headless Chromium, which is installed where there is none.

use crate::packages::{self, Tool};
use crate::process;
use crate::scratch::target_dir;
use crate::{Check, Failure, IoContext};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const LOOK_LIMIT: Duration = Duration::from_secs(120);
const PROBE: &str = include_str!("../browser/probe.js");
/// Other names of the same browser, where it is already there.
const KNOWN: [&str; 4] = ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"];
const CHROMIUM: Tool =
    Tool { program: "chromium-headless-shell", package: "chromium-headless-shell fonts-dejavu-core" };

/// How a page is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View {
    /// The window's width, px.
    pub width: u32,
    /// Whether the reader prefers dark pages.
    pub dark: bool,
}

/// What is seen of a page, as the JSON that `browser/probe.js` makes of it. `name` tells this look from others at the same time.
pub fn look(page: &Path, name: &str, view: View) -> Check<String> {
    let browser = match KNOWN.into_iter().find_map(packages::find) {
        Some(browser) => browser,
        None => packages::require(&[&CHROMIUM])?.remove(0),
    };
    let dir = target_dir()?.join("browser").join(format!("{}-{name}", std::process::id()));
    fs::create_dir_all(&dir).at("create", &dir)?;
    let seen = probe(&browser, page, &dir, view);
    let _ = fs::remove_dir_all(&dir);
    seen
}

fn probe(browser: &Path, page: &Path, dir: &Path, view: View) -> Check<String> {
    let html = fs::read_to_string(page).at("read", page)?;
    let copy = dir.join("page.html");
    fs::write(&copy, with_probe(&html)?).at("write", &copy)?;
    let mut command = Command::new(browser);
    command.args([
        "--headless",
        "--disable-gpu",
        "--no-first-run",
        "--disable-dev-shm-usage",
        "--hide-scrollbars",
    ]);
    // As root, as in most containers, the browser has no sandbox.
    if nix::unistd::geteuid().is_root() {
        command.arg("--no-sandbox");
    }
    let scheme = if view.dark { 0 } else { 1 };
    command.arg(format!("--blink-settings=preferredColorScheme={scheme}"));
    command.arg(format!("--window-size={},1200", view.width));
    command.arg(format!("--user-data-dir={}", dir.join("profile").display()));
    command.args(["--virtual-time-budget=2000", "--dump-dom"]);
    let said = process::run(command.arg(format!("file://{}", copy.display())), LOOK_LIMIT)?.stdout();
    let seen = said.split_once("<pre id=\"seen\">").and_then(|(_, rest)| rest.split_once("</pre>"));
    seen.map(|(json, _)| json.to_owned()).ok_or_else(|| {
        Failure::new(format!("{} shows nothing of {}; it said:\n{said}", browser.display(), page.display()))
    })
}

/// The page with the probe in it; its own policy would not let any script run.
fn with_probe(html: &str) -> Check<String> {
    let missing = |what: &str| Failure::new(format!("the page has no {what}"));
    let (before, rest) = html
        .split_once("<meta http-equiv=\"Content-Security-Policy\"")
        .ok_or_else(|| missing("policy against scripts"))?;
    let (_, after) = rest.split_once('>').ok_or_else(|| missing("end of its policy"))?;
    let (body, end) = after.rsplit_once("</body>").ok_or_else(|| missing("end"))?;
    Ok(format!("{before}{body}<script id=\"probe\">{PROBE}</script></body>{end}"))
}
