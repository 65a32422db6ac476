//! From the daemon's records and status to messages.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, SystemTime};

use rig::{Config, Status};
use ros::{Diagnostic, DiagnosticArray, Level, Stamp, WrenchStamped};
use wrenchd::control::{Record, Reply, Request};
use wrenchd::view::{DaemonStatus, Live};

use crate::daemon::listen;
use crate::graph::{Node, Topic};

/// Diagnostics a second.
const DIAGNOSTICS_HZ: f64 = 1.0;
/// How long a daemon that is not there is left alone.
const PAUSE: Duration = Duration::from_secs(1);
/// Where ROS 2 collects diagnostics.
const DIAGNOSTICS: &str = "diagnostics";

/// Unusable input.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Error {
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    #[error("{}: has no [{table}] table; add it, or stop this program", file.display())]
    Absent { file: PathBuf, table: &'static str },
    #[error("[publish.ros2] cannot be served: {0}; is endpoint one such as tcp/localhost:7447?")]
    Zenoh(#[from] zenoh::Error),
}

/// What both threads publish on.
struct Outlet {
    frame_id: String,
    wrench: Mutex<Topic>,
    diagnostics: Mutex<Topic>,
}

/// Passes on until the process is ended.
pub(crate) fn run(file: &Path, humble: bool) -> Result<(), Error> {
    let config = Config::load(file)?;
    let absent = |table| Error::Absent { file: file.to_owned(), table };
    let ros2 = config.publish.ros2.as_ref().ok_or_else(|| absent("publish.ros2"))?;
    let socket = config.control.as_ref().ok_or_else(|| absent("control"))?.socket.clone();
    let mut node = Node::join(ros2.endpoint.as_deref(), ros2.domain, !humble)?;
    let outlet = Outlet {
        frame_id: ros2.frame_id.clone().unwrap_or_else(|| config.robot.tip.clone()),
        wrench: Mutex::new(node.topic::<WrenchStamped>(&ros2.topic)?),
        diagnostics: Mutex::new(node.topic::<DiagnosticArray>(DIAGNOSTICS)?),
    };
    std::thread::scope(|scope| {
        scope.spawn(|| pass_records(&socket, &outlet));
        pass_status(&socket, &outlet);
    });
    Ok(())
}

fn pass_records(socket: &Path, outlet: &Outlet) {
    let mut was_valid = None;
    loop {
        // Why it ended is told by whoever passes on the status.
        let _ = listen(socket, &Request::Records {}, |record: Record| {
            if let Some(wrench) = record.wrench {
                let message = WrenchStamped {
                    stamp: Stamp(record.instant_ns),
                    frame_id: outlet.frame_id.clone(),
                    wrench,
                };
                publish(&outlet.wrench, &message, record.published_ns);
            }
            let valid = record.wrench.is_some();
            if was_valid.replace(valid) != Some(valid) {
                outlet.tell(of_record(&record), record.published_ns);
            }
            true
        });
        was_valid = None;
        std::thread::sleep(PAUSE);
    }
}

fn pass_status(socket: &Path, outlet: &Outlet) {
    loop {
        let ended = listen(socket, &Request::Stream { rate_hz: DIAGNOSTICS_HZ }, |reply: Reply| {
            let Some(status) = reply.status else { return false };
            outlet.tell(of_status(&status), now_ns());
            true
        });
        let why = ended.err().map_or("it has stopped".to_owned(), |error| error.to_string());
        let message = format!("the daemon does not answer on {}: {why}", socket.display());
        outlet.tell(diagnostic(Level::Stale, message, Vec::new()), now_ns());
        std::thread::sleep(PAUSE);
    }
}

impl Outlet {
    fn tell(&self, status: Diagnostic, at_ns: i64) {
        publish(&self.diagnostics, &DiagnosticArray { stamp: Stamp(at_ns), status: vec![status] }, at_ns);
    }
}

fn publish(topic: &Mutex<Topic>, message: &impl ros::Message, now_ns: i64) {
    // A thread that panicked ends the process; zenoh itself connects again by itself, and what it cannot send is gone.
    if let Ok(mut topic) = topic.lock() {
        let _ = topic.publish(message, now_ns);
    }
}

fn now_ns() -> i64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |since| since.as_nanos() as i64)
}

fn diagnostic(level: Level, message: String, values: Vec<(String, String)>) -> Diagnostic {
    Diagnostic { level, name: "wrenchd: wrench".into(), message, hardware_id: String::new(), values }
}

/// A status byte and the reason, as level and words.
fn judged(status: Status, reason: Option<&str>) -> (Level, String) {
    let names: Vec<&str> = status.names().collect();
    let words = names.join(" + ");
    match reason {
        Some(reason) => (Level::Error, format!("{words}: {reason}")),
        None if status.bits() & !Status::TARED.bits() == 0 => (Level::Ok, words),
        None => (Level::Warn, words),
    }
}

fn of_record(record: &Record) -> Diagnostic {
    let (level, message) = judged(Status::from_bits(record.status), record.reason.as_deref());
    diagnostic(level, message, Vec::new())
}

fn of_status(status: &DaemonStatus) -> Diagnostic {
    let Some(live) = &status.live else {
        return diagnostic(Level::Error, "nothing published yet".into(), Vec::new());
    };
    let (level, message) = judged(Status::from_bits(live.status), live.reason.as_deref());
    let mut values = vec![
        ("published_hz".to_owned(), format!("{:.0}", status.published_hz)),
        ("age_s".to_owned(), format!("{:.6}", live.age_s)),
        ("model_sha256".to_owned(), status.model_sha256.clone()),
    ];
    values.extend(of_wrench(live));
    for gauge in &live.gauges {
        let state = if gauge.suspect { format!("{}, suspect", gauge.state) } else { gauge.state.clone() };
        values.push((format!("gauge {}", gauge.name), state));
    }
    diagnostic(level, message, values)
}

fn of_wrench(live: &Live) -> Vec<(String, String)> {
    const AXES: [&str; 6] = ["fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"];
    let mut values = Vec::new();
    for (k, axis) in AXES.iter().enumerate() {
        if let Some(sigma) = live.sigma {
            values.push((format!("sigma_{axis}"), format!("{:.5}", sigma[k])));
        }
        if let Some(protection) = live.protection {
            let level = protection[k].map_or("inf".to_owned(), |level| format!("{level:.5}"));
            values.push((format!("protection_{axis}"), level));
        }
    }
    values
}
