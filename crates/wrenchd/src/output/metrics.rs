//! Prometheus metrics, health for supervisors, and a live page for people, over HTTP; all of it read-only.

mod prometheus;

use hyper::StatusCode;
use rig::Config;
use serde::Serialize;

use super::Opened;
use crate::network::http::{self, Answer};
use crate::network::ports::{PortError, Ports};
use crate::network::{Server, Shared};

const JSON: &str = "application/json";

/// The live page: nothing is loaded from elsewhere.
const PAGE: &str = include_str!("metrics/page.html");

pub(super) fn open(config: &Config, shared: &Shared, ports: &mut Ports) -> Result<Opened, PortError> {
    let Some(metrics) = &config.publish.metrics else { return Ok(Opened::default()) };
    let listener = ports.tcp("[publish.metrics]", metrics.bind)?;
    let shared = shared.clone();
    let server: Server = http::serve(listener, |_| true, move |path, _| answer(&shared, path));
    Ok(Opened { output: None, servers: vec![server] })
}

fn answer(shared: &Shared, path: &str) -> Answer {
    match path {
        "/" => Answer::ok("text/html; charset=utf-8", PAGE),
        "/metrics" => Answer::ok("text/plain; version=0.0.4; charset=utf-8", prometheus::text(shared)),
        "/health" => health(shared),
        "/status.json" => json(StatusCode::OK, &shared.status()),
        _ => Answer::text(StatusCode::NOT_FOUND, "here are /, /metrics, /health and /status.json"),
    }
}

/// What `/health` says.
#[derive(Serialize)]
struct Health<'a> {
    status: &'a str,
    model_sha256: &'a str,
    /// Why no valid wrench is published.
    reason: Option<&'a str>,
    /// Names of the status bits.
    wrench: Option<Vec<&'static str>>,
}

fn health(shared: &Shared) -> Answer {
    let robot = shared.robot.borrow().clone();
    let model_sha256 = &robot.model_sha256;
    match shared.healthy() {
        Ok(record) => {
            let wrench = Some(record.status.names().collect());
            json(StatusCode::OK, &Health { status: "ok", model_sha256, reason: None, wrench })
        }
        Err(reason) => {
            let health = Health { status: "no wrench", model_sha256, reason: Some(&reason), wrench: None };
            json(StatusCode::SERVICE_UNAVAILABLE, &health)
        }
    }
}

fn json(status: StatusCode, value: &impl Serialize) -> Answer {
    match serde_json::to_vec(value) {
        Ok(body) => Answer { status, content_type: JSON, body: body.into() },
        Err(error) => Answer::text(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}
