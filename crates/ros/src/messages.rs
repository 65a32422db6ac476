//! The messages.

use crate::cdr::Cdr;

/// Definition of the header that every message begins with, as it stands at the end of theirs.
macro_rules! header {
    () => {
        concat!(
            "================================================================================\n",
            "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
            "================================================================================\n",
            "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
        )
    };
}

/// A ROS 2 message.
pub trait Message {
    /// Its name, as in `geometry_msgs/msg/WrenchStamped`.
    const NAME: &'static str;
    /// Hash of its type (REP 2016), as it stands in rmw_zenoh's keys.
    const TYPE_HASH: &'static str;
    /// Its definition with those of all parts, as ROS 2 bags have it (`ros2msg`).
    const DEFINITION: &'static str;

    /// Its bytes.
    fn cdr(&self) -> Vec<u8>;

    /// Its name as DDS has it: `geometry_msgs::msg::dds_::WrenchStamped_`.
    fn dds_name() -> String {
        let mut parts: Vec<&str> = Self::NAME.split('/').collect();
        let last = parts.pop().unwrap_or_default();
        format!("{}::dds_::{last}_", parts.join("::"))
    }
}

/// An instant, ns since the Unix epoch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp(pub i64);

impl Stamp {
    /// A message's bytes as they begin: with a header of this instant, in this frame.
    fn header(self, frame_id: &str) -> Cdr {
        const SECOND_NS: i64 = 1_000_000_000;
        let mut cdr = Cdr::new();
        let seconds = self.0.div_euclid(SECOND_NS).clamp(i32::MIN.into(), i32::MAX.into());
        cdr.i32(seconds as i32).u32(self.0.rem_euclid(SECOND_NS) as u32).string(frame_id);
        cdr
    }
}

/// `geometry_msgs/msg/WrenchStamped`: force (N) and torque (Nm) in a frame's axes about its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct WrenchStamped {
    /// The instant that it refers to.
    pub stamp: Stamp,
    /// Name of the frame.
    pub frame_id: String,
    /// Fx Fy Fz (N), Tx Ty Tz (Nm).
    pub wrench: [f64; 6],
}

impl Message for WrenchStamped {
    const NAME: &'static str = "geometry_msgs/msg/WrenchStamped";
    const TYPE_HASH: &'static str = "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77";
    const DEFINITION: &'static str = concat!(
        "std_msgs/Header header\nWrench wrench\n",
        "================================================================================\n",
        "MSG: geometry_msgs/Wrench\nVector3 force\nVector3 torque\n",
        "================================================================================\n",
        "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
        header!(),
    );

    fn cdr(&self) -> Vec<u8> {
        let mut cdr = self.stamp.header(&self.frame_id);
        self.wrench.iter().for_each(|value| {
            cdr.f64(*value);
        });
        cdr.done()
    }
}

/// How bad a diagnostic is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// All is well.
    Ok = 0,
    /// Usable, with care.
    Warn = 1,
    /// Not usable.
    Error = 2,
    /// Nothing is heard.
    Stale = 3,
}

/// `diagnostic_msgs/msg/DiagnosticStatus`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// How bad it is.
    pub level: Level,
    /// What it is about.
    pub name: String,
    /// In words.
    pub message: String,
    /// What hardware.
    pub hardware_id: String,
    /// Numbers and words by name.
    pub values: Vec<(String, String)>,
}

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiagnosticArray {
    /// When.
    pub stamp: Stamp,
    /// What there is to say.
    pub status: Vec<Diagnostic>,
}

impl Message for DiagnosticArray {
    const NAME: &'static str = "diagnostic_msgs/msg/DiagnosticArray";
    const TYPE_HASH: &'static str = "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e";
    const DEFINITION: &'static str = concat!(
        "std_msgs/Header header\nDiagnosticStatus[] status\n",
        "================================================================================\n",
        "MSG: diagnostic_msgs/DiagnosticStatus\nbyte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values\n",
        "================================================================================\n",
        "MSG: diagnostic_msgs/KeyValue\nstring key\nstring value\n",
        header!(),
    );

    fn cdr(&self) -> Vec<u8> {
        let mut cdr = self.stamp.header("");
        cdr.u32(self.status.len() as u32);
        for status in &self.status {
            cdr.u8(status.level as u8)
                .string(&status.name)
                .string(&status.message)
                .string(&status.hardware_id);
            cdr.u32(status.values.len() as u32);
            for (key, value) in &status.values {
                cdr.string(key).string(value);
            }
        }
        cdr.done()
    }
}

/// `can_msgs/msg/Frame`: a classical CAN frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CanFrame {
    /// The kernel's stamp.
    pub stamp: Stamp,
    /// Name of the interface.
    pub frame_id: String,
    /// Identifier.
    pub id: u32,
    /// Asks for data.
    pub is_remote: bool,
    /// Its identifier has 29 bits.
    pub is_extended: bool,
    /// Tells of an error on the bus.
    pub is_error: bool,
    /// Bytes in use.
    pub length: u8,
    /// The bytes; what is not in use is zero.
    pub data: [u8; 8],
}

impl Message for CanFrame {
    const NAME: &'static str = "can_msgs/msg/Frame";
    const TYPE_HASH: &'static str = "TypeHashNotSupported";
    const DEFINITION: &'static str = concat!(
        "std_msgs/Header header\nuint32 id\nbool is_rtr\nbool is_extended\nbool is_error\nuint8 dlc\nuint8[8] data\n",
        header!(),
    );

    fn cdr(&self) -> Vec<u8> {
        let mut cdr = self.stamp.header(&self.frame_id);
        cdr.u32(self.id);
        cdr.bool(self.is_remote).bool(self.is_extended).bool(self.is_error).u8(self.length);
        self.data.iter().for_each(|byte| {
            cdr.u8(*byte);
        });
        cdr.done()
    }
}

/// `ros2_socketcan_msgs/msg/FdFrame`: a CAN FD frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FdFrame {
    /// The kernel's stamp.
    pub stamp: Stamp,
    /// Name of the interface.
    pub frame_id: String,
    /// Identifier.
    pub id: u32,
    /// Its identifier has 29 bits.
    pub is_extended: bool,
    /// Tells of an error on the bus.
    pub is_error: bool,
    /// The bytes, 64 at most.
    pub data: Vec<u8>,
}

impl Message for FdFrame {
    const NAME: &'static str = "ros2_socketcan_msgs/msg/FdFrame";
    const TYPE_HASH: &'static str = "TypeHashNotSupported";
    const DEFINITION: &'static str = concat!(
        "std_msgs/Header header\nuint32 id\nbool is_extended\nbool is_error\nuint8 len\nuint8[<=64] data\n",
        header!(),
    );

    fn cdr(&self) -> Vec<u8> {
        let mut cdr = self.stamp.header(&self.frame_id);
        cdr.u32(self.id);
        let data = &self.data[..self.data.len().min(64)];
        cdr.bool(self.is_extended).bool(self.is_error).u8(data.len() as u8).u32(data.len() as u32);
        data.iter().for_each(|byte| {
            cdr.u8(*byte);
        });
        cdr.done()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrench_lies_as_rmw_reads_it() {
        let wrench = WrenchStamped {
            stamp: Stamp(-1),
            frame_id: "tool0".into(),
            wrench: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        };
        let bytes = wrench.cdr();
        assert_eq!(
            bytes[..12],
            [0, 1, 0, 0, 255, 255, 255, 255, 255, 201, 154, 59],
            "one nanosecond before 1970"
        );
        assert_eq!(bytes[12..24], [6, 0, 0, 0, b't', b'o', b'o', b'l', b'0', 0, 0, 0]);
        // 18 bytes of header and name, padded to 24 behind the four of the encapsulation.
        assert_eq!(bytes.len(), 4 + 24 + 48);
        assert_eq!(bytes[28..36], 1f64.to_le_bytes());
        assert_eq!(bytes[68..76], 6f64.to_le_bytes());
        assert_eq!(WrenchStamped::dds_name(), "geometry_msgs::msg::dds_::WrenchStamped_");
    }

    #[test]
    fn diagnostics_and_frames_are_aligned() {
        let status = Diagnostic {
            level: Level::Error,
            name: "a".into(),
            message: "b\0c".into(),
            hardware_id: String::new(),
            values: vec![("k".into(), "v".into())],
        };
        let bytes = DiagnosticArray { stamp: Stamp(0), status: vec![status] }.cdr();
        let expected: &[u8] = &[
            0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0,
            b'a', 0, 0, 0, 4, 0, 0, 0, b'b', b' ', b'c', 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0,
            b'k', 0, 0, 0, 2, 0, 0, 0, b'v', 0,
        ];
        assert_eq!(bytes, expected);
        let frame = CanFrame {
            stamp: Stamp(0),
            frame_id: "can0".into(),
            id: 0x101,
            is_remote: false,
            is_extended: true,
            is_error: false,
            length: 2,
            data: [7, 8, 0, 0, 0, 0, 0, 0],
        };
        let bytes = frame.cdr();
        assert_eq!(bytes[24..28], [1, 1, 0, 0]);
        assert_eq!(bytes[28..], [0, 1, 0, 2, 7, 8, 0, 0, 0, 0, 0, 0]);
        let fd = FdFrame {
            stamp: Stamp(0),
            frame_id: "can0".into(),
            id: 0x101,
            is_extended: false,
            is_error: false,
            data: (1..=12).collect(),
        };
        let bytes = fd.cdr();
        assert_eq!(bytes[24..28], [1, 1, 0, 0]);
        // Length, padding, and the length of the sequence.
        assert_eq!(bytes[28..36], [0, 0, 12, 0, 12, 0, 0, 0]);
        assert_eq!(bytes[36..], [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
    }
}
