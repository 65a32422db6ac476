//! Frames in words: what a configuration's DBC, or the published wrench's layout, says about their payload.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::Path;

use can::dbc::{Dbc, MessageSpec};
use can::frame::{CanId, Frame};
use rig::Config;
use rig::config::{PublishCan, STANDARD_ID_MAX};
use rig::wire::{QualityFrame, Scale, TripleFrame};

use crate::Error;

/// Messages by identifier.
#[derive(Debug)]
pub struct Decoder {
    /// The configuration.
    pub config: Config,
    messages: HashMap<CanId, MessageSpec>,
}

impl Decoder {
    /// The messages of a configuration's DBC; the URDF is not needed.
    pub fn load(config: &Path) -> Result<Self, Error> {
        let config = Config::load(config)?;
        let dbc = Dbc::read(&config.bus.dbc)?;
        let messages = dbc.messages().iter().map(|message| (message.id, message.clone())).collect();
        Ok(Self { config, messages })
    }

    /// The message of an identifier.
    pub fn message(&self, id: CanId) -> Option<&MessageSpec> {
        self.messages.get(&id)
    }

    /// Name of a frame's message, the published wrench's included.
    pub fn name(&self, interface: &str, id: CanId) -> Option<&str> {
        match self.message(id) {
            Some(message) => Some(&message.name),
            None => self.published(interface, id).map(Published::name),
        }
    }

    /// The identifier of a message's name, or the error that lists those there are.
    pub fn id_of(&self, name: &str) -> Result<CanId, Error> {
        if let Some(message) = self.messages.values().find(|message| message.name == name) {
            return Ok(message.id);
        }
        let published = self.config.publish.can.as_ref().and_then(|out| {
            let all = [Published::Force(out), Published::Torque(out), Published::Quality(out)];
            all.into_iter().find(|kind| kind.name() == name).and_then(Published::id)
        });
        published.ok_or_else(|| {
            let mut names: Vec<&str> = self.messages.values().map(|message| message.name.as_str()).collect();
            names.sort_unstable();
            let dbc = self.config.bus.dbc.display();
            Error::usage(format!("--message {name}: {dbc} has no such message; it has {}", names.join(", ")))
        })
    }

    /// Appends ` Message Signal=value ...` of a data frame that is known.
    pub fn describe(&self, interface: &str, frame: &Frame, line: &mut String) {
        let id = frame.id();
        if let Some(message) = self.message(id) {
            let _ = write!(line, " {}", message.name);
            let expected = can::frame::wire_len(message.len.into()).unwrap_or(can::frame::MAX_LEN);
            if frame.len() != expected {
                let _ = write!(line, " wrong length: {} bytes, the DBC says {expected}", frame.len());
                return;
            }
            for signal in &message.signals {
                if let Some(value) = signal.decode(frame.padded()) {
                    let _ = write!(line, " {}={}", signal.name, shown(value));
                }
            }
        } else if let Some(published) = self.published(interface, id) {
            let _ = write!(line, " {}", published.name());
            published.describe(frame, line);
        }
    }

    fn published(&self, interface: &str, id: CanId) -> Option<Published<'_>> {
        let out = self.config.publish.can.as_ref().filter(|out| out.interface == interface)?;
        let all = [Published::Force(out), Published::Torque(out), Published::Quality(out)];
        all.into_iter().find(|kind| kind.id() == Some(id))
    }
}

/// One of the three published frames.
#[derive(Clone, Copy)]
enum Published<'a> {
    Force(&'a PublishCan),
    Torque(&'a PublishCan),
    Quality(&'a PublishCan),
}

impl Published<'_> {
    fn name(self) -> &'static str {
        match self {
            Self::Force(_) => "WrenchForce",
            Self::Torque(_) => "WrenchTorque",
            Self::Quality(_) => "WrenchQuality",
        }
    }

    fn id(self) -> Option<CanId> {
        let number = match self {
            Self::Force(out) => out.force_id,
            Self::Torque(out) => out.torque_id,
            Self::Quality(out) => out.quality_id,
        };
        if number <= STANDARD_ID_MAX { CanId::standard(number) } else { CanId::extended(number) }
    }

    fn describe(self, frame: &Frame, line: &mut String) {
        let triple =
            |line: &mut String, names: [&str; 3], per_bit: f64| match TripleFrame::parse(frame.data()) {
                Ok(parsed) => {
                    let value = parsed.value(Scale(per_bit));
                    for (axis, name) in names.iter().enumerate() {
                        let _ = match value {
                            Some(value) => write!(line, " {name}={}", shown(value[axis])),
                            None => write!(line, " {name}=invalid"),
                        };
                    }
                    let status = rig::Status::from_bits(parsed.status);
                    let _ = write!(line, " Sequence={} Status={status}", parsed.sequence);
                }
                Err(wrong) => {
                    let _ = write!(line, " wrong length: {} bytes", wrong.found);
                }
            };
        match self {
            Self::Force(out) => triple(line, ["Fx", "Fy", "Fz"], out.force_n_per_bit),
            Self::Torque(out) => triple(line, ["Tx", "Ty", "Tz"], out.torque_nm_per_bit),
            Self::Quality(_) => match QualityFrame::parse(frame.data()) {
                Ok(parsed) => {
                    let names = ["SigmaFx", "SigmaFy", "SigmaFz", "SigmaTx", "SigmaTy", "SigmaTz"];
                    for (name, raw) in names.iter().zip(parsed.raw) {
                        let _ = match rig::wire::sigma_from_raw(raw) {
                            Some(sigma) => write!(line, " {name}={sigma:.3e}"),
                            None => write!(line, " {name}=unknown"),
                        };
                    }
                    let status = rig::Status::from_bits(parsed.status);
                    let _ = write!(line, " Sequence={} Status={status}", parsed.sequence);
                }
                Err(wrong) => {
                    let _ = write!(line, " wrong length: {} bytes", wrong.found);
                }
            },
        }
    }
}

/// A value to twelve digits: what scaling adds behind them is rounding.
fn shown(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}
