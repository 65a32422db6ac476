//! What the CAN controllers said about their buses, from the cycle to whoever tells of it.

use std::sync::atomic::{AtomicU64, Ordering};

use can::bus_error::BusError;

/// Classes of error frames; above them is a bit that only says that counters follow.
const CLASSES: u64 = 0x1ff;
/// Where the bits of controller problems stand, and those of the interfaces.
const CONTROLLER: u32 = 16;
const INTERFACE: u32 = 24;
/// Later interfaces share the last bit.
const INTERFACES: u32 = 40;

/// All that was said since it was last asked for: written by the cycle without waiting.
#[derive(Debug, Default)]
pub struct BusErrors(AtomicU64);

/// What was said in some stretch of time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Said(u64);

impl BusErrors {
    /// Notes an error frame of the interface with this index.
    pub(crate) fn note(&self, interface: u8, error: &BusError) {
        let class = u64::from(error.class) & CLASSES;
        let interface = u32::from(interface).min(INTERFACES - 1);
        let bits = class | u64::from(error.controller) << CONTROLLER | 1 << (INTERFACE + interface);
        self.0.fetch_or(bits, Ordering::Relaxed);
    }

    /// What was said since the last call.
    pub fn take(&self) -> Said {
        Said(self.0.swap(0, Ordering::Relaxed))
    }
}

impl Said {
    /// What this says or that.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether this says something that `other` does not.
    pub fn is_news_after(self, other: Self) -> bool {
        self.0 & !other.0 != 0
    }

    /// In words, by the interfaces' names.
    pub fn words(self, interfaces: &[String]) -> String {
        let of = |k: &usize| self.0 >> (INTERFACE as usize + *k) & 1 == 1;
        let names: Vec<&str> = (0..INTERFACES as usize)
            .filter(of)
            .filter_map(|k| interfaces.get(k))
            .map(String::as_str)
            .collect();
        let error = BusError {
            class: (self.0 & CLASSES) as u32,
            controller: (self.0 >> CONTROLLER) as u8,
            ..BusError::default()
        };
        format!("error frames from {}: {error}", names.join(" and "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use can::frame::Frame;

    #[test]
    fn it_keeps_all_that_was_said_until_it_is_taken() {
        let (errors, names) = (BusErrors::default(), ["can0".to_owned(), "can1".to_owned()]);
        let note = |interface, class, data: &[u8]| {
            errors.note(interface, &BusError::decode(&Frame::error(class, data).unwrap()));
        };
        note(1, 0x204, &[0, 0x20, 0, 0, 0, 0, 128, 0]);
        let first = errors.take();
        assert_eq!(first.words(&names), "error frames from can1: controller, transmit passive");
        note(1, 0x40, &[0; 8]);
        note(0, 0x100, &[0; 8]);
        let then = errors.take();
        assert_eq!(
            then.words(&names),
            "error frames from can0 and can1: bus off: the interface needs restart-ms or \
             `ip link set ... type can restart`, controller restarted"
        );
        assert!(then.is_news_after(first) && !first.is_news_after(first.and(then)));
        assert_eq!(errors.take(), Said::default());
    }
}
