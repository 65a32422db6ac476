//! `struct can_frame` and `struct canfd_frame` as bytes

use crate::frame::{CanId, Flags, Frame};

/// Bytes of a classical frame
pub(super) const CLASSICAL_MTU: usize = size_of::<libc::can_frame>();
/// Bytes of an FD frame
pub(super) const FD_MTU: usize = size_of::<libc::canfd_frame>();

/// A frame from what the kernel handed over, told apart by its size; `None` for anything else
pub(super) fn decode(bytes: &[u8]) -> Option<Frame> {
    let fd = match bytes.len() {
        CLASSICAL_MTU => false,
        FD_MTU => true,
        _ => return None,
    };
    let raw = u32::from_ne_bytes(bytes.get(..4)?.try_into().ok()?);
    let len = usize::from(bytes[4]);
    let data = bytes.get(8..8 + len)?;
    if raw & libc::CAN_ERR_FLAG != 0 {
        return Frame::error(raw & libc::CAN_ERR_MASK, data);
    }
    let id = if raw & libc::CAN_EFF_FLAG != 0 {
        CanId::extended(raw & libc::CAN_EFF_MASK)?
    } else {
        CanId::standard(raw & libc::CAN_SFF_MASK)?
    };
    if fd {
        return Frame::fd(id, bytes[5], data);
    }
    let frame =
        if raw & libc::CAN_RTR_FLAG != 0 { Frame::remote(id, bytes[4]) } else { Frame::classical(id, data) };
    frame.map(|frame| frame.with_raw_dlc(bytes[7]))
}

/// What the kernel takes for a frame; the number of bytes
pub(super) fn encode(frame: &Frame, bytes: &mut [u8; FD_MTU]) -> usize {
    let flags = frame.flags();
    let mut raw = frame.id().with_flag();
    if flags.has(Flags::ERROR) {
        raw = frame.id().number() | libc::CAN_ERR_FLAG;
    }
    if flags.has(Flags::REMOTE) {
        raw |= libc::CAN_RTR_FLAG;
    }
    bytes[..4].copy_from_slice(&raw.to_ne_bytes());
    bytes[4] = frame.len() as u8;
    let fd = flags.has(Flags::FD);
    bytes[5] = if fd { flags.fd_nibble() } else { 0 };
    bytes[6] = 0;
    bytes[7] = frame.raw_dlc();
    bytes[8..].copy_from_slice(frame.padded());
    if fd { FD_MTU } else { CLASSICAL_MTU }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip() {
        let standard = CanId::standard(0x7FF).unwrap();
        let extended = CanId::extended(0x1).unwrap();
        for frame in [
            Frame::classical(standard, &[1, 2, 3]),
            Frame::classical(extended, &[9; 8]).map(|frame| frame.with_raw_dlc(12)),
            Frame::fd(standard, 5, &[7; 64]),
            Frame::fd(extended, 0, &[]),
            Frame::remote(standard, 4),
            Frame::error(0x204, &[0, 1, 2, 3, 4, 5, 6, 7]),
        ] {
            let frame = frame.unwrap();
            let mut bytes = [0xAA; FD_MTU];
            let len = encode(&frame, &mut bytes);
            assert_eq!(decode(&bytes[..len]), Some(frame));
        }
        assert_eq!((CLASSICAL_MTU, FD_MTU), (16, 72));
    }

    #[test]
    fn what_no_kernel_sends() {
        assert_eq!(decode(&[0; 15]), None);
        let mut bytes = [0; 16];
        bytes[4] = 9;
        assert_eq!(decode(&bytes), None);
    }
}
