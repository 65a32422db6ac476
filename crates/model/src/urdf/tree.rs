//! The tree of links: the way from base to tip, and what branches off it.

use std::collections::HashMap;

use nalgebra::Vector3;
use urdf_rs::{JointType, Robot};

use super::{UrdfError, suggestion};
use crate::chain::{Chain, Joint, JointKind, Limits, unit};

/// Further from one than the rounding of a normalised axis printed with three decimals.
const AXIS_TOLERANCE: f64 = 2e-3;

/// Links by name, each with the joint that carries it.
pub(super) struct Tree<'a> {
    pub(super) robot: &'a Robot,
    pub(super) file: &'a str,
    links: HashMap<&'a str, usize>,
    /// Joint that a link hangs on, per link.
    parent: Vec<Option<usize>>,
    /// Joints that hang on a link, per link.
    pub(super) children: Vec<Vec<usize>>,
}

impl<'a> Tree<'a> {
    /// Checks names and references and connects links with joints.
    pub(super) fn new(robot: &'a Robot, file: &'a str) -> Result<Self, UrdfError> {
        let structure = |what: String| UrdfError::Structure { file: file.to_owned(), what };
        let mut links = HashMap::new();
        for (index, link) in robot.links.iter().enumerate() {
            if links.insert(link.name.as_str(), index).is_some() {
                return Err(structure(format!("two links are called \"{}\"", link.name)));
            }
        }
        let mut tree = Self {
            robot,
            file,
            parent: vec![None; robot.links.len()],
            children: vec![Vec::new(); robot.links.len()],
            links,
        };
        let mut names = HashMap::new();
        for (index, joint) in robot.joints.iter().enumerate() {
            if names.insert(joint.name.as_str(), index).is_some() {
                return Err(structure(format!("two joints are called \"{}\"", joint.name)));
            }
            let (parent, child) = (tree.end(index, "parent")?, tree.end(index, "child")?);
            if let Some(other) = tree.parent[child] {
                return Err(structure(format!(
                    "link \"{}\" is the child of two joints, \"{}\" and \"{}\"",
                    joint.child.link, robot.joints[other].name, joint.name
                )));
            }
            tree.parent[child] = Some(index);
            tree.children[parent].push(index);
        }
        Ok(tree)
    }

    /// Index of a joint's parent or child link.
    pub(super) fn end(&self, joint: usize, role: &str) -> Result<usize, UrdfError> {
        let joint = &self.robot.joints[joint];
        let name = if role == "parent" { &joint.parent.link } else { &joint.child.link };
        self.links.get(name.as_str()).copied().ok_or_else(|| UrdfError::Structure {
            file: self.file.to_owned(),
            what: format!(
                "joint \"{}\" has the {role} link \"{name}\", which does not exist{}",
                joint.name,
                suggestion(name, self.robot.links.iter().map(|link| link.name.as_str()))
            ),
        })
    }

    /// The chain from `base` to `tip`.
    pub(super) fn chain(
        &self,
        base: &str,
        tip: &str,
        gravity_mps2: Vector3<f64>,
    ) -> Result<Chain, UrdfError> {
        let way = self.way(self.link("base", base)?, self.link("tip", tip)?)?;
        let mut chain = Chain {
            joints: Vec::with_capacity(way.len()),
            gravity_mps2,
            base: base.to_owned(),
            tip: tip.to_owned(),
            warnings: Vec::new(),
            file_name: self.file.to_owned(),
            other_joints: Vec::new(),
        };
        let mut coordinates = 0;
        for &index in &way {
            let kind = self.kind(index)?;
            let coordinate = (kind != JointKind::Fixed).then_some(coordinates);
            coordinates += usize::from(coordinate.is_some());
            let joint = self.joint(index, kind, coordinate, &way, &mut chain.warnings)?;
            chain.joints.push(joint);
        }
        let others = self.robot.joints.iter().enumerate().filter(|(index, _)| !way.contains(index));
        chain.other_joints = others.map(|(_, joint)| joint.name.clone()).collect();
        Ok(chain)
    }

    fn link(&self, role: &'static str, name: &str) -> Result<usize, UrdfError> {
        self.links.get(name).copied().ok_or_else(|| UrdfError::UnknownLink {
            file: self.file.to_owned(),
            role,
            name: name.to_owned(),
            suggestion: suggestion(name, self.robot.links.iter().map(|link| link.name.as_str())),
        })
    }

    /// Joints from the base link to the tip link, in this order.
    fn way(&self, base: usize, tip: usize) -> Result<Vec<usize>, UrdfError> {
        if base == tip {
            let (file, link) = (self.file.to_owned(), self.robot.links[tip].name.clone());
            return Err(UrdfError::SameLink { file, link });
        }
        let mut way = Vec::new();
        let mut link = tip;
        let mut names = Vec::new();
        while link != base {
            let Some(joint) = self.parent[link] else { break };
            if way.len() > self.robot.links.len() {
                return Err(UrdfError::Structure {
                    file: self.file.to_owned(),
                    what: format!("the ancestors of link \"{}\" form a loop", self.robot.links[tip].name),
                });
            }
            way.push(joint);
            link = self.end(joint, "parent")?;
            names.push(format!("\"{}\"", self.robot.links[link].name));
        }
        if link == base {
            way.reverse();
            return Ok(way);
        }
        Err(UrdfError::NotAncestor {
            file: self.file.to_owned(),
            base: self.robot.links[base].name.clone(),
            tip: self.robot.links[tip].name.clone(),
            ancestors: if names.is_empty() { "none".to_owned() } else { names.join(", ") },
        })
    }

    /// Kind of a joint on the way, if the arm can have it.
    fn kind(&self, index: usize) -> Result<JointKind, UrdfError> {
        let joint = &self.robot.joints[index];
        let refuse = |kind: String| UrdfError::Unsupported {
            file: self.file.to_owned(),
            joint: joint.name.clone(),
            kind,
        };
        let kind = match joint.joint_type {
            JointType::Revolute => JointKind::Revolute,
            JointType::Continuous => JointKind::Continuous,
            JointType::Fixed => return Ok(JointKind::Fixed),
            JointType::Prismatic => return Err(refuse("prismatic".to_owned())),
            JointType::Floating => return Err(refuse("floating".to_owned())),
            JointType::Planar => return Err(refuse("planar".to_owned())),
            JointType::Spherical => return Err(refuse("spherical".to_owned())),
        };
        match &joint.mimic {
            Some(mimic) => Err(refuse(format!("a mimic of \"{}\"", mimic.joint))),
            None => Ok(kind),
        }
    }

    /// One joint of the chain with its child link and what branches off from that.
    fn joint(
        &self,
        index: usize,
        kind: JointKind,
        coordinate: Option<usize>,
        way: &[usize],
        warnings: &mut Vec<String>,
    ) -> Result<Joint, UrdfError> {
        let joint = &self.robot.joints[index];
        let axis = if kind == JointKind::Fixed { Vector3::z() } else { self.axis(index, warnings)? };
        Ok(Joint {
            name: joint.name.clone(),
            child_link: joint.child.link.clone(),
            kind,
            axis,
            origin: self.pose("joint", &joint.name, &joint.origin)?,
            body: self.lump(self.end(index, "child")?, way, warnings)?,
            limits: self.limits(index, kind, warnings),
            coordinate,
        })
    }

    fn axis(&self, index: usize, warnings: &mut Vec<String>) -> Result<Vector3<f64>, UrdfError> {
        let joint = &self.robot.joints[index];
        let given = Vector3::from(joint.axis.xyz.0);
        let axis = unit(&given).ok_or_else(|| {
            self.number(
                "joint",
                &joint.name,
                format!("the axis {:?}, which has no direction", joint.axis.xyz.0),
            )
        })?;
        if (given.norm() - 1.0).abs() > AXIS_TOLERANCE {
            warnings.push(format!(
                "joint \"{}\": its axis {:?} is not a unit vector and was made one",
                joint.name, joint.axis.xyz.0
            ));
        }
        Ok(axis)
    }

    fn limits(&self, index: usize, kind: JointKind, warnings: &mut Vec<String>) -> Option<Limits> {
        let joint = &self.robot.joints[index];
        if kind == JointKind::Fixed || joint.limit == urdf_rs::JointLimit::default() {
            return None;
        }
        let given = &joint.limit;
        let (lower_rad, upper_rad) = match kind {
            JointKind::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
            _ => (given.lower, given.upper),
        };
        if !(lower_rad <= upper_rad && given.velocity >= 0.0 && given.effort >= 0.0) {
            warnings.push(format!(
                "joint \"{}\": its limits contradict each other (lower {lower_rad}, upper {upper_rad}, velocity {}, \
                 effort {}) and are not used",
                joint.name, given.velocity, given.effort
            ));
            return None;
        }
        Some(Limits { lower_rad, upper_rad, velocity_rad_s: given.velocity, effort_nm: given.effort })
    }
}
