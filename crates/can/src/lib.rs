//! CAN frames, DBC decode tables, candump logs, sources, and assembly of gauge and joint snapshots
//!
//! From the wire to a snapshot, one module a step:
//!
//! | step | module |
//! | --- | --- |
//! | a frame, its kernel stamp and interface | [`frame`] |
//! | what a DBC says about it | [`dbc`], [`signal`], [`field`] |
//! | (interface, identifier) to values | [`decode`] |
//! | what a board's counter says | [`sequence`] |
//! | rounds: every gauge and joint, a reading or a named absence | [`assembly`] |
//!
//! Nothing here reads a clock except the socket source; stamps are `i64` nanoseconds since the Unix epoch. What the
//! real-time cycle calls neither allocates nor panics; absence there is a value, never an error.

pub mod assembly;
pub mod dbc;
pub mod decode;
pub mod error;
pub mod field;
pub mod frame;
pub mod sequence;
pub mod signal;

pub use error::{Error, Result};
