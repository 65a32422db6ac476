//! What the cycle did so far, as counters that other threads read while it runs.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::bus_errors::BusErrors;
use crate::histogram::Histogram;

/// A counter as it goes out to others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counter {
    /// Its name.
    pub name: &'static str,
    /// What it counts.
    pub words: &'static str,
    /// Its value.
    pub value: u64,
}

macro_rules! counters {
    ($(#[doc = $doc:literal] $name:ident,)*) => {
        /// Counters of one cycle; written by it alone, without waiting.
        #[derive(Debug, Default)]
        pub struct Health {
            $($name: AtomicU64,)*
            worst_latency_ns: AtomicU64,
            /// What the CAN controllers said about their buses.
            pub bus: BusErrors,
            /// From a last frame's stamp to the publication of what it completed.
            pub latency: Histogram,
            /// From the instant of a published wrench to its publication.
            pub age: Histogram,
            /// Fixed mode: from a point of the grid to the cycle's waking up for it.
            pub lateness: Histogram,
        }

        /// The counters at one moment.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct Totals {
            $(#[doc = $doc] pub $name: u64,)*
        }

        impl Health {
            /// Replaces all counters.
            pub(crate) fn store(&self, totals: &Totals) {
                $(self.$name.store(totals.$name, Ordering::Relaxed);)*
            }

            /// Every counter with its name and meaning.
            pub fn named(&self) -> impl Iterator<Item = Counter> + use<> {
                let totals = self.totals();
                [$(Counter { name: stringify!($name), words: $doc.trim_ascii(), value: totals.$name },)*].into_iter()
            }

            /// The counters now; each by itself is right, together they may be a cycle apart.
            pub fn totals(&self) -> Totals {
                Totals { $($name: self.$name.load(Ordering::Relaxed),)* }
            }
        }

        impl Totals {
            /// What was added since `before`.
            #[must_use]
            pub fn since(&self, before: &Self) -> Self {
                Self { $($name: self.$name.saturating_sub(before.$name),)* }
            }
        }
    };
}

counters! {
    /// Turns of the cycle: it lives while this grows.
    turns,
    /// Frames received.
    frames,
    /// Frames that the kernel or a queue dropped before they were read.
    lost_frames,
    /// Error frames received.
    bus_errors,
    /// Times that an interface went down or away.
    downs,
    /// Records published.
    published,
    /// Of these, records with a wrench.
    valid,
    /// Points of the fixed grid that passed unserved.
    overruns,
    /// Messages that outputs handed on.
    sent,
    /// Messages that outputs dropped.
    unsent,
    /// Rounds in which every gauge and joint had a reading.
    complete_rounds,
    /// Rounds that ended.
    rounds,
}

impl Health {
    /// Notes the time from a last frame's stamp to the publication of what it completed, ns.
    pub(crate) fn note_latency(&self, latency_ns: i64) {
        self.latency.note(latency_ns);
        self.worst_latency_ns.fetch_max(u64::try_from(latency_ns).unwrap_or(0), Ordering::Relaxed);
    }

    /// The longest time from a last frame's stamp to the publication of what it completed since the last call, ns.
    pub fn take_worst_latency_ns(&self) -> u64 {
        self.worst_latency_ns.swap(0, Ordering::Relaxed)
    }
}
