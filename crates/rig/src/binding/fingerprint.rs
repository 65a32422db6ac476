//! What a calibrated model depends on, so that the model of another arm is refused with the difference named.

use std::fmt::Write as _;
use std::io::Read;

use can::assembly::Layout;
use model::chain::{Chain, Joint, Section};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::config::Config;

/// What a calibrated model depends on: gauges in order, their sections, and the arm's kinematics and inertias.
///
/// File names, formatting, limits and what does not belong to the chain do not count, nor does what may change after
/// a calibration: the tool, gravity, the signals' places on the bus (but what a bit of a gauge's signal means does).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Gauges in the configuration's order.
    pub sensors: Vec<SensorPrint>,
    /// Joints from base to tip, fixed ones included.
    pub joints: Vec<JointPrint>,
}

/// Where one gauge sits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SensorPrint {
    /// Name.
    pub name: String,
    /// URDF joint of its section.
    pub section: String,
    /// SHA-256 of its nominal sensing frame against the child link's.
    pub frame_sha256: String,
    /// Counts that one bit of its signal stands for.
    pub counts_per_bit: f64,
    /// Counts at raw zero.
    pub offset_counts: f64,
    /// Unit of its signal in the DBC.
    pub unit: String,
}

/// One joint with its child link.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JointPrint {
    /// Name.
    pub name: String,
    /// SHA-256 of kind, origin and axis.
    pub kinematics_sha256: String,
    /// SHA-256 of the child link's mass, first moment and inertia, branches included.
    pub inertia_sha256: String,
}

impl Fingerprint {
    /// The fingerprint of a chain without tool and of the gauges on it.
    pub(super) fn new(config: &Config, chain: &Chain, sections: &[Section], layout: &Layout) -> Self {
        let sensors = config.sensors.iter().zip(sections).zip(&layout.gauges);
        Self {
            sensors: sensors
                .map(|((sensor, section), gauge)| SensorPrint {
                    name: sensor.name.clone(),
                    section: sensor.section.clone(),
                    frame_sha256: of_numbers("", section.r_cs.iter().copied()),
                    counts_per_bit: gauge.counts.spec.scale,
                    offset_counts: gauge.counts.spec.offset,
                    unit: gauge.counts.spec.unit.clone(),
                })
                .collect(),
            joints: chain.joints.iter().map(JointPrint::new).collect(),
        }
    }

    /// SHA-256 (hex) of the whole fingerprint.
    #[must_use]
    pub fn sha256(&self) -> String {
        let mut text = String::new();
        for sensor in &self.sensors {
            let reading = (sensor.counts_per_bit, sensor.offset_counts, &sensor.unit);
            let _ = writeln!(
                text,
                "sensor {:?} {:?} {} {reading:?}",
                sensor.name, sensor.section, sensor.frame_sha256
            );
        }
        for joint in &self.joints {
            let _ =
                writeln!(text, "joint {:?} {} {}", joint.name, joint.kinematics_sha256, joint.inertia_sha256);
        }
        sha256_hex(text.as_bytes())
    }

    /// The first difference from the fingerprint `calibrated` that a model was made for, in words; none if they agree.
    #[must_use]
    pub fn difference(&self, calibrated: &Self) -> Option<String> {
        sensors_differ(&calibrated.sensors, &self.sensors)
            .or_else(|| joints_differ(&calibrated.joints, &self.joints))
    }
}

impl JointPrint {
    fn new(joint: &Joint) -> Self {
        let origin = joint.origin.rotation.iter().chain(joint.origin.translation_m.iter());
        Self {
            name: joint.name.clone(),
            kinematics_sha256: of_numbers(
                &format!("{:?}", joint.kind),
                origin.chain(joint.axis.iter()).copied(),
            ),
            inertia_sha256: of_numbers("", joint.body.parameters()),
        }
    }
}

fn sensors_differ(model: &[SensorPrint], here: &[SensorPrint]) -> Option<String> {
    let names = |list: &[SensorPrint]| list.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ");
    if !model.iter().map(|s| &s.name).eq(here.iter().map(|s| &s.name)) {
        return Some(format!(
            "its gauges are {}, in this order, those of the configuration {}",
            names(model),
            names(here)
        ));
    }
    model.iter().zip(here).find_map(|(model, here)| {
        if model.section != here.section {
            let name = &model.name;
            return Some(format!(
                "its gauge \"{name}\" sits at \"{}\", the configuration's at \"{}\"",
                model.section, here.section
            ));
        }
        let reading = |s: &SensorPrint| (s.counts_per_bit, s.offset_counts, s.unit.clone());
        if reading(model) != reading(here) {
            let said = |s: &SensorPrint| format!("({},{}) \"{}\"", s.counts_per_bit, s.offset_counts, s.unit);
            return Some(format!(
                "its gauge \"{}\" is read with scale, offset and unit {}, the configuration's with {}",
                model.name,
                said(model),
                said(here)
            ));
        }
        (model.frame_sha256 != here.frame_sha256)
            .then(|| format!("its gauge \"{}\" has another sensing axis", model.name))
    })
}

fn joints_differ(model: &[JointPrint], here: &[JointPrint]) -> Option<String> {
    let names = |list: &[JointPrint]| list.iter().map(|j| j.name.as_str()).collect::<Vec<_>>().join(", ");
    if !model.iter().map(|j| &j.name).eq(here.iter().map(|j| &j.name)) {
        return Some(format!("its arm has the joints {}, the URDF {}", names(model), names(here)));
    }
    model.iter().zip(here).find_map(|(model, here)| {
        if model.kinematics_sha256 != here.kinematics_sha256 {
            return Some(format!(
                "its joint \"{}\" has another kind, origin or axis than the URDF's",
                model.name
            ));
        }
        let words = format!(
            "its link after joint \"{}\" has another mass, centre of mass or inertia than the URDF's",
            model.name
        );
        (model.inertia_sha256 != here.inertia_sha256).then_some(words)
    })
}

/// SHA-256 (hex) of numbers to twelve digits, so that formatting and the last bits do not count.
fn of_numbers(tag: &str, numbers: impl IntoIterator<Item = f64>) -> String {
    let mut text = tag.to_owned();
    for number in numbers {
        // What is below a picometre or its like is rounding of a rotation matrix; adding 0 makes -0 into 0.
        let number = if number.abs() < 1e-12 { 0.0 } else { number } + 0.0;
        let _ = write!(text, " {number:.11e}");
    }
    sha256_hex(text.as_bytes())
}

/// SHA-256 of bytes, in lower-case hexadecimal.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// The same of whatever is left to read, which may be more than memory holds.
///
/// # Errors
/// It cannot be read.
pub fn sha256_of(mut input: impl Read) -> std::io::Result<String> {
    let mut sum = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match input.read(&mut buffer) {
            Ok(0) => return Ok(hexadecimal(&sum.finalize())),
            Ok(got) => sum.update(&buffer[..got]),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut hex, byte| {
        let _ = write!(hex, "{byte:02x}");
        hex
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn sha256_is_the_standard() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(super::sha256_hex(b"abc"), abc);
        assert_eq!(super::sha256_of(&b"abc"[..]).unwrap(), abc);
        let long = b"abc".repeat(100_000);
        assert_eq!(super::sha256_of(&long[..]).unwrap(), super::sha256_hex(&long));
    }
}
