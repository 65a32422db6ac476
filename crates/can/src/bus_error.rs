//! Error frames: what a CAN controller says about its bus (`linux/can/error.h`)

use crate::frame::Frame;

/// The class bits of an error frame with its details
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct BusError {
    /// `CAN_ERR_*` class bits
    pub class: u32,
    /// Controller problems (`CAN_ERR_CRTL_*`), where the class says so
    pub controller: u8,
    /// Protocol violation type and location (`CAN_ERR_PROT_*`), where the class says so
    pub protocol: (u8, u8),
    /// Transmit and receive error counters, where the class says so
    pub counters: Option<(u8, u8)>,
}

const NAMES: [(u32, &str); 9] = [
    (0x001, "transmit timeout"),
    (0x002, "lost arbitration"),
    (0x004, "controller"),
    (0x008, "protocol violation"),
    (0x010, "transceiver"),
    (0x020, "no acknowledgement: is another node on the bus, and the bit rate the same?"),
    (0x040, "bus off: the interface needs restart-ms or `ip link set ... type can restart`"),
    (0x080, "bus error"),
    (0x100, "controller restarted"),
];

const CONTROLLER_NAMES: [(u8, &str); 7] = [
    (0x01, "receive overflow"),
    (0x02, "transmit overflow"),
    (0x04, "receive warning"),
    (0x08, "transmit warning"),
    (0x10, "receive passive"),
    (0x20, "transmit passive"),
    (0x40, "active again"),
];

impl BusError {
    /// Reads an error frame
    pub fn decode(frame: &Frame) -> Self {
        let class = frame.id().number();
        let data = frame.padded();
        Self {
            class,
            controller: if class & 0x004 != 0 { data[1] } else { 0 },
            protocol: if class & 0x008 != 0 { (data[2], data[3]) } else { (0, 0) },
            counters: (class & 0x200 != 0).then_some((data[6], data[7])),
        }
    }

    /// Whether the controller left the bus
    pub fn is_bus_off(&self) -> bool {
        self.class & 0x040 != 0
    }

    /// Whether the controller lost received frames
    pub fn is_receive_overflow(&self) -> bool {
        self.controller & 0x01 != 0
    }
}

impl std::fmt::Display for BusError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut separator = "";
        for (_, name) in NAMES.iter().filter(|(bit, _)| self.class & bit != 0) {
            write!(f, "{separator}{name}")?;
            separator = ", ";
        }
        for (_, name) in CONTROLLER_NAMES.iter().filter(|(bit, _)| self.controller & bit != 0) {
            write!(f, "{separator}{name}")?;
            separator = ", ";
        }
        if let Some((transmit, receive)) = self.counters {
            write!(f, "{separator}error counters tx {transmit} rx {receive}")?;
            separator = ", ";
        }
        if separator.is_empty() { write!(f, "error class {:#x}", self.class) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn says_what_the_controller_said() {
        let frame = Frame::error(0x204, &[0, 0x11, 0, 0, 0, 0, 96, 128]).unwrap();
        let error = BusError::decode(&frame);
        assert!(error.is_receive_overflow() && !error.is_bus_off());
        assert_eq!(
            error.to_string(),
            "controller, receive overflow, receive passive, error counters tx 96 rx 128"
        );
        assert!(BusError::decode(&Frame::error(0x40, &[0; 8]).unwrap()).is_bus_off());
        assert_eq!(BusError::decode(&Frame::error(0, &[]).unwrap()).to_string(), "error class 0x0");
    }
}
