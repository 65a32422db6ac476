//! The wrench as three CAN frames (`rig::wire`), offered to the interface's queue in one system call.

use can::frame::{CanId, Frame};
use can::socket::SocketSender;
use rig::Config;
use rig::config::{PublishCan, STANDARD_ID_MAX};
use rig::wire::{FRAME_LEN, QualityFrame, Scale, TripleFrame};

use super::{Output, OutputCounts};
use crate::published::Dispatch;

/// Makes the three frames of a record.
#[derive(Clone, Copy, Debug)]
struct Encoder {
    ids: [CanId; 3],
    force: Scale,
    torque: Scale,
}

#[derive(Debug)]
struct CanOutput {
    encoder: Encoder,
    sender: SocketSender,
}

pub(super) fn open(config: &Config) -> can::Result<Option<Box<dyn Output>>> {
    let Some(can) = &config.publish.can else { return Ok(None) };
    let sender = SocketSender::open(&can.interface)?;
    Ok(Some(Box::new(CanOutput { encoder: Encoder::new(can), sender })))
}

impl Output for CanOutput {
    fn publish(&mut self, record: &Dispatch) {
        self.sender.send(&self.encoder.frames(record));
    }

    fn rehearse(&mut self, record: &Dispatch) {
        std::hint::black_box(self.encoder.frames(record));
    }

    fn counts(&self) -> OutputCounts {
        let counts = self.sender.counts();
        OutputCounts { sent: counts.sent, dropped: counts.full + counts.down + counts.refused }
    }
}

impl Encoder {
    fn new(can: &PublishCan) -> Self {
        Self {
            ids: [can.force_id, can.torque_id, can.quality_id].map(identifier),
            force: Scale(can.force_n_per_bit),
            torque: Scale(can.torque_nm_per_bit),
        }
    }

    /// Force, torque and quality frame. Without a wrench all three are invalid; a wrench beyond a frame's range makes
    /// that frame invalid.
    fn frames(&self, record: &Dispatch) -> [Frame; 3] {
        let (sequence, status) = (record.sequence as u8, record.status.bits());
        let data = match &record.outcome {
            Ok(solution) => {
                let wrench = &solution.wrench;
                let sigma: [f64; 6] = std::array::from_fn(|k| solution.covariance[(k, k)].max(0.0).sqrt());
                [
                    TripleFrame::new(wrench.force_n.into(), self.force, sequence, status).emit(),
                    TripleFrame::new(wrench.moment_nm.into(), self.torque, sequence, status).emit(),
                    QualityFrame::new(sigma, sequence, status).emit(),
                ]
            }
            Err(_) => {
                let invalid = TripleFrame::invalid(sequence, status);
                let quality = QualityFrame::new([f64::NAN; 6], sequence, invalid.status);
                [invalid.emit(), invalid.emit(), quality.emit()]
            }
        };
        std::array::from_fn(|k| frame(self.ids[k], &data[k]))
    }
}

fn identifier(number: u32) -> CanId {
    let id = if number <= STANDARD_ID_MAX { CanId::standard(number) } else { CanId::extended(number) };
    id.expect("binding the configuration has refused identifiers that do not exist")
}

fn frame(id: CanId, data: &[u8; FRAME_LEN]) -> Frame {
    Frame::classical(id, data).expect("a classical frame holds eight bytes")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::Why;
    use model::estimator::Solution;
    use model::spatial::Wrench;
    use nalgebra::{Matrix6, Vector6};
    use rig::Status;
    use rig::wire::{INVALID_RAW, SIGMA_UNKNOWN_RAW};

    fn encoder() -> Encoder {
        Encoder { ids: [0x400, 0x401, 0x1_0402].map(identifier), force: Scale(0.01), torque: Scale(0.001) }
    }

    fn record(force_x_n: f64, status: Status) -> Dispatch {
        let solution = Solution {
            wrench: Wrench::from_vector(&Vector6::new(force_x_n, -2.0, 3.0, 0.1, -0.2, 0.3)),
            covariance: Matrix6::identity() * 0.0001,
            singular_values_per_n: [1.0; 6],
            parity_chi2: 0.0,
            parity_dof: 2,
            protection: [1.0; 6],
        };
        Dispatch { sequence: 258, status, outcome: Ok(solution) }
    }

    fn triples(frames: &[Frame; 3]) -> [TripleFrame; 2] {
        [0, 1].map(|k| TripleFrame::parse(frames[k].data()).unwrap())
    }

    #[test]
    fn a_wrench_is_three_frames_of_one_sequence() {
        let frames = encoder().frames(&record(1.0, Status::DEGRADED));
        assert_eq!(frames.map(|f| f.id().to_string()), ["400", "401", "00010402"]);
        let [force, torque] = triples(&frames);
        assert_eq!((force.raw, torque.raw), ([100, -200, 300], [100, -200, 300]));
        let quality = QualityFrame::parse(frames[2].data()).unwrap();
        assert!(quality.sigma().iter().all(|s| s.is_some_and(|s| (s / 0.01 - 1.0).abs() < 0.08)));
        for (sequence, status) in [
            (force.sequence, force.status),
            (torque.sequence, torque.status),
            (quality.sequence, quality.status),
        ] {
            assert_eq!((sequence, status), (2, 0b10));
        }
    }

    #[test]
    fn beyond_range_the_frame_is_invalid() {
        for force_x_n in [327.68, f64::NAN] {
            let [force, torque] = triples(&encoder().frames(&record(force_x_n, Status::GOOD)));
            assert_eq!((force.raw, force.status), ([INVALID_RAW; 3], 1));
            assert_eq!((torque.raw, torque.status), ([100, -200, 300], 0));
        }
    }

    #[test]
    fn without_a_wrench_all_frames_are_invalid_and_say_why() {
        let status = Status::INVALID.with(Status::STALE);
        let frames = encoder().frames(&Dispatch { outcome: Err(Why::Stale), ..record(1.0, status) });
        for triple in triples(&frames) {
            assert_eq!((triple.raw, triple.sequence, triple.status), ([INVALID_RAW; 3], 2, 0b1001));
        }
        assert_eq!(QualityFrame::parse(frames[2].data()).unwrap().raw, [SIGMA_UNKNOWN_RAW; 6]);
    }
}
