//! The control socket: JSON lines over a Unix socket, one request a line, one answer a line.
//!
//! ```text
//! {"command": "status"}                                        {"ok": true, "status": {...}}
//! {"command": "tare"}, {"command": "untare"}                   {"ok": true, "live": {...}}   tare and payload as they are then
//! {"command": "payload", "mass": 0.5, "com": [0, 0, 0.05]}     {"ok": true, "live": {...}}   mass 0 takes it off
//! {"command": "reload"}                                        {"ok": true, "done": "reloaded ..."}
//! {"command": "stream", "rate_hz": 20}                         {"ok": true, "status": {...}} again and again, to the end
//! {"command": "records"}                                       {"sequence": 7, ...}: every record from now on, to the end
//! anything else                                                {"ok": false, "error": "what is wrong, and what to do"}
//! ```

#[cfg(target_os = "linux")]
pub(crate) mod server;

use serde::{Deserialize, Serialize};

use crate::published::Published;
use crate::view::{DaemonStatus, Live};

/// Longest line that is read, bytes.
pub const LINE_BYTES: usize = 4096;

/// Rate of a stream where none is asked for, Hz.
pub const STREAM_HZ: f64 = 20.0;

/// Largest rate of a stream, Hz: it is for people to look at; programs read CAN, RDT or ROS 2.
pub const MOST_STREAM_HZ: f64 = 200.0;

/// Smallest rate of a stream, Hz: who asks for less asks again when it is time.
pub const LEAST_STREAM_HZ: f64 = 0.001;

/// Largest payload that is believed, kg.
pub const MOST_PAYLOAD_KG: f64 = 1000.0;

/// One request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "command", rename_all = "lowercase", deny_unknown_fields)]
pub enum Request {
    /// The daemon as a whole.
    Status {},
    /// The same again and again, at this rate.
    Stream {
        /// Hz.
        #[serde(default = "stream_hz")]
        rate_hz: f64,
    },
    /// Every record that is published from now on, each a line: a [`Record`].
    Records {},
    /// Find every gauge's zero again; the answer comes when that is done or refused.
    Tare {},
    /// Take the calibration's zeros again.
    Untare {},
    /// Subtract a point mass at the tip from now on, in place of the one before.
    Payload {
        /// kg; 0: none.
        mass: f64,
        /// Where it hangs, tip frame, m.
        #[serde(default)]
        com: [f64; 3],
    },
    /// Read configuration and model again.
    Reload {},
}

/// One published record, for programs that pass it on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Its number; a reader that was too slow misses some.
    pub sequence: u64,
    /// The instant that it refers to, ns since the Unix epoch; 0 before the first.
    pub instant_ns: i64,
    /// When it was published, ns since the Unix epoch.
    pub published_ns: i64,
    /// The status byte.
    pub status: u8,
    /// Why there is no wrench; absent where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The environment's wrench about the tip's origin, in tip axes: Fx Fy Fz (N), Tx Ty Tz (Nm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wrench: Option<[f64; 6]>,
}

impl From<&Published> for Record {
    fn from(record: &Published) -> Self {
        Self {
            sequence: record.sequence,
            instant_ns: record.instant_ns,
            published_ns: record.published_ns,
            status: record.status.bits(),
            reason: record.outcome.err().map(|why| why.to_string()),
            wrench: record.outcome.ok().map(|solution| solution.wrench.to_vector().into()),
        }
    }
}

fn stream_hz() -> f64 {
    STREAM_HZ
}

/// One answer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reply {
    /// Whether it was done.
    pub ok: bool,
    /// Why not, and what to do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// What was done, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<String>,
    /// The daemon as a whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<Box<DaemonStatus>>,
    /// The newest instant, with tare and payload.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub live: Option<Box<Live>>,
}

impl Request {
    /// From a line.
    pub fn parse(line: &[u8]) -> Result<Self, String> {
        let request: Self = serde_json::from_slice(line).map_err(|error| {
            format!(
                "not a request: {error}; send a line such as {{\"command\": \"status\"}}, with one of status, stream, tare, untare, \
                 payload, reload, records"
            )
        })?;
        request.check()
    }

    /// The request, if its numbers make sense.
    pub fn check(self) -> Result<Self, String> {
        match &self {
            Self::Stream { rate_hz } if !(LEAST_STREAM_HZ..=MOST_STREAM_HZ).contains(rate_hz) => Err(
                format!("rate_hz = {rate_hz:?} is not a rate from {LEAST_STREAM_HZ} to {MOST_STREAM_HZ} Hz"),
            ),
            Self::Payload { mass, .. } if !(0.0..=MOST_PAYLOAD_KG).contains(mass) => {
                Err(format!("mass = {mass} is not a mass from 0 to {MOST_PAYLOAD_KG} kg"))
            }
            Self::Payload { com, .. } if com.iter().any(|x| x.is_nan() || x.abs() > 10.0) => {
                Err(format!("com = {com:?} is not within 10 m of the tip; give metres in the tip frame"))
            }
            _ => Ok(self),
        }
    }
}

impl Reply {
    /// Not done.
    pub fn error(error: impl Into<String>) -> Self {
        Self { error: Some(error.into()), ..Self::default() }
    }

    /// Done, in words.
    pub fn done(words: impl Into<String>) -> Self {
        Self { ok: true, done: Some(words.into()), ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn requests_are_read_and_nonsense_is_named() {
        let parse = |line: &str| Request::parse(line.as_bytes());
        assert_eq!(parse(r#"{"command":"status"}"#), Ok(Request::Status {}));
        assert_eq!(parse(r#"{"command":"stream"}"#), Ok(Request::Stream { rate_hz: STREAM_HZ }));
        let payload = Request::Payload { mass: 0.5, com: [0.0, 0.0, 0.05] };
        assert_eq!(parse(r#"{"command":"payload","mass":0.5,"com":[0,0,0.05]}"#), Ok(payload.clone()));
        assert_eq!(Request::parse(&serde_json::to_vec(&payload).unwrap()), Ok(payload));
        for (line, part) in [
            ("", "EOF"),
            ("{", "EOF"),
            (r#"{"command":"explode"}"#, "explode"),
            (r#"{"command":"status","x":1}"#, "x"),
            (r#"{"command":"payload"}"#, "mass"),
            (r#"{"command":"payload","mass":-1}"#, "-1"),
            (r#"{"command":"payload","mass":1e9}"#, "1000000000"),
            (r#"{"command":"payload","mass":1,"com":[0,0,11]}"#, "11"),
            (r#"{"command":"stream","rate_hz":0}"#, "rate_hz = 0"),
            (r#"{"command":"stream","rate_hz":1e-300}"#, "rate_hz = 1e-300 is not a rate from 0.001"),
            (r#"{"command":"stream","rate_hz":1e6}"#, "200"),
        ] {
            let error = parse(line).unwrap_err();
            assert!(error.contains(part), "{line}: {error}");
        }
    }

    fn requests() -> impl Strategy<Value = Request> {
        prop_oneof![
            Just(Request::Status {}),
            Just(Request::Tare {}),
            Just(Request::Untare {}),
            Just(Request::Reload {}),
            (LEAST_STREAM_HZ..=MOST_STREAM_HZ).prop_map(|rate_hz| Request::Stream { rate_hz }),
            (0.0..=MOST_PAYLOAD_KG, prop::array::uniform3(-10.0..=10.0f64))
                .prop_map(|(mass, com)| Request::Payload { mass, com }),
        ]
    }

    proptest! {
        #[test]
        fn requests_round_trip_and_damage_is_never_obeyed_as_another(request in requests(), cut in 1usize..20) {
            let line = serde_json::to_vec(&request).unwrap();
            prop_assert_eq!(Request::parse(&line), Ok(request));
            prop_assert!(Request::parse(&line[..line.len() - cut.min(line.len())]).is_err());
        }

        #[test]
        fn replies_round_trip(words in ".{0,40}", ok: bool) {
            let reply = if ok { Reply::done(words) } else { Reply::error(words) };
            let line = serde_json::to_vec(&reply).unwrap();
            prop_assert!(!line.contains(&b'\n'), "one line");
            prop_assert_eq!(serde_json::from_slice::<Reply>(&line).unwrap(), reply);
        }
    }
}
