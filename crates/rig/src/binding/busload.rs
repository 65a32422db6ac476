//! How full the configured messages make each bus: the estimate behind `wrenchctl check`.
//!
//! Bits of a frame, inter-frame space included, from none to the most stuff bits: an 8-byte standard frame has 111 to
//! 135 (ISO 11898-1). CAN FD frames are split into the part at the nominal rate and the part at the data rate.

use can::frame::CanId;

/// Whether a configured message is read or written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Read from the bus.
    In,
    /// Published.
    Out,
}

/// One message of the configuration and how often it is expected.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedMessage {
    /// Its name in the DBC.
    pub name: String,
    /// Its identifier.
    pub id: CanId,
    /// Payload on the wire (bytes); more than 8 makes it a CAN FD frame.
    pub len: usize,
    /// The interface.
    pub interface: String,
    /// Read or written.
    pub direction: Direction,
    /// Frames per second (Hz).
    pub rate_hz: f64,
    /// Whether the DBC or the configuration says the rate; otherwise it is assumed.
    pub rate_known: bool,
}

/// Bit rates of a bus (bit/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BitRates {
    /// Classical frames, and arbitration of CAN FD frames (bit/s).
    pub nominal_bps: f64,
    /// Data of CAN FD frames (bit/s).
    pub data_bps: f64,
}

impl Default for BitRates {
    fn default() -> Self {
        Self { nominal_bps: 1e6, data_bps: 5e6 }
    }
}

/// Bits of one frame: the least (no stuff bits) and the most.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameBits {
    /// At the nominal bit rate.
    pub nominal: (u32, u32),
    /// At the data bit rate; none for classical frames.
    pub data: (u32, u32),
}

/// How much of a bus's time the configured messages take, as shares of 1: least and most stuffing.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedLoad {
    /// The interface.
    pub interface: String,
    /// Share of the time with no stuff bits.
    pub least: f64,
    /// Share of the time with the most stuff bits.
    pub most: f64,
}

impl PlannedMessage {
    /// Bits of one of its frames.
    #[must_use]
    pub fn bits(&self) -> FrameBits {
        if self.len <= 8 {
            classical_bits(self.len, self.id.is_extended())
        } else {
            fd_bits(self.len, self.id.is_extended())
        }
    }
}

/// Bits of a classical data frame.
#[must_use]
pub fn classical_bits(len: usize, extended: bool) -> FrameBits {
    let payload = 8 * len as u32;
    // Stuffed from start of frame to the CRC; then CRC delimiter, acknowledge, end of frame, inter-frame space: 13.
    let stuffable = if extended { 54 } else { 34 } + payload;
    let least = stuffable + 13;
    FrameBits { nominal: (least, least + (stuffable - 1) / 4), data: (0, 0) }
}

/// Bits of a CAN FD frame with bit rate switch.
#[must_use]
pub fn fd_bits(len: usize, extended: bool) -> FrameBits {
    // Nominal rate: start of frame to the rate switch, then acknowledge, end of frame and inter-frame space: 12.
    let head = if extended { 36 } else { 17 };
    // Data rate: state indicator and length (5) and payload are stuffed as usual; stuff count (4), CRC and their fixed
    // stuff bits (one before the count, one after each four bits) and the delimiter are not.
    let stuffed = 5 + 8 * len as u32;
    let tail = if len > 16 { 4 + 21 + 7 + 1 } else { 4 + 17 + 6 + 1 };
    let stuff_head = (head - 1) / 4;
    let stuff_data = (head + stuffed - 1) / 4 - stuff_head;
    FrameBits {
        nominal: (head + 12, head + 12 + stuff_head),
        data: (stuffed + tail, stuffed + tail + stuff_data),
    }
}

/// The load of each interface that a message is planned on, in the messages' order.
#[must_use]
pub fn planned_load(messages: &[PlannedMessage], rates: BitRates) -> Vec<PlannedLoad> {
    let mut loads: Vec<PlannedLoad> = Vec::new();
    for message in messages {
        let bits = message.bits();
        let seconds = |nominal: u32, data: u32| {
            f64::from(nominal) / rates.nominal_bps + f64::from(data) / rates.data_bps
        };
        let least = message.rate_hz * seconds(bits.nominal.0, bits.data.0);
        let most = message.rate_hz * seconds(bits.nominal.1, bits.data.1);
        match loads.iter_mut().find(|load| load.interface == message.interface) {
            Some(load) => (load.least, load.most) = (load.least + least, load.most + most),
            None => loads.push(PlannedLoad { interface: message.interface.clone(), least, most }),
        }
    }
    loads
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_have_their_known_lengths() {
        assert_eq!(classical_bits(8, false).nominal, (111, 135));
        assert_eq!(classical_bits(8, true).nominal, (131, 160));
        assert_eq!(classical_bits(0, false).nominal, (47, 55));
        // Measured on 1/5 Mbit/s buses: 64 bytes take 139 to 169 us.
        let bits = fd_bits(64, false);
        let us = |(nominal, data): (u32, u32)| f64::from(nominal) + f64::from(data) / 5.0;
        assert_eq!(us((bits.nominal.0, bits.data.0)), 139.0);
        assert!((us((bits.nominal.1, bits.data.1)) - 169.0).abs() < 0.5);
    }

    #[test]
    fn eight_frames_a_millisecond_do_not_fit_one_classical_bus() {
        let message = |index: u32| PlannedMessage {
            name: format!("M{index}"),
            id: CanId::standard(index).expect("a small number is a standard identifier"),
            len: 8,
            interface: "can0".to_owned(),
            direction: Direction::In,
            rate_hz: 1000.0,
            rate_known: false,
        };
        let load = |count| planned_load(&(0..count).map(message).collect::<Vec<_>>(), BitRates::default());
        assert!(load(8)[0].least < 1.0 && load(8)[0].most > 1.0);
        assert!((load(7)[0].least - 0.777).abs() < 1e-9 && (load(7)[0].most - 0.945).abs() < 1e-9);
    }
}
