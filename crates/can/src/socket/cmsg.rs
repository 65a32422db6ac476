//! Control messages beside a frame: the kernel's stamp and its total of dropped frames

/// What the kernel said about one frame
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) struct Control {
    /// `CLOCK_REALTIME` at reception, ns since the Unix epoch
    pub(super) stamp_ns: Option<i64>,
    /// Frames dropped on this socket since it was opened
    pub(super) drops: Option<u32>,
}

const HEADER: usize = size_of::<libc::cmsghdr>();
const LEN: usize = size_of::<usize>();

fn integer(bytes: &[u8], at: usize) -> Option<i32> {
    bytes.get(at..at + 4)?.try_into().ok().map(i32::from_ne_bytes)
}

fn long(bytes: &[u8], at: usize) -> Option<i64> {
    bytes.get(at..at + 8)?.try_into().ok().map(i64::from_ne_bytes)
}

/// Reads a control buffer; ends at the first message that does not fit
pub(super) fn parse(mut bytes: &[u8]) -> Control {
    let mut control = Control::default();
    while bytes.len() >= HEADER {
        // struct cmsghdr: size_t (socklen_t and padding on some libraries) length, int level, int type
        let Some(len) = bytes.get(..LEN).and_then(|len| len.try_into().ok()).map(usize::from_ne_bytes) else {
            break;
        };
        let (level, kind) = (integer(bytes, HEADER - 8), integer(bytes, HEADER - 4));
        let Some(body) = bytes.get(HEADER..len) else { break };
        match (level, kind) {
            (Some(libc::SOL_SOCKET), Some(libc::SCM_TIMESTAMPNS)) if body.len() >= 16 => {
                let stamp = long(body, 0).zip(long(body, 8));
                control.stamp_ns = stamp.and_then(|(s, ns)| s.checked_mul(1_000_000_000)?.checked_add(ns));
            }
            (Some(libc::SOL_SOCKET), Some(libc::SO_RXQ_OVFL)) => {
                control.drops = integer(body, 0).map(|total| total as u32);
            }
            _ => {}
        }
        let next = len.next_multiple_of(LEN);
        if next > bytes.len() {
            break;
        }
        bytes = &bytes[next..];
    }
    control
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(kind: i32, body: &[u8]) -> Vec<u8> {
        let mut bytes = (HEADER + body.len()).to_ne_bytes().to_vec();
        bytes.extend(libc::SOL_SOCKET.to_ne_bytes());
        bytes.extend(kind.to_ne_bytes());
        assert_eq!(bytes.len(), HEADER);
        bytes.extend(body);
        bytes.resize(bytes.len().next_multiple_of(LEN), 0);
        bytes
    }

    #[test]
    fn stamp_and_drops_in_any_order() {
        let mut stamp = 1_790_000_000i64.to_ne_bytes().to_vec();
        stamp.extend(123_456_789i64.to_ne_bytes());
        let stamp = message(libc::SCM_TIMESTAMPNS, &stamp);
        let drops = message(libc::SO_RXQ_OVFL, &7u32.to_ne_bytes());
        let other = message(99, &[1, 2, 3]);
        let expected = Control { stamp_ns: Some(1_790_000_000_123_456_789), drops: Some(7) };
        assert_eq!(parse(&[&drops[..], &other, &stamp].concat()), expected);
        assert_eq!(parse(&[&stamp[..], &drops].concat()), expected);
        assert_eq!(parse(&[]), Control::default());
    }

    #[test]
    fn lying_lengths_end_it() {
        for len in [0usize, 3, HEADER - 1, HEADER + 500, usize::MAX] {
            let mut bytes = message(libc::SO_RXQ_OVFL, &7u32.to_ne_bytes());
            bytes[..LEN].copy_from_slice(&len.to_ne_bytes());
            assert_eq!(parse(&bytes), Control::default());
        }
    }
}
