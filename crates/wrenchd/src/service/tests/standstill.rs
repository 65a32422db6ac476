//! A cycle that stands still: no client is told its last wrench as if it were one of now.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use can::source::{Batch, Poll, Source};
use rig::Status;
use rig::config::PublishMode;

use super::{Daemon, LOAD, RATE_HZ, control_line, free_tcp, http_get, wait_for};
use crate::common::{holding, rig};
use crate::control::Reply;
use crate::view::Live;

/// A source in which the cycle gets stuck while this is up.
struct Sticky<S>(S, Arc<AtomicBool>);

impl<S: Source> Source for Sticky<S> {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> can::Result<Poll> {
        while self.1.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.0.poll(batch, timeout)
    }
}

/// Lets the cycle go on when a test ends, however it does.
struct Hold(Arc<AtomicBool>);

impl Drop for Hold {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// The newest instant by two commands of the control socket.
fn told(daemon: &Daemon) -> [Live; 2] {
    let live =
        |line| serde_json::from_str::<Reply>(&control_line(daemon, line)).unwrap().status.unwrap().live;
    [r#"{"command":"status"}"#, r#"{"command":"stream"}"#].map(|line| live(line).unwrap())
}

#[test]
fn the_last_wrench_of_a_cycle_that_stands_still_is_none() {
    let address = free_tcp();
    let stuck = Arc::new(AtomicBool::new(false));
    let arm = holding(&rig(PublishMode::Event), RATE_HZ, LOAD);
    let more = format!("[publish.metrics]\nbind = \"{address}\"\n");
    let daemon = Daemon::start_through(&more, arm, |source| Box::new(Sticky(source, stuck.clone())));
    // Behind the daemon, whose end waits for the cycle's.
    let hold = Hold(stuck.clone());
    let health = || http_get(address, "/health");
    wait_for("a wrench", || health().starts_with("HTTP/1.1 200 "));
    assert!(told(&daemon).iter().all(|live| live.wrench.is_some()));
    stuck.store(true, Ordering::Relaxed);
    wait_for("the standstill to be told", || health().starts_with("HTTP/1.1 503 "));
    assert!(health().contains("stands still"), "{}", health());
    let metrics = http_get(address, "/metrics");
    for line in ["healthy 0", "status{bit=\"invalid\"} 1", "status{bit=\"stale\"} 1"] {
        assert!(metrics.contains(&format!("\nwrenchd_{line}\n")), "{line}: {metrics}");
    }
    assert!(!metrics.contains("wrenchd_wrench"), "{metrics}");
    for live in told(&daemon) {
        assert_eq!((live.wrench, live.status), (None, Status::INVALID.with(Status::STALE).bits()));
        assert!(live.reason.as_ref().unwrap().contains("stands still") && live.age_s > 1.0, "{live:?}");
    }
    drop(hold);
    wait_for("the wrench of a cycle that turns again", || health().starts_with("HTTP/1.1 200 "));
}
