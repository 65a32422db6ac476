//! The few ROS 2 messages that wrenchd speaks: as bytes (CDR, little-endian), with their names, definitions and type hashes. No ROS, no I/O.
//!
//! CDR (OMG DDS-XTypes 7.4.1): a header of four bytes, then every number at a multiple of its size, counted from behind the header; a string is its
//! length with the final zero (u32), its bytes, the zero.

mod cdr;
mod messages;

pub use messages::{CanFrame, Diagnostic, DiagnosticArray, FdFrame, Level, Message, Stamp, WrenchStamped};
