//! The tree of links, with every name resolved.

use std::collections::HashMap;

use spec::nearest;

use crate::document::{Document, Joint, Link};
use crate::{Part, UrdfError};

/// A document whose joints connect its links to trees.
pub(crate) struct Tree {
    pub(crate) links: Vec<Link>,
    pub(crate) joints: Vec<Joint>,
    /// Name of the robot.
    pub(crate) name: String,
    /// The joint that moves each link. Roots have none.
    pub(crate) joint_of: Vec<Option<usize>>,
    /// The joints whose parent each link is, in the order of the text.
    pub(crate) joints_on: Vec<Vec<usize>>,
    /// The links before and behind each joint.
    pub(crate) ends: Vec<Ends>,
    links_by_name: HashMap<String, usize>,
    joints_by_name: HashMap<String, usize>,
}

/// The links that a joint connects.
#[derive(Clone, Copy)]
pub(crate) struct Ends {
    pub(crate) parent: usize,
    pub(crate) child: usize,
}

impl Tree {
    pub(crate) fn new(document: Document) -> Result<Self, UrdfError> {
        let Document { name, links, joints } = document;
        if links.is_empty() {
            return Err(UrdfError::Missing { part: Part::Robot, missing: "<link>".to_owned() });
        }
        let links_by_name = by_name(links.iter().map(|link| &link.name), Part::Link)?;
        let joints_by_name = by_name(joints.iter().map(|joint| &joint.name), Part::Joint)?;
        let mut tree = Self {
            joint_of: vec![None; links.len()],
            joints_on: vec![Vec::new(); links.len()],
            ends: Vec::with_capacity(joints.len()),
            links,
            joints,
            name,
            links_by_name,
            joints_by_name,
        };
        for index in 0..tree.joints.len() {
            tree.connect(index)?;
        }
        tree.refuse_loops()?;
        Ok(tree)
    }

    fn connect(&mut self, index: usize) -> Result<(), UrdfError> {
        let joint = &self.joints[index];
        let user = |role: &str| format!("the <{role}> of {}", Part::Joint(joint.name.clone()));
        let parent = self.link(&joint.parent, || user("parent"))?;
        let child = self.link(&joint.child, || user("child"))?;
        if let Some(other) = self.joint_of[child].replace(index) {
            return Err(UrdfError::TwoParents {
                link: joint.child.clone(),
                joints: [self.joints[other].name.clone(), joint.name.clone()],
            });
        }
        self.joints_on[parent].push(index);
        self.ends.push(Ends { parent, child });
        Ok(())
    }

    /// Every link has at most one joint, so links that no root leads to form loops.
    fn refuse_loops(&self) -> Result<(), UrdfError> {
        let mut is_reached = vec![false; self.links.len()];
        for root in self.roots() {
            for link in self.behind(root) {
                is_reached[link] = true;
            }
        }
        match is_reached.iter().position(|is_reached| !is_reached) {
            Some(link) => Err(UrdfError::Loop { link: self.links[link].name.clone() }),
            None => Ok(()),
        }
    }

    /// Links that are the child of no joint.
    pub(crate) fn roots(&self) -> Vec<usize> {
        (0..self.links.len()).filter(|link| self.joint_of[*link].is_none()).collect()
    }

    /// A link and all that follow it, each after the one before it.
    pub(crate) fn behind(&self, first: usize) -> Vec<usize> {
        let mut links = vec![first];
        let mut next = 0;
        while let Some(link) = links.get(next) {
            next += 1;
            links.extend(self.joints_on[*link].iter().map(|joint| self.ends[*joint].child));
        }
        links
    }

    /// The link before a link.
    pub(crate) fn parent_of(&self, link: usize) -> Option<usize> {
        self.joint_of[link].map(|joint| self.ends[joint].parent)
    }

    /// The joints from `base` to `tip`.
    pub(crate) fn path(&self, base: usize, tip: usize) -> Option<Vec<usize>> {
        let mut path = Vec::new();
        let mut link = tip;
        while link != base {
            let joint = self.joint_of[link]?;
            path.push(joint);
            link = self.ends[joint].parent;
        }
        path.reverse();
        Some(path)
    }

    /// The link of this name. `user` says who names it.
    pub(crate) fn link(
        &self,
        name: &str,
        user: impl FnOnce() -> String,
    ) -> Result<usize, UrdfError> {
        self.links_by_name.get(name).copied().ok_or_else(|| UrdfError::Unknown {
            user: user(),
            named: Part::Link(name.to_owned()),
            nearest: nearest(name, self.links.iter().map(|link| link.name.as_str()))
                .map(str::to_owned),
            allowed: self.links.iter().map(|link| link.name.clone()).collect(),
        })
    }

    /// The joint of this name. `user` says who names it.
    pub(crate) fn joint(
        &self,
        name: &str,
        user: impl FnOnce() -> String,
    ) -> Result<usize, UrdfError> {
        self.joints_by_name.get(name).copied().ok_or_else(|| UrdfError::Unknown {
            user: user(),
            named: Part::Joint(name.to_owned()),
            nearest: nearest(name, self.joints.iter().map(|joint| joint.name.as_str()))
                .map(str::to_owned),
            allowed: self.joints.iter().map(|joint| joint.name.clone()).collect(),
        })
    }
}

fn by_name<'a>(
    names: impl Iterator<Item = &'a String>,
    part: impl Fn(String) -> Part,
) -> Result<HashMap<String, usize>, UrdfError> {
    let mut by_name = HashMap::new();
    for (index, name) in names.enumerate() {
        if by_name.insert(name.clone(), index).is_some() {
            return Err(UrdfError::SameName { part: part(name.clone()) });
        }
    }
    Ok(by_name)
}
