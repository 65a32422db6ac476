//! The README's picture of the live page.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::process::Command;
use std::time::Duration;

use model::spatial::Wrench;
use nalgebra::Vector3;
use rig::config::PublishMode;
use sim::motion::{MotionLimits, Sine, Sines};
use sim::{Options, Scenario, Simulator, Trajectory};

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

/// Passes requests on to the daemon, each after a while.
fn slow_door(daemon: SocketAddr) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for mut client in listener.incoming().flatten() {
            let mut request = [0; 4096];
            let length = client.read(&mut request).unwrap_or(0);
            let request = String::from_utf8_lossy(&request[..length]).into_owned();
            let path = request.split(' ').nth(1).unwrap_or("/").to_owned();
            std::thread::sleep(ANSWER);
            let _ = client.write_all(http_get(daemon, &path).as_bytes());
        }
    });
    address
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
        .args([format!("--screenshot={picture}"), format!("http://{}/", slow_door(address))])
        .status()
        .expect("chromium-headless-shell is there");
    assert!(status.success(), "{status}");
}
