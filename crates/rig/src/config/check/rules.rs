//! Rules that many values of a configuration keep to.

use std::collections::HashMap;
use std::fmt::Display;
use std::ops::RangeInclusive;

use super::Checked;
use crate::config::Config;
use crate::document::Problem;
use crate::document::Step::{self, Index, Key};
use crate::error::suggest;

/// Longest interface name that Linux knows (IFNAMSIZ less its terminator).
const INTERFACE_NAME_MAX: usize = 15;
/// Plausible range of a signal's delay (s).
const DELAY_S: RangeInclusive<f64> = 0.0..=1.0;

pub(super) fn not_empty(at: &[Step], name: &str, text: &str) -> Checked {
    if text.trim().is_empty() {
        return Err(Problem::new(at, format!("{name} is empty; fill it in or remove it")));
    }
    Ok(())
}

pub(super) fn all_finite(at: &[Step], name: &str, values: &[f64]) -> Checked {
    if values.iter().all(|x| x.is_finite()) {
        return Ok(());
    }
    Err(Problem::new(at, format!("{name} = {values:?} is not finite; give finite numbers")))
}

pub(super) fn positive(at: &[Step], name: &str, value: f64) -> Checked {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Problem::new(at, format!("{name} = {value} must be a finite number above 0")))
}

pub(super) fn not_negative(at: &[Step], name: &str, value: f64) -> Checked {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(Problem::new(at, format!("{name} = {value} must be a finite number, 0 or more")))
}

pub(super) fn delay(at: &[Step], name: &str, value: Option<f64>) -> Checked {
    let Some(value) = value.filter(|value| !DELAY_S.contains(value)) else { return Ok(()) };
    let (from, to) = (DELAY_S.start(), DELAY_S.end());
    Err(Problem::new(
        at,
        format!("{name} = {value} is outside {from} .. {to} s; give seconds (stamp minus sampling)"),
    ))
}

pub(super) fn interface_name(at: &[Step], name: &str, interface: &str) -> Checked {
    let bad = |c: char| c.is_whitespace() || c.is_control() || c == '/';
    if interface.is_empty() || interface.len() > INTERFACE_NAME_MAX || interface.contains(bad) {
        let text = format!(
            "{name}: \"{interface}\" is no interface name; name one that `ip link` lists, such as \"can0\""
        );
        return Err(Problem::new(at, text));
    }
    Ok(())
}

pub(super) fn listed_interface(config: &Config, at: &[Step], name: &str, interface: Option<&str>) -> Checked {
    let listed = &config.bus.interfaces;
    let Some(interface) = interface.filter(|interface| !listed.iter().any(|name| name == interface)) else {
        return Ok(());
    };
    let remedy = suggest(interface, listed.iter().map(String::as_str));
    Err(Problem::new(
        at,
        format!("{name} = \"{interface}\" is not in [bus] interfaces; add it there, or: {remedy}"),
    ))
}

/// Values that may stand in one entry of an array of tables only.
pub(super) struct Unique {
    table: &'static str,
    key: &'static str,
    seen: HashMap<String, String>,
}

impl Unique {
    pub(super) fn new(table: &'static str, key: &'static str) -> Self {
        Self { table, key, seen: HashMap::new() }
    }

    pub(super) fn add(&mut self, index: usize, value: &impl Display, owner: &str) -> Checked {
        let (table, key) = (self.table, self.key);
        let Some(first) = self.seen.insert(value.to_string(), owner.to_owned()) else { return Ok(()) };
        let what = if key == "name" {
            format!("[[{table}]] name = \"{value}\" stands twice; give each its own")
        } else {
            format!(
                "[[{table}]] \"{owner}\": {key} = \"{value}\" is also that of \"{first}\"; give each its own"
            )
        };
        Err(Problem::new(&[Key(table), Index(index), Key(key)], what))
    }
}
