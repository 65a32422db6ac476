//! The live page in a browser: what it shows, and the README's picture of it.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::Command;
use std::time::Duration;

use model::spatial::Wrench;
use nalgebra::Vector3;
use rig::config::PublishMode;
use sim::motion::{MotionLimits, Sine, Sines};
use sim::{Options, Scenario, Simulator, Trajectory};

use wrenchd_tests::browser;

use super::{Daemon, RATE_HZ, free_tcp, http_get, wait_for};
use crate::common::{rig, truth};

/// How long the arm moves and is pushed.
const SECONDS: f64 = 120.0;

/// The browser's own clock runs ahead whenever it has nothing to wait for: each answer takes so long that it hardly can.
const ANSWER: Duration = Duration::from_millis(80);

/// The arm swinging slowly, pushed now and then.
fn pushed() -> Simulator {
    let rig = rig(PublishMode::Event);
    let limits = MotionLimits::of(&rig.chain).unwrap();
    let pose = vec![0.2, -0.9, 0.8, 0.3, -0.7, 0.4];
    let term = |k: usize| {
        vec![Sine { amplitude_rad: 0.2, frequency_hz: 0.1 + 0.02 * k as f64, phase_rad: k as f64 }]
    };
    let mut trajectory = Trajectory::from_pose(pose.clone());
    trajectory.swing(Sines::new(pose, (0..6).map(term).collect(), SECONDS, 2.0, &limits, 0.5));
    let mut scenario = Scenario::of_motion(trajectory);
    for (number, from_s) in (0..).map(|k| (k, 2.0 + 3.0 * f64::from(k))).take_while(|(_, t)| *t < SECONDS) {
        let turn = f64::from(number);
        let force = Vector3::new(6.0 * turn.cos(), 6.0 * turn.sin(), 4.0 * (0.7 * turn).cos());
        let moment = Vector3::new(0.4 * turn.sin(), 0.3 * turn.cos(), 0.5 * (1.3 * turn).sin());
        scenario.push.trapezoid(from_s, from_s + 2.0, 0.5, Wrench::new(force, moment));
    }
    let options = Options { rate_hz: Some(RATE_HZ), ..Options::default() };
    Simulator::new(&rig, truth(&rig), &scenario, options).unwrap()
}

/// Passes requests on to the daemon, each after a while. The page gets a script at its end.
fn slow_door(daemon: SocketAddr, script: &'static str) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        // A browser opens connections ahead that ask for nothing: each has a thread.
        for client in listener.incoming().flatten() {
            std::thread::spawn(move || answer_slowly(client, daemon, script));
        }
    });
    address
}

fn answer_slowly(mut client: TcpStream, daemon: SocketAddr, script: &str) {
    let mut request = [0; 4096];
    let length = client.read(&mut request).unwrap_or(0);
    let request = String::from_utf8_lossy(&request[..length]).into_owned();
    let Some(path) = request.split(' ').nth(1) else { return };
    std::thread::sleep(ANSWER);
    let answer = http_get(daemon, path);
    let answer = if path == "/" { with_script(&answer, script) } else { answer };
    let _ = client.write_all(answer.as_bytes());
}

/// The page with a script at its end, and its length as it is then.
fn with_script(answer: &str, script: &str) -> String {
    let (head, page) = answer.split_once("\r\n\r\n").unwrap();
    let head: Vec<&str> =
        head.lines().filter(|line| !line.to_ascii_lowercase().starts_with("content-length")).collect();
    let page = page.replace("</body>", &format!("<script>{script}</script></body>"));
    format!("{}\r\nContent-Length: {}\r\n\r\n{page}", head.join("\r\n"), page.len())
}

fn seen(door: SocketAddr, name: &str) -> serde_json::Value {
    serde_json::from_str(&browser::watch(&format!("http://{door}/"), name).unwrap()).unwrap()
}

#[test]
fn the_live_page_shows_the_wrench_the_gauges_and_how_it_is() {
    let address = free_tcp();
    let daemon = Daemon::start_on(&format!("[publish.metrics]\nbind = \"{address}\"\n"), pushed());
    wait_for("health", || http_get(address, "/health").contains(" 200 "));
    let door = slow_door(address, browser::LIVE_PROBE);
    let page = seen(door, "live");
    let axes = page["axes"].as_array().unwrap();
    let names: Vec<&str> = axes.iter().map(|axis| axis["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["Fx, N", "Fy, N", "Fz, N", "Tx, Nm", "Ty, Nm", "Tz, Nm"], "{page:#}");
    for axis in axes {
        let words: Vec<&str> = axis["value"].as_str().unwrap().split(" \u{b1} ").collect();
        let numbers: Vec<f64> = words.iter().map(|word| word.parse().unwrap()).collect();
        assert!(numbers.len() == 2 && numbers[1] > 0.0, "{axis}");
        assert!(axis["hides"].as_str().unwrap().starts_with("one faulty gauge can hide "), "{axis}");
        // Twenty seconds are some 300 columns.
        assert!(axis["trace"].as_u64().unwrap() > 20, "nothing is drawn: {axis}");
    }
    assert_eq!((&page["state"], &page["reason"]), (&"good".into(), &"".into()), "{page:#}");
    let gauges = page["gauges"].as_array().unwrap();
    assert_eq!(gauges.len(), 8, "{page:#}");
    for (number, row) in (1..).zip(gauges) {
        assert_eq!((&row[0], &row[1]), (&format!("s{number}").into(), &"used".into()), "{row}");
        assert!(row[3].as_str().unwrap().parse::<f64>().unwrap().abs() < 8.0, "{row}");
    }
    let fact = |name: &str| page["facts"][name].as_str().unwrap_or_else(|| panic!("no {name}: {page:#}"));
    assert!(fact("published").ends_with(" Hz, event") && fact("parity").ends_with(", 2 spare"), "{page:#}");
    daemon.silence(true);
    wait_for("its end", || http_get(address, "/health").contains(" 503 "));
    let page = seen(door, "live-silent");
    assert!(page["state"].as_str().unwrap().contains("invalid") && page["reason"] != "", "{page:#}");
    for axis in page["axes"].as_array().unwrap() {
        assert_eq!((&axis["value"], axis["trace"].as_u64()), (&"\u{2013}".into(), Some(0)), "{axis}");
    }
}

/// `tests/pictures/make` calls it with the file to write.
#[test]
#[ignore = "makes a picture, which needs a browser"]
fn of_the_live_page() {
    let picture = std::env::var("WRENCHD_PICTURE").expect("WRENCHD_PICTURE names the file to write");
    let address = free_tcp();
    let _daemon = Daemon::start_on(&format!("[publish.metrics]\nbind = \"{address}\"\n"), pushed());
    wait_for("health", || http_get(address, "/health").contains(" 200 "));
    let status = Command::new("chromium-headless-shell")
        .args(["--no-sandbox", "--hide-scrollbars", "--window-size=1100,900", "--virtual-time-budget=40000"])
        .args([format!("--screenshot={picture}"), format!("http://{}/", slow_door(address, ""))])
        .status()
        .expect("chromium-headless-shell is there");
    assert!(status.success(), "{status}");
}
