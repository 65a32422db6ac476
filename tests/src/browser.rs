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
/// What looks at a live page from within: whoever serves the page puts it at the end.
pub const LIVE_PROBE: &str = include_str!("../browser/live.js");
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
    in_folder(name, |dir| {
        let html = fs::read_to_string(page).at("read", page)?;
        let copy = dir.join("page.html");
        fs::write(&copy, with_probe(&html)?).at("write", &copy)?;
        let mut command = browser(dir, view)?;
        seen(&dump(command.args(["--virtual-time-budget=2000", &format!("file://{}", copy.display())]))?)
    })
}

/// What is seen of a page that is served with [`LIVE_PROBE`] at its end, as the JSON that this makes of it. What it looked like
/// stays in the build directory as `browser/NAME.html` and `browser/NAME.png`.
pub fn watch(url: &str, name: &str) -> Check<String> {
    in_folder(name, |dir| {
        let view = View { width: 1100, dark: false };
        let page = dump(browser(dir, view)?.args(["--virtual-time-budget=3000", url]))?;
        let still = dir.with_file_name(format!("{name}.html"));
        fs::write(&still, &page).at("write", &still)?;
        // The browser may not come to an end where it is to take a picture of a page that goes on asking for news.
        let mut command = browser(dir, view)?;
        command.arg(format!("--screenshot={}", still.with_extension("png").display()));
        process::run(command.arg(format!("file://{}", still.display())), LOOK_LIMIT)?;
        seen(&page)
    })
}

fn in_folder(name: &str, look: impl FnOnce(&Path) -> Check<String>) -> Check<String> {
    let dir = target_dir()?.join("browser").join(format!("{}-{name}", std::process::id()));
    fs::create_dir_all(&dir).at("create", &dir)?;
    let seen = look(&dir);
    let _ = fs::remove_dir_all(&dir);
    seen
}

/// The browser with nothing to open yet, its files in this directory.
fn browser(dir: &Path, view: View) -> Check<Command> {
    let browser = match KNOWN.into_iter().find_map(packages::find) {
        Some(browser) => browser,
        None => packages::require(&[&CHROMIUM])?.remove(0),
    };
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
    Ok(command)
}

/// The page as it is in the end.
fn dump(command: &mut Command) -> Check<String> {
    Ok(process::run(command.arg("--dump-dom"), LOOK_LIMIT)?.stdout())
}

/// What a probe left in the page.
fn seen(page: &str) -> Check<String> {
    let behind = page.split_once("<pre id=\"seen\"").and_then(|(_, rest)| rest.split_once('>'));
    let seen = behind.and_then(|(_, rest)| rest.split_once("</pre>"));
    seen.map(|(json, _)| json.to_owned())
        .ok_or_else(|| Failure::new(format!("the browser shows nothing of the page, only:\n{page}")))
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
