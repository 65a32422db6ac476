//! The tables of a configuration that say what is published, and how.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use serde::Deserialize;

use super::values::Network;

/// Largest identifier of a standard (11 bit) CAN frame; a greater one is sent as an extended (29 bit) one.
pub const STANDARD_ID_MAX: u32 = 0x7FF;

/// What is published, and when; an output whose table is absent is off.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Publish {
    /// Wrenches per second in fixed mode (Hz).
    pub rate_hz: f64,
    /// What starts a wrench.
    pub mode: PublishMode,
    /// Wrench frames on CAN.
    pub can: Option<PublishCan>,
    /// Net F/T RDT records over UDP.
    pub rdt: Option<PublishRdt>,
    /// ROS 2 `WrenchStamped`.
    pub ros2: Option<PublishRos2>,
    /// Prometheus metrics, health and the live page over HTTP.
    pub metrics: Option<PublishMetrics>,
}

impl Default for Publish {
    fn default() -> Self {
        Self { rate_hz: 1000.0, mode: PublishMode::Fixed, can: None, rdt: None, ros2: None, metrics: None }
    }
}

/// What starts a wrench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PublishMode {
    /// A clock: one every `1 / rate_hz`, the last estimate with its age.
    Fixed,
    /// A complete snapshot: one each, as soon as it is complete.
    Event,
}

/// Wrench frames on CAN (`crate::wire`).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishCan {
    /// The interface to send on.
    pub interface: String,
    /// Identifier of the force frame.
    #[serde(default = "force_id")]
    pub force_id: u32,
    /// Identifier of the torque frame.
    #[serde(default = "torque_id")]
    pub torque_id: u32,
    /// Identifier of the quality frame.
    #[serde(default = "quality_id")]
    pub quality_id: u32,
    /// Force of one bit (N).
    #[serde(default = "force_n_per_bit")]
    pub force_n_per_bit: f64,
    /// Torque of one bit (Nm).
    #[serde(default = "torque_nm_per_bit")]
    pub torque_nm_per_bit: f64,
}

fn force_id() -> u32 {
    0x400
}

fn torque_id() -> u32 {
    0x401
}

fn quality_id() -> u32 {
    0x402
}

fn force_n_per_bit() -> f64 {
    0.01
}

fn torque_nm_per_bit() -> f64 {
    0.001
}

/// Net F/T RDT records over UDP, with the XML description over HTTP.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PublishRdt {
    /// UDP address that requests come to.
    pub bind: SocketAddr,
    /// TCP address of the XML description.
    pub http: SocketAddr,
    /// Networks that are answered.
    pub allow: Vec<Network>,
    /// Counts of one newton.
    pub counts_per_n: u32,
    /// Counts of one newton metre.
    pub counts_per_nm: u32,
}

impl Default for PublishRdt {
    fn default() -> Self {
        Self {
            bind: loopback(49152),
            http: loopback(8049),
            allow: vec![Network::LOOPBACK],
            counts_per_n: 1_000_000,
            counts_per_nm: 1_000_000,
        }
    }
}

/// ROS 2 `geometry_msgs/msg/WrenchStamped`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PublishRos2 {
    /// Topic, without the leading slash.
    pub topic: String,
    /// `frame_id` of the header; the tip link where absent.
    pub frame_id: Option<String>,
    /// ROS domain.
    pub domain: u32,
    /// Where the router is; the middleware's own default where absent.
    pub endpoint: Option<String>,
}

impl Default for PublishRos2 {
    fn default() -> Self {
        Self { topic: "wrench".to_owned(), frame_id: None, domain: 0, endpoint: None }
    }
}

/// Prometheus metrics, health and the live page over HTTP.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PublishMetrics {
    /// TCP address.
    pub bind: SocketAddr,
}

impl Default for PublishMetrics {
    fn default() -> Self {
        Self { bind: loopback(9464) }
    }
}

/// The motion filter; without either value every instant stands by itself, causally.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Filter {
    /// Cut-off frequency (Hz).
    pub cutoff_hz: Option<f64>,
    /// How long an instant waits for later ones (s).
    pub delay_s: Option<f64>,
}

/// The control socket.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Control {
    /// Path of the socket.
    pub socket: PathBuf,
}

impl Default for Control {
    fn default() -> Self {
        Self { socket: PathBuf::from("/run/wrenchd/control.sock") }
    }
}

fn loopback(port: u16) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, port))
}
