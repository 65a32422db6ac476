//! `netftapi2.xml`: what a Net F/T client asks over HTTP before it streams.

use std::fmt::Write;
use std::net::{IpAddr, TcpListener};

use hyper::StatusCode;
use rig::Config;
use rig::config::{PublishMode, PublishRdt};

use super::record::{STATUS_INVALID, Scale};
use crate::network::http::{self, Answer};
use crate::network::{Server, Shared};

/// Serves the description to allowed hosts.
pub(super) fn serve(listener: TcpListener, config: &Config, rdt: &PublishRdt, shared: &Shared) -> Server {
    let (rdt, shared) = (rdt.clone(), shared.clone());
    let allow = rdt.allow.clone();
    let (mode, grid_hz) = (config.publish.mode, config.publish.rate_hz);
    let scale = Scale::new(&rdt);
    let answer = move |path: &str, asked: IpAddr| match path {
        "/netftapi2.xml" => {
            let rate_hz = match mode {
                PublishMode::Fixed => grid_hz,
                PublishMode::Event => shared.pulse.borrow().published_hz,
            };
            let counts = shared.healthy().ok().and_then(|record| scale.counts(&record.outcome.ok()?));
            let own = if rdt.bind.ip().is_unspecified() { asked } else { rdt.bind.ip() };
            let facts = Facts { counts, rate_hz, address: own.to_string() };
            Answer::ok("text/xml; charset=utf-8", description(&rdt, &facts))
        }
        _ => Answer::text(StatusCode::NOT_FOUND, "here is /netftapi2.xml only"),
    };
    http::serve(listener, move |ip| allow.iter().any(|network| network.contains(ip)), answer)
}

/// What changes while it runs.
struct Facts {
    /// Those of the newest record, if it has a wrench.
    counts: Option<[i32; 6]>,
    rate_hz: f64,
    address: String,
}

/// The fields that clients read, each once; lists hold one value an axis.
fn description(rdt: &PublishRdt, facts: &Facts) -> String {
    let zeros = "0;0;0;0;0;0";
    // Full scale: the largest counts that a record holds.
    let most = |counts_per_unit: u32| (f64::from(i32::MAX) / f64::from(counts_per_unit)).floor();
    let (force, moment) = (most(rdt.counts_per_n), most(rdt.counts_per_nm));
    let ratings = format!("{force};{force};{force};{moment};{moment};{moment}");
    let status = if facts.counts.is_some() { 0 } else { STATUS_INVALID };
    // A client divides by it.
    let rate_hz = facts.rate_hz.round().max(1.0);
    let fields: [(&str, String); 20] = [
        ("prodname", format!("wrenchd {}", env!("CARGO_PKG_VERSION"))),
        ("cfgcpf", rdt.counts_per_n.to_string()),
        ("cfgcpt", rdt.counts_per_nm.to_string()),
        ("scfgfu", "N".into()),
        ("scfgtu", "Nm".into()),
        ("cfgfu", "2".into()),
        ("cfgtu", "3".into()),
        ("runstat", format!("0x{status:08x}")),
        ("runft", facts.counts.unwrap_or_default().map(|c| c.to_string()).join(";")),
        ("setbias", zeros.into()),
        ("cfgmr", ratings),
        ("comrdte", "Enabled".into()),
        ("comrdtrate", format!("{rate_hz}")),
        ("comrdtbsiz", "1".into()),
        ("netip", facts.address.clone()),
        ("setrate", format!("{rate_hz}")),
        ("runrate", format!("{rate_hz}")),
        ("setcfgsel", "0".into()),
        ("cfgcalsel", "0".into()),
        ("cfgnam", "wrenchd".into()),
    ];
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<netft>\n");
    for (name, value) in fields {
        // Writing to a string does not fail.
        let _ = writeln!(text, "  <{name}>{value}</{name}>");
    }
    text + "</netft>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_field_stands_once_and_says_what_runs() {
        let rdt = PublishRdt { counts_per_nm: 5000, ..PublishRdt::default() };
        let facts = |counts| Facts { counts, rate_hz: 999.6, address: "127.0.0.1".into() };
        let text = description(&rdt, &facts(Some([1, -2, 3, -4, 5, i32::MIN])));
        let fields = [
            "prodname",
            "cfgcpf",
            "cfgcpt",
            "scfgfu",
            "scfgtu",
            "runstat",
            "runft",
            "setbias",
            "cfgmr",
            "comrdte",
            "comrdtrate",
            "comrdtbsiz",
            "netip",
            "setrate",
            "setcfgsel",
            "cfgcalsel",
        ];
        for field in fields {
            assert_eq!(text.matches(&format!("<{field}>")).count(), 1, "{field}");
            assert_eq!(text.matches(&format!("</{field}>")).count(), 1, "{field}");
        }
        for part in ["<cfgcpf>1000000<", "<cfgcpt>5000<", "<runstat>0x00000000<", "<comrdtrate>1000<"] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(text.contains("<cfgmr>2147;2147;2147;429496;429496;429496<"), "{text}");
        assert!(!text.contains("DOCTYPE") && text.len() < 65536);
        assert!(text.contains("<runft>1;-2;3;-4;5;-2147483648<"), "{text}");
        let invalid = description(&rdt, &facts(None));
        assert!(invalid.contains("<runstat>0x80000000<") && invalid.contains("<runft>0;0;0;0;0;0<"));
    }
}
