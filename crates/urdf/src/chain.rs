//! The chain from base to tip: which joints move, and where the others stand.

use std::collections::HashSet;

use crate::document::{Joint, Kind};
use crate::part::{Doubts, listed, shown};
use crate::tree::Tree;
use crate::{Options, Part, UrdfError};

/// The moving joints of an arm, and the positions of all others.
pub(crate) struct Chain {
    pub(crate) base: usize,
    pub(crate) tip: usize,
    /// Joints from the base to the tip.
    pub(crate) moving: Vec<usize>,
    /// Position of every joint of the tree, rad or m. Moving joints have 0.
    pub(crate) positions: Vec<f64>,
}

impl Chain {
    pub(crate) fn new(
        tree: &Tree,
        options: &Options,
        doubts: &mut Doubts,
    ) -> Result<Self, UrdfError> {
        let is_locked = locked(tree, options, doubts)?;
        let may_move = |joint: usize| {
            let Joint { kind, mimic, .. } = &tree.joints[joint];
            kind.turns() && mimic.is_none() && !is_locked[joint]
        };
        let base = base(tree, options, doubts)?;
        let tip = match &options.tip {
            Some(tip) => tree.link(tip, || "the tip".to_owned())?,
            None => far_tip(tree, base, &may_move, doubts)?,
        };
        let name = |link: usize| tree.links[link].name.clone();
        let path = tree
            .path(base, tip)
            .ok_or_else(|| UrdfError::NotAChain { base: name(base), tip: name(tip) })?;
        for joint in &path {
            let Joint { name, kind, .. } = &tree.joints[*joint];
            let stands = *kind == Kind::Fixed || kind.turns() || is_locked[*joint];
            if !stands && tree.joints[*joint].mimic.is_none() {
                return Err(UrdfError::Unsupported { joint: name.clone(), kind: kind.name() });
            }
        }
        let moving: Vec<usize> = path.into_iter().filter(|joint| may_move(*joint)).collect();
        if moving.is_empty() {
            return Err(UrdfError::NothingMoves { base: name(base), tip: name(tip) });
        }
        if moving.len() > spec::MAX_JOINTS {
            let joints = moving.iter().map(|joint| tree.joints[*joint].name.clone()).collect();
            return Err(UrdfError::TooManyJoints { joints });
        }
        let chain = Self { base, tip, moving, positions: positions(tree, options)? };
        chain.doubt_frozen(tree, &is_locked, doubts);
        Ok(chain)
    }

    /// Names the joints that could move, but stand still.
    fn doubt_frozen(&self, tree: &Tree, is_locked: &[bool], doubts: &mut Doubts) {
        let first = tree.ends[self.moving[0]].child;
        let behind: HashSet<usize> = tree.behind(first).into_iter().collect();
        let mut left_out = Vec::new();
        for (index, joint) in tree.joints.iter().enumerate() {
            let stands = self.positions[index];
            if joint.kind == Kind::Fixed || is_locked[index] || self.moving.contains(&index) {
                continue;
            }
            if !behind.contains(&tree.ends[index].child) {
                left_out.push(joint.name.as_str());
                continue;
            }
            let unit = joint.kind.unit();
            let mut text = match &joint.mimic {
                Some(mimic) => {
                    format!(
                        "it mimics joint `{}`, and stands at {stands} {unit}",
                        shown(&mimic.joint)
                    )
                }
                None => format!(
                    "{}, not between base and tip: it stands at {stands} {unit}; \
                     `--lock {}=VALUE` takes another position",
                    joint.kind.name(),
                    shown(&joint.name),
                ),
            };
            text.push_str(&outside_of_limits(joint, stands));
            doubts.joint(&joint.name, text);
        }
        if !left_out.is_empty() {
            doubts.robot(format!(
                "joints that do not move the arm are left out: {}",
                listed(left_out.iter().copied())
            ));
        }
    }
}

/// A remark on a position outside of the joint's limits.
fn outside_of_limits(joint: &Joint, position: f64) -> String {
    let limit = joint.limit.filter(|_| joint.kind != Kind::Continuous).unwrap_or_default();
    let lower = limit.lower.unwrap_or(f64::NEG_INFINITY);
    let upper = limit.upper.unwrap_or(f64::INFINITY);
    if lower <= position && position <= upper {
        return String::new();
    }
    format!(" (outside of its limits, {lower} to {upper})")
}

/// Which joints the options lock.
fn locked(tree: &Tree, options: &Options, doubts: &mut Doubts) -> Result<Vec<bool>, UrdfError> {
    const MOST: f64 = 1000.0;

    let mut is_locked = vec![false; tree.joints.len()];
    for (name, position) in &options.locks {
        let index = tree.joint(name, || "a lock".to_owned())?;
        let joint = &tree.joints[index];
        let most = match joint.kind {
            Kind::Fixed | Kind::Floating | Kind::Planar => 0.0,
            Kind::Revolute | Kind::Continuous | Kind::Prismatic => MOST,
        };
        if position.is_nan() || position.abs() > most {
            return Err(UrdfError::Value {
                part: Part::Joint(name.clone()),
                field: "the lock's position".to_owned(),
                value: position.to_string(),
                allowed: if most == 0.0 {
                    format!("0, as the joint is {}", joint.kind.name())
                } else {
                    format!("a number within ±{MOST} {}", joint.kind.unit())
                },
            });
        }
        is_locked[index] = true;
        let remark = outside_of_limits(joint, *position);
        if !remark.is_empty() {
            doubts.joint(name, format!("locked at {position} {}{remark}", joint.kind.unit()));
        }
    }
    Ok(is_locked)
}

fn base(tree: &Tree, options: &Options, doubts: &mut Doubts) -> Result<usize, UrdfError> {
    let roots = tree.roots();
    let names = |links: &[usize]| -> Vec<String> {
        links.iter().map(|link| tree.links[*link].name.clone()).collect()
    };
    let Some(name) = &options.base else {
        return match roots[..] {
            [root] => Ok(root),
            _ => Err(UrdfError::Roots { links: names(&roots) }),
        };
    };
    let base = tree.link(name, || "the base".to_owned())?;
    if roots.len() > 1 {
        let roots = names(&roots);
        doubts.robot(format!(
            "the links {} are the child of no joint; only those behind the base are used",
            listed(roots.iter().map(String::as_str))
        ));
    }
    Ok(base)
}

/// The end of the chain with the most moving joints.
///
/// If several links are at the end of the same moving joints, such as the fingers of a hand, the
/// tip is the last link that all of them follow.
fn far_tip(
    tree: &Tree,
    base: usize,
    may_move: &impl Fn(usize) -> bool,
    doubts: &mut Doubts,
) -> Result<usize, UrdfError> {
    let links = tree.behind(base);
    // The moving joints up to each link, and the last of them.
    let mut reach = vec![(0, None); tree.links.len()];
    for link in &links[1..] {
        let (Some(joint), Some(parent)) = (tree.joint_of[*link], tree.parent_of(*link)) else {
            continue;
        };
        let (count, last) = reach[parent];
        reach[*link] = if may_move(joint) { (count + 1, Some(joint)) } else { (count, last) };
    }
    let most = links.iter().map(|link| reach[*link].0).max().unwrap_or(0);
    let ends: Vec<usize> = links
        .iter()
        .copied()
        .filter(|link| tree.joints_on[*link].is_empty() && reach[*link].0 == most)
        .collect();
    if let [only] = ends[..] {
        return Ok(only);
    }
    let names = |links: &[usize]| -> Vec<String> {
        links.iter().map(|link| tree.links[*link].name.clone()).collect()
    };
    let last = reach[ends[0]].1;
    if ends.iter().any(|link| reach[*link].1 != last) {
        return Err(UrdfError::Chains { joints: most, tips: names(&ends) });
    }
    let tip = common(tree, base, &ends);
    let ends = names(&ends);
    doubts.link(
        &tree.links[tip].name,
        format!(
            "it is the tip, as the links {} follow it; `--tip LINK` chooses another",
            listed(ends.iter().map(String::as_str))
        ),
    );
    Ok(tip)
}

/// The last link that all of these links follow, or are.
fn common(tree: &Tree, base: usize, links: &[usize]) -> usize {
    // Every link before one of them is counted once for each.
    let mut followers = vec![0; tree.links.len()];
    for link in links {
        let mut at = Some(*link);
        while let Some(link) = at {
            followers[link] += 1;
            at = if link == base { None } else { tree.parent_of(link) };
        }
    }
    let mut at = links[0];
    while followers[at] < links.len() && at != base {
        at = tree.parent_of(at).unwrap_or(base);
    }
    at
}

/// Where each joint stands: as locked, as it mimics, or at 0.
fn positions(tree: &Tree, options: &Options) -> Result<Vec<f64>, UrdfError> {
    /// A longer chain of joints that mimic each other is a mistake.
    const MOST: usize = 20;

    tree.joints
        .iter()
        .map(|joint| {
            let mut at = joint;
            let (mut multiplier, mut offset) = (1.0, 0.0);
            for _ in 0..MOST {
                if let Some(position) = options.locks.get(&at.name) {
                    return finite(joint, multiplier * position + offset);
                }
                let Some(mimic) = &at.mimic else { return finite(joint, offset) };
                offset += multiplier * mimic.offset;
                multiplier *= mimic.multiplier;
                let user = || format!("the <mimic> of {}", Part::Joint(at.name.clone()));
                at = &tree.joints[tree.joint(&mimic.joint, user)?];
            }
            Err(UrdfError::Value {
                part: Part::Joint(joint.name.clone()),
                field: "mimic joint".to_owned(),
                value: format!("`{}`", joint.mimic.as_ref().map_or("", |mimic| &mimic.joint)),
                allowed: format!("a joint that moves by itself, at most {MOST} joints away"),
            })
        })
        .collect()
}

fn finite(joint: &Joint, position: f64) -> Result<f64, UrdfError> {
    const MOST: f64 = 1e4;

    if position.abs() <= MOST {
        return Ok(position);
    }
    Err(UrdfError::Value {
        part: Part::Joint(joint.name.clone()),
        field: "the position by its <mimic>".to_owned(),
        value: position.to_string(),
        allowed: format!("a number within ±{MOST} {}", joint.kind.unit()),
    })
}
