//! A DBC file as checked messages and signals

mod convert;

use std::collections::HashMap;
use std::path::Path;

use crate::error::{Error, Result};
use crate::frame::CanId;
use crate::signal::SignalSpec;

/// A parsed and checked DBC
#[derive(Clone, Debug)]
pub struct Dbc {
    file: String,
    messages: Vec<MessageSpec>,
}

/// One message of a DBC
#[derive(Clone, Debug, PartialEq)]
pub struct MessageSpec {
    /// Identifier
    pub id: CanId,
    /// Name
    pub name: String,
    /// Payload bytes as the DBC has them, 0..=64
    pub len: u8,
    /// Usual time between two frames in ms, where the DBC says it (`GenMsgCycleTime`)
    pub cycle_ms: Option<f64>,
    /// Its signals in the DBC's order
    pub signals: Vec<SignalSpec>,
}

impl Dbc {
    /// Reads a DBC file; text that is not UTF-8 is taken as Latin-1, as older editors write it
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|source| Error::Open { path: path.to_owned(), source })?;
        let text = match String::from_utf8(bytes) {
            Ok(text) => text,
            Err(error) => error.into_bytes().iter().map(|&byte| char::from(byte)).collect(),
        };
        Self::parse(&text, &path.display().to_string())
    }

    /// Parses and checks a DBC's text; `file` is how errors name it
    pub fn parse(text: &str, file: &str) -> Result<Self> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let messages = convert::messages(text, file)?;
        check_duplicates(&messages, file)?;
        Ok(Self { file: file.into(), messages })
    }

    /// The file as errors name it
    pub fn file(&self) -> &str {
        &self.file
    }

    /// All messages in the file's order
    pub fn messages(&self) -> &[MessageSpec] {
        &self.messages
    }

    /// The message of an identifier
    pub fn message_by_id(&self, id: CanId) -> Option<&MessageSpec> {
        self.messages.iter().find(|message| message.id == id)
    }

    /// The message of a name
    pub fn message(&self, name: &str) -> Option<&MessageSpec> {
        self.messages.iter().find(|message| message.name == name)
    }

    /// The signal named `Message.Signal`; the error names the nearest one there is
    pub fn signal(&self, name: &str) -> Result<SignalSpec> {
        let found = name.split_once('.').and_then(|(message, signal)| {
            self.message(message)?.signals.iter().find(|candidate| candidate.name == signal)
        });
        found.cloned().ok_or_else(|| Error::UnknownSignal {
            file: self.file.clone(),
            name: name.into(),
            hint: self.hint(name),
        })
    }

    fn hint(&self, name: &str) -> String {
        let full = || self.messages.iter().flat_map(|m| &m.signals);
        if let Some(same) = full().find(|signal| signal.name == name) {
            return format!("signals are written Message.Signal: did you mean {:?}?", same.full_name());
        }
        let near = full()
            .map(SignalSpec::full_name)
            .map(|candidate| (strsim::normalized_damerau_levenshtein(&candidate, name), candidate))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        match near {
            Some((similarity, candidate)) if similarity > 0.5 => format!("did you mean {candidate:?}?"),
            Some((_, example)) => format!("signals are written Message.Signal, for example {example:?}"),
            None => "the file defines no signals at all".into(),
        }
    }
}

fn content(file: &str, what: impl Into<String>, why: impl Into<String>) -> Error {
    Error::DbcContent { file: file.into(), what: what.into(), why: why.into() }
}

fn check_duplicates(messages: &[MessageSpec], file: &str) -> Result<()> {
    let mut ids = HashMap::new();
    let mut names = HashMap::new();
    for message in messages {
        let what = || format!("message {}", message.name);
        if let Some(other) = ids.insert(message.id, &message.name) {
            return Err(content(
                file,
                what(),
                format!("identifier {} is also that of {other}; remove one", message.id),
            ));
        }
        if names.insert(message.name.as_str(), message.id).is_some() {
            return Err(content(file, what(), "defined twice; rename or remove one"));
        }
        let mut signals = HashMap::new();
        for signal in &message.signals {
            if signals.insert(signal.name.as_str(), ()).is_some() {
                let what = format!("signal {}.{}", message.name, signal.name);
                return Err(content(file, what, "defined twice in its message; rename or remove one"));
            }
        }
    }
    Ok(())
}
