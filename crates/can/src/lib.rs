//! CAN frames, DBC decode tables, candump logs, sources, and assembly of gauge and joint snapshots
//!
//! From the wire to a snapshot, one module a step:
//!
//! | step | module |
//! | --- | --- |
//! | a frame, its kernel stamp and interface | [`frame`] |
//! | what a DBC says about it | [`dbc`], [`signal`], [`field`] |
//! | (interface, identifier) to values | [`decode`] |
//! | candump logs, plain, gzip, zstd | [`candump`], [`atomic`] |
//! | where frames come from: socket, log, simulation | [`source`], [`replay`], [`channel`], `socket` |
//! | middleware: copies for a recorder, seeded faults | [`tap`], [`fault`] |
//! | what a controller says about its bus | [`bus_error`] |
//! | what a board's counter says | [`sequence`] |
//! | rounds: every gauge and joint, a reading or a named absence | [`assembly`] |
//!
//! Nothing here reads a clock except the socket source; stamps are `i64` nanoseconds since the Unix epoch. What the
//! real-time cycle calls neither allocates nor panics; absence there is a value, never an error.

pub mod assembly;
pub mod atomic;
pub mod bus_error;
pub mod candump;
pub mod channel;
pub mod dbc;
pub mod decode;
pub mod error;
pub mod fault;
pub mod field;
pub mod frame;
pub mod replay;
pub mod sequence;
pub mod signal;
#[cfg(target_os = "linux")]
pub mod socket;
pub mod source;
pub mod tap;

pub use error::{Error, Result};
