//! The configured signals found in the DBC, with their units converted.

use std::time::Duration;

use can::assembly::{GaugeBinding, JointBinding, Layout, SignalBinding};
use can::dbc::Dbc;
use can::frame::CanId;
use can::signal::{SignalSpec, ValueKind};

use super::busload::{Direction, PlannedMessage};
use super::units::{Conversion, Quantity};
use crate::config::{Config, PublishCan, STANDARD_ID_MAX, SignalName};
use crate::document::Step::{self, Index, Key};
use crate::error::RigError;
use crate::wire;

/// Rate assumed for messages of gauges and joints whose rate nobody says (Hz).
const ASSUMED_RATE_HZ: f64 = 1000.0;
/// Rate assumed for messages of nothing but temperatures (Hz).
const ASSUMED_TEMPERATURE_RATE_HZ: f64 = 10.0;

struct Binder<'a> {
    config: &'a Config,
    dbc: &'a Dbc,
    messages: Vec<PlannedMessage>,
}

/// Where one configured signal stands, for messages.
struct Place<'a> {
    at: [Step; 3],
    table: &'static str,
    owner: &'a str,
    key: &'static str,
    interface: Option<&'a str>,
}

/// The layout, joints in the order of the chain's coordinates, and every message that is read or written.
pub(super) fn bind(
    config: &Config,
    dbc: &Dbc,
    joint_entries: &[usize],
) -> Result<(Layout, Vec<PlannedMessage>), RigError> {
    let mut binder = Binder { config, dbc, messages: Vec::new() };
    let gauges = (0..config.sensors.len()).map(|index| binder.gauge(index)).collect::<Result<_, _>>()?;
    let joints = joint_entries.iter().map(|index| binder.joint(*index)).collect::<Result<_, _>>()?;
    let layout = Layout {
        gauges,
        joints,
        stale_after_ns: nanoseconds(config.bus.stale_after_s),
        temperature_stale_after_ns: nanoseconds(config.bus.temperature_stale_after_s),
    };
    if let Some(can) = &config.publish.can {
        binder.outputs(can)?;
    }
    Ok((layout, binder.messages))
}

impl Binder<'_> {
    fn gauge(&mut self, index: usize) -> Result<GaugeBinding, RigError> {
        let config = self.config;
        let sensor = &config.sensors[index];
        let place = |key: &'static str| Place {
            at: [Key("sensor"), Index(index), Key(key)],
            table: "sensor",
            owner: &sensor.name,
            key,
            interface: sensor.interface.as_deref(),
        };
        let counts = self.quantity(&place("signal"), &sensor.signal, Quantity::Reading)?;
        let saturated =
            sensor.saturated.as_ref().map(|name| self.plain(&place("saturated"), name)).transpose()?;
        let sequence =
            sensor.sequence.as_ref().map(|name| self.counter(&place("sequence"), name)).transpose()?;
        let temperature = sensor.temperature.as_ref();
        let temperature = temperature
            .map(|name| self.quantity(&place("temperature"), name, Quantity::Temperature))
            .transpose()?;
        let delay_ns = sensor.delay_s.map(nanoseconds);
        Ok(GaugeBinding { name: sensor.name.clone(), counts, saturated, sequence, temperature, delay_ns })
    }

    fn joint(&mut self, index: usize) -> Result<JointBinding, RigError> {
        let config = self.config;
        let joint = &config.joints[index];
        let place = |key: &'static str| Place {
            at: [Key("joint"), Index(index), Key(key)],
            table: "joint",
            owner: &joint.name,
            key,
            interface: joint.interface.as_deref(),
        };
        let position = self.quantity(&place("position"), &joint.position, Quantity::Angle)?;
        let velocity = joint.velocity.as_ref();
        let velocity = velocity
            .map(|name| self.quantity(&place("velocity"), name, Quantity::AngularVelocity))
            .transpose()?;
        Ok(JointBinding {
            name: joint.name.clone(),
            position,
            velocity,
            delay_ns: joint.delay_s.map(nanoseconds),
        })
    }

    /// A signal whose unit is converted.
    fn quantity(
        &mut self,
        place: &Place<'_>,
        name: &SignalName,
        what: Quantity,
    ) -> Result<SignalBinding, RigError> {
        let mut binding = self.find(place, name, what == Quantity::Temperature)?;
        let unit = &binding.spec.unit;
        let Some(Conversion { factor, offset }) = what.conversion(unit) else {
            let unit = if unit.is_empty() { "no unit".to_owned() } else { format!("the unit \"{unit}\"") };
            let text = format!("{} has {unit} in {}; it must be {}", name, self.dbc.file(), what.words());
            return Err(self.problem(place, &text));
        };
        binding.to_si = factor;
        // physical * factor + offset = (physical + offset / factor) * factor: the shift joins the DBC's own offset.
        shift(&mut binding.spec, offset / factor);
        Ok(binding)
    }

    /// A counter: an integer, as wide as its signal.
    fn counter(&mut self, place: &Place<'_>, name: &SignalName) -> Result<SignalBinding, RigError> {
        let binding = self.find(place, name, false)?;
        let spec = &binding.spec;
        let integer = matches!(spec.kind, ValueKind::Unsigned | ValueKind::Signed);
        if integer && spec.scale == 1.0 && spec.offset == 0.0 {
            return Ok(binding);
        }
        let text = format!(
            "{name} is no integer counter in {}; name an integer signal with scale 1, offset 0",
            self.dbc.file()
        );
        Err(self.problem(place, &text))
    }

    /// A signal as it is.
    fn plain(&mut self, place: &Place<'_>, name: &SignalName) -> Result<SignalBinding, RigError> {
        self.find(place, name, false)
    }

    fn find(&mut self, place: &Place<'_>, name: &SignalName, slow: bool) -> Result<SignalBinding, RigError> {
        let spec =
            self.dbc.signal(&name.to_string()).map_err(|error| self.problem(place, &error.to_string()))?;
        let interfaces = &self.config.bus.interfaces;
        let index =
            place.interface.map_or(Some(0), |wanted| interfaces.iter().position(|name| name == wanted));
        // The configuration's own check has refused interfaces that are not listed, and an empty list.
        let index = index.and_then(|index| u8::try_from(index).ok()).ok_or_else(|| {
            self.problem(
                place,
                "its interface is not among the first 256 of [bus] interfaces; shorten the list",
            )
        })?;
        self.plan(&spec, &interfaces[usize::from(index)], slow);
        Ok(SignalBinding { spec, interface: index, to_si: 1.0 })
    }

    fn plan(&mut self, spec: &SignalSpec, interface: &str, slow: bool) {
        let cycle_ms = self.dbc.message_by_id(spec.message_id).and_then(|message| message.cycle_ms);
        let assumed_hz = if slow { ASSUMED_TEMPERATURE_RATE_HZ } else { ASSUMED_RATE_HZ };
        let rate_hz = cycle_ms.map_or(assumed_hz, |ms| 1000.0 / ms);
        let known = self.messages.iter_mut().find(|m| m.id == spec.message_id && m.interface == interface);
        if let Some(message) = known {
            message.rate_hz = message.rate_hz.max(rate_hz);
            return;
        }
        self.messages.push(PlannedMessage {
            name: spec.message.clone(),
            id: spec.message_id,
            len: spec.wire_len(),
            interface: interface.to_owned(),
            direction: Direction::In,
            rate_hz,
            rate_known: cycle_ms.is_some(),
        });
    }

    /// The wrench frames, none of which may look like a message that is read.
    fn outputs(&mut self, can: &PublishCan) -> Result<(), RigError> {
        let frames = [
            ("WrenchForce", "force_id", can.force_id),
            ("WrenchTorque", "torque_id", can.torque_id),
            ("WrenchQuality", "quality_id", can.quality_id),
        ];
        for (name, key, number) in frames {
            let id =
                if number <= STANDARD_ID_MAX { CanId::standard(number) } else { CanId::extended(number) };
            let at = [Key("publish"), Key("can"), Key(key)];
            let Some(id) = id else {
                let text = format!("[publish.can] {key} = {number:#x} is no CAN identifier; lower it");
                return Err(self.config.problem(&at, text));
            };
            let read =
                self.messages.iter().find(|message| message.id == id && message.interface == can.interface);
            if let Some(message) = read {
                let text = format!(
                    "[publish.can] {key} = {number:#x} is the identifier of {} on {}, which is read; choose another",
                    message.name, can.interface
                );
                return Err(self.config.problem(&at, text));
            }
            self.messages.push(PlannedMessage {
                name: name.to_owned(),
                id,
                len: wire::FRAME_LEN,
                interface: can.interface.clone(),
                direction: Direction::Out,
                rate_hz: self.config.publish.rate_hz,
                rate_known: self.config.publish.mode == crate::config::PublishMode::Fixed,
            });
        }
        Ok(())
    }

    fn problem(&self, place: &Place<'_>, text: &str) -> RigError {
        self.config
            .problem(&place.at, format!("[[{}]] \"{}\": {}: {text}", place.table, place.owner, place.key))
    }
}

/// Moves a signal's physical values, and their limits, by `offset`.
fn shift(spec: &mut SignalSpec, offset: f64) {
    if offset != 0.0 {
        spec.offset += offset;
        spec.min = spec.min.map(|min| min + offset);
        spec.max = spec.max.map(|max| max + offset);
    }
}

/// A time that the configuration's check has found to be finite and short.
fn nanoseconds(seconds: f64) -> i64 {
    let whole = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX).as_nanos();
    i64::try_from(whole).unwrap_or(i64::MAX)
}
