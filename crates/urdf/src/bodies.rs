//! The bodies that the moving joints turn, each welded from the links that move together.

use dynamics::RigidBody;
use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Translation3, Unit, Vector3};
use spec::BodyDescription;

use crate::chain::Chain;
use crate::document::{Inertial, Joint, Kind, Link};
use crate::part::Doubts;
use crate::tree::Tree;
use crate::{Options, Part, UrdfError};

/// Where a link is.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// The moving joint that the link follows, counted from 0. `None` for a link that stands.
    pub(crate) joint: Option<usize>,
    /// The link's pose in the frame of that joint's child, or of the base.
    pub(crate) pose: IsometryMatrix3<f64>,
}

/// The place of every link behind the base, in the order of [`Tree::behind`].
pub(crate) fn places(tree: &Tree, chain: &Chain) -> Result<Vec<(usize, Place)>, UrdfError> {
    let mut places = vec![None; tree.links.len()];
    let base = Place { joint: None, pose: IsometryMatrix3::identity() };
    places[chain.base] = Some(base);
    let links = tree.behind(chain.base);
    let mut placed = vec![(chain.base, base)];
    for link in links.into_iter().skip(1) {
        let before = tree.parent_of(link).and_then(|parent| places[parent]);
        let (Some(before), Some(joint)) = (before, tree.joint_of[link]) else { continue };
        let place = match chain.moving.iter().position(|moving| *moving == joint) {
            Some(moving) => Place { joint: Some(moving), pose: IsometryMatrix3::identity() },
            None => Place { pose: before.pose * standing(tree, chain, joint)?, ..before },
        };
        places[link] = Some(place);
        placed.push((link, place));
    }
    Ok(placed)
}

/// The pose of a standing joint's child in its parent's frame.
fn standing(tree: &Tree, chain: &Chain, joint: usize) -> Result<IsometryMatrix3<f64>, UrdfError> {
    let position = chain.positions[joint];
    let joint = &tree.joints[joint];
    let moved = match joint.kind {
        _ if position == 0.0 => IsometryMatrix3::identity(),
        Kind::Fixed | Kind::Floating | Kind::Planar => IsometryMatrix3::identity(),
        Kind::Revolute | Kind::Continuous => {
            let turn = Rotation3::from_axis_angle(&axis(joint)?, position);
            IsometryMatrix3::from_parts(Translation3::identity(), turn)
        }
        Kind::Prismatic => {
            let shift = axis(joint)?.into_inner() * position;
            IsometryMatrix3::from_parts(shift.into(), Rotation3::identity())
        }
    };
    Ok(joint.origin.pose() * moved)
}

/// The direction of a joint's axis.
pub(crate) fn axis(joint: &Joint) -> Result<Unit<Vector3<f64>>, UrdfError> {
    const SHORTEST: f64 = 1e-6;

    let axis = Vector3::from(joint.axis);
    Unit::try_new(axis, SHORTEST).ok_or_else(|| UrdfError::Value {
        part: Part::Joint(joint.name.clone()),
        field: "axis xyz".to_owned(),
        value: format!("{:?}", joint.axis),
        allowed: format!("a direction, longer than {SHORTEST}"),
    })
}

/// The bodies of the moving joints.
pub(crate) struct Welder<'a> {
    pub(crate) tree: &'a Tree,
    pub(crate) options: &'a Options,
    /// The links behind the base.
    pub(crate) placed: &'a [(usize, Place)],
}

impl Welder<'_> {
    /// The body that moving joint `index` turns, in a frame with the pose `frame` in the joint's
    /// child, and the names of its links.
    pub(crate) fn body(
        &self,
        index: usize,
        joint: &Joint,
        frame: &IsometryMatrix3<f64>,
        doubts: &mut Doubts,
    ) -> Result<(BodyDescription, Vec<String>), UrdfError> {
        let to_frame = frame.inverse();
        let mut whole: Option<RigidBody> = None;
        let mut links = Vec::new();
        for (link, place) in self.placed.iter().filter(|(_, place)| place.joint == Some(index)) {
            let link = &self.tree.links[*link];
            links.push(link.name.clone());
            let Some((body, inertial)) = self.body_of(link, doubts)? else { continue };
            let pose = to_frame * place.pose * inertial.origin.pose();
            let body = body.seen_from(&pose.rotation, &pose.translation.vector);
            whole = Some(whole.map_or(body, |whole| whole.welded_to(&body)));
        }
        let body = match whole {
            Some(body) => body,
            None if self.options.nearest_physical => {
                doubts.joint(&joint.name, "it moves no mass: a ball of 1 g and 1 cm is assumed");
                // Two fifths of mass and squared radius.
                RigidBody::new(1e-3, [0.0; 3], [4e-8, 0.0, 0.0, 4e-8, 0.0, 4e-8])
            }
            None => return Err(UrdfError::NoMass { joint: joint.name.clone(), links }),
        };
        let description = described(&body);
        if description.has_second_moments() {
            return Ok((description, links));
        }
        if !self.options.nearest_physical {
            let inertia_kg_m2 = description.inertia_kg_m2;
            return Err(UrdfError::Flat { joint: joint.name.clone(), links, inertia_kg_m2 });
        }
        doubts.joint(&joint.name, "what it moves has no thickness: 1 mm is assumed");
        Ok((described(&thickened(&body)), links))
    }

    /// The body of a link about its inertial origin, and what is written about it.
    fn body_of(
        &self,
        link: &Link,
        doubts: &mut Doubts,
    ) -> Result<Option<(RigidBody, Inertial)>, UrdfError> {
        let Some(inertial) = link.inertial else {
            if link.has_shape {
                doubts.link(&link.name, "it has a shape, but no <inertial>: no mass is assumed");
            }
            return Ok(None);
        };
        let Inertial { mass_kg, inertia_kg_m2, .. } = inertial;
        if mass_kg == 0.0 && inertia_kg_m2 == [0.0; 6] {
            return Ok(None);
        }
        let body = RigidBody::new(mass_kg, [0.0; 3], inertia_kg_m2);
        if let Some(reason) = placeholder(&body) {
            doubts.link(&link.name, reason);
        }
        if mass_kg > 0.0 && is_possible(&body) {
            return Ok(Some((body, inertial)));
        }
        if !self.options.nearest_physical {
            let link = link.name.clone();
            return Err(UrdfError::Impossible { link, mass_kg, inertia_kg_m2 });
        }
        if mass_kg <= 0.0 {
            let text = format!("a mass of {mass_kg} kg: neither mass nor inertia is assumed");
            doubts.link(&link.name, text);
            return Ok(None);
        }
        let repaired = body.projected();
        let text = format!(
            "no body has the inertia {inertia_kg_m2:?} kg·m²: {:?} is the nearest that one has",
            described(&repaired).inertia_kg_m2
        );
        doubts.link(&link.name, text);
        Ok(Some((repaired, inertial)))
    }
}

/// Whether a body can have this inertia. A rod or a sheet without thickness is a body.
fn is_possible(body: &RigidBody) -> bool {
    /// Relative to the largest second moment. Rounding makes a sheet's least one negative.
    const ROUNDING: f64 = 1e-12;

    let moments = body.second_moments().symmetric_eigenvalues();
    moments.min() >= -ROUNDING * moments.amax()
}

/// Says why mass and inertia look like those that exporters write for bodies they know nothing of.
fn placeholder(body: &RigidBody) -> Option<String> {
    /// Radius of gyration that no link of an arm has, m.
    const LONG_M: f64 = 1.0;

    let [[xx, xy, xz], [_, yy, yz], [.., zz]] = body.inertia;
    if body.mass <= 0.0 || xx <= 0.0 {
        return None;
    }
    let radius = (xx.max(yy).max(zz) / body.mass).sqrt();
    if radius > LONG_M {
        return Some(format!(
            "mass {} kg and inertia {xx}, {yy}, {zz} kg·m² belong to a body of {radius:.1} m: perhaps a placeholder",
            body.mass
        ));
    }
    let tenths = xx.log10();
    let is_round = xx == yy && yy == zz && [xy, xz, yz] == [0.0; 3];
    if is_round && (tenths - tenths.round()).abs() < 1e-9 {
        return Some(format!(
            "mass {} kg and inertia {xx} kg·m² about every axis: perhaps a placeholder",
            body.mass
        ));
    }
    None
}

/// The body with at least the second moments of a ball with a radius of gyration of 1 mm.
fn thickened(body: &RigidBody) -> RigidBody {
    const RADIUS_M: f64 = 1e-3;
    /// Relative to the largest second moment. Then rounding leaves the others positive.
    const SMALLEST: f64 = 1e-6;

    let moments = body.second_moments().symmetric_eigen();
    let least = (body.mass * RADIUS_M * RADIUS_M).max(SMALLEST * moments.eigenvalues.max());
    let raised = Matrix3::from_diagonal(&moments.eigenvalues.map(|moment| moment.max(least)));
    let axes = moments.eigenvectors;
    body.with_second_moments(&(axes * raised * axes.transpose()))
}

fn described(body: &RigidBody) -> BodyDescription {
    let [[xx, xy, xz], [_, yy, yz], [.., zz]] = body.inertia;
    BodyDescription {
        mass_kg: body.mass,
        // Without the signs of zeros.
        center_m: body.com.map(|entry| entry + 0.0),
        inertia_kg_m2: [xx, xy, xz, yy, yz, zz].map(|entry| entry + 0.0),
        nearest_physical: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thickened_point_is_a_body() {
        let point = RigidBody::new(2.0, [0.1, 0.2, 0.3], [0.0; 6]);
        assert!(!described(&point).has_second_moments());
        assert!(described(&thickened(&point)).has_second_moments());
    }

    #[test]
    fn identities_and_powers_of_ten_look_like_placeholders() {
        let round = |mass, inertia| {
            RigidBody::new(mass, [0.0; 3], [inertia, 0.0, 0.0, inertia, 0.0, inertia])
        };
        assert!(placeholder(&round(1.0, 1.0)).is_some());
        assert!(placeholder(&round(0.1, 0.2)).is_some_and(|text| text.contains("1.4 m")));
        assert!(placeholder(&round(0.001, 1e-3)).is_some());
        assert!(placeholder(&round(1.0, 0.001)).is_some());
        assert_eq!(placeholder(&round(1.0, 0.00123)), None);
        assert_eq!(
            placeholder(&RigidBody::new(3.0, [0.0; 3], [0.01, 0.0, 0.0, 0.02, 0.0, 0.015])),
            None
        );
    }

    #[test]
    fn inertias_of_any_size_are_decided_and_repaired() {
        const ENTRIES: [f64; 4] = [0.0, 5e-324, -1e-3, 1e9];

        for code in 0..4_usize.pow(6) {
            let inertia = [0, 1, 2, 3, 4, 5].map(|place| ENTRIES[code / 4_usize.pow(place) % 4]);
            let body = RigidBody::new(1.0, [0.0; 3], inertia);
            if !is_possible(&body) {
                let repaired = thickened(&body.projected());
                assert!(described(&repaired).has_second_moments(), "{inertia:?}");
            }
        }
    }
}
