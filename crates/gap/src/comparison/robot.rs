//! The arm of a comparison: its URDF, from the root to the link that the last listed joint moves.

use std::path::Path;

use model::chain::{Chain, JointKind, Section};
use nalgebra::{Vector3, Vector6};
use rig::RigError;
use rig::document::Problem;
use rig::document::Step::Key;
use rig::error::{read_text, suggest};

use super::description::Robot;
use crate::effects::moment_channels;
use crate::session::{Joint, Kinematics, Sensing, Session};

/// Why there is no arm.
pub(super) enum Failure {
    /// A file.
    Rig(RigError),
    /// A place in the description.
    Problem(Problem),
}

impl<E: Into<RigError>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Rig(error.into())
    }
}

/// The arm, if every joint that moves has a position, and what the reader should know.
pub(super) fn load(
    dir: &Path,
    robot: &Robot,
    session: &Session,
) -> Result<(Option<Kinematics>, Vec<String>), Failure> {
    let joints = &session.joints;
    let file = dir.join(&robot.urdf);
    let text = read_text(&file, "the robot's URDF")?;
    let name = file.display().to_string();
    let (base, tip) = ends(&text, robot, joints, &file)?;
    let chain = Chain::from_urdf(&text, &name, &base, &tip, Vector3::from(robot.gravity))?;
    let mut notes = chain.warnings.clone();
    let mut places = Vec::new();
    for moving in chain.joints.iter().filter(|joint| joint.kind != JointKind::Fixed) {
        let Some(place) = joints.iter().position(|joint| joint.name == moving.name) else {
            notes.push(format!(
                "joint \"{}\" of {name} has no [[joint]] with its position: effects of weight are not tested",
                moving.name
            ));
            return Ok((None, notes));
        };
        places.push(place);
    }
    let has_masses = chain.joints.iter().any(|joint| joint.body.mass_kg > 0.0);
    let sensing = sensing(session, &chain, &places);
    let arm =
        Kinematics { chain, joints: places, has_masses, sensing, carried: Vec::new(), wrench: Vec::new() };
    Ok((Some(arm), notes))
}

/// Channels that measure a joint's torque, in the sign of simulators: what the joint must apply to the outboard side.
fn sensing(session: &Session, chain: &Chain, joints: &[usize]) -> Vec<Sensing> {
    let minus_z = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let of_joint = |joint: usize| {
        let section = Section::new(chain, &session.joints[joint].name, None).ok();
        let channels = moment_channels(session, joint);
        channels
            .filter_map(move |(channel, _)| section.map(|section| Sensing { channel, section, row: minus_z }))
    };
    joints.iter().flat_map(|joint| of_joint(*joint)).collect()
}

/// The root of the tree and the link that the outermost listed joint moves, unless they are given.
fn ends(text: &str, robot: &Robot, joints: &[Joint], file: &Path) -> Result<(String, String), Failure> {
    let tree = urdf_rs::read_from_string(text)
        .map_err(|error| RigError::of_file(file, format!("is no URDF: {error}; export it again")))?;
    let carrier = |link: &str| tree.joints.iter().find(|joint| joint.child.link == link);
    let ancestors = |name: &str| {
        let mut link =
            tree.joints.iter().find(|joint| joint.name == name).map(|joint| joint.child.link.as_str());
        // A loop among the links ends at the number of joints; the chain's own reader names it.
        std::iter::from_fn(move || {
            let joint = carrier(link?)?;
            link = Some(joint.parent.link.as_str());
            Some(joint)
        })
        .take(tree.joints.len())
    };
    let known = tree.joints.iter().map(|joint| joint.name.as_str());
    for (index, joint) in joints.iter().enumerate() {
        if known.clone().all(|known| known != joint.name) {
            let text = format!(
                "name = \"{}\" is no joint of {}; {}",
                joint.name,
                file.display(),
                suggest(&joint.name, known)
            );
            let at = [Key("joint"), rig::document::Step::Index(index), Key("name")];
            return Err(Failure::Problem(Problem::new(&at, text)));
        }
    }
    let outermost = joints.iter().max_by_key(|joint| ancestors(&joint.name).count());
    let Some(outermost) = outermost else {
        let text = "[robot] needs the joints' positions; add a [[joint]] with name and position for each";
        return Err(Failure::Problem(Problem::new(&[Key("robot")], text)));
    };
    let tip = ancestors(&outermost.name).next().map(|joint| joint.child.link.clone());
    let base = ancestors(&outermost.name).last().map(|joint| joint.parent.link.clone());
    Ok((robot.base.clone().or(base).unwrap_or_default(), robot.tip.clone().or(tip).unwrap_or_default()))
}
