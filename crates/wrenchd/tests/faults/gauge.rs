//! Faults of the gauges themselves, put into the frames of the reference arm (two gauges of 24 bits a frame, little-endian).

use can::frame::Stamped;

/// The frame and the first byte of a gauge's counts.
fn place(gauge: usize) -> (u32, usize) {
    (257 + gauge as u32 / 2, 3 * (gauge % 2))
}

/// The message that carries a gauge, and its neighbour.
pub(crate) fn message(gauge: usize) -> u32 {
    place(gauge).0
}

fn counts(data: &[u8], at: usize) -> i32 {
    i32::from_le_bytes([0, data[at], data[at + 1], data[at + 2]]) >> 8
}

/// Changes a gauge's counts in a frame, if it is its frame.
pub(crate) fn change(frame: &mut Stamped, gauge: usize, mut to: impl FnMut(f64) -> f64) {
    let (id, at) = place(gauge);
    if frame.frame.id().number() != id {
        return;
    }
    let data = frame.frame.data_mut();
    let changed = to(f64::from(counts(data, at))).round().clamp(-8_388_608.0, 8_388_607.0) as i32;
    data[at..at + 3].copy_from_slice(&changed.to_le_bytes()[..3]);
}

/// Changes a joint's position (rad) in a frame, if it is its frame: two of 32 bits a frame, 1e-6 rad a bit.
pub(crate) fn change_position(frame: &mut Stamped, joint: usize, mut to: impl FnMut(f64) -> f64) {
    let (id, at) = (513 + joint as u32 / 2, 4 * (joint % 2));
    if frame.frame.id().number() != id {
        return;
    }
    let data = frame.frame.data_mut();
    let raw = i32::from_le_bytes([data[at], data[at + 1], data[at + 2], data[at + 3]]);
    let changed = (to(f64::from(raw) * 1e-6) * 1e6).round() as i32;
    data[at..at + 4].copy_from_slice(&changed.to_le_bytes());
}
