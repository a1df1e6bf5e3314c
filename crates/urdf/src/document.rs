//! The parts of a URDF that a description needs, as they are written.

use nalgebra::{IsometryMatrix3, Translation3, Vector3};

use crate::frames::turned;

/// Links and joints, in the order of the text.
#[derive(Debug)]
pub(crate) struct Document {
    pub(crate) name: String,
    pub(crate) links: Vec<Link>,
    pub(crate) joints: Vec<Joint>,
}

#[derive(Debug)]
pub(crate) struct Link {
    pub(crate) name: String,
    pub(crate) inertial: Option<Inertial>,
    /// Whether the link has a `<visual>` or `<collision>`. A link without is only a frame.
    pub(crate) has_shape: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Inertial {
    pub(crate) origin: Origin,
    pub(crate) mass_kg: f64,
    /// xx, xy, xz, yy, yz, zz about the centre, in the origin's axes, kg·m².
    pub(crate) inertia_kg_m2: [f64; 6],
}

/// The pose of a frame in another.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Origin {
    /// m.
    pub(crate) xyz: [f64; 3],
    /// Turns about the fixed axes x, y and z, one after the other, rad.
    pub(crate) rpy: [f64; 3],
}

impl Origin {
    pub(crate) fn pose(&self) -> IsometryMatrix3<f64> {
        let translation = Translation3::from(Vector3::from(self.xyz));
        IsometryMatrix3::from_parts(translation, turned(self.rpy.map(f64::sin_cos)))
    }
}

#[derive(Debug)]
pub(crate) struct Joint {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    /// In the parent's frame.
    pub(crate) origin: Origin,
    /// Name of the link before.
    pub(crate) parent: String,
    /// Name of the link that the joint moves.
    pub(crate) child: String,
    /// In the joint's frame, of any length.
    pub(crate) axis: [f64; 3],
    pub(crate) limit: Option<Limit>,
    pub(crate) friction: Option<JointDynamics>,
    pub(crate) mimic: Option<Mimic>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Revolute,
    Continuous,
    Prismatic,
    Fixed,
    Floating,
    Planar,
}

impl Kind {
    pub(crate) const ALL: [Self; 6] = [
        Self::Revolute,
        Self::Continuous,
        Self::Prismatic,
        Self::Fixed,
        Self::Floating,
        Self::Planar,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Revolute => "revolute",
            Self::Continuous => "continuous",
            Self::Prismatic => "prismatic",
            Self::Fixed => "fixed",
            Self::Floating => "floating",
            Self::Planar => "planar",
        }
    }

    /// Whether the joint turns about its axis.
    pub(crate) const fn turns(self) -> bool {
        matches!(self, Self::Revolute | Self::Continuous)
    }

    /// Unit of the joint's position.
    pub(crate) const fn unit(self) -> &'static str {
        if matches!(self, Self::Prismatic) { "m" } else { "rad" }
    }
}

/// Limits as written. Infinite ones are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Limit {
    pub(crate) lower: Option<f64>,
    pub(crate) upper: Option<f64>,
    pub(crate) effort: Option<f64>,
    pub(crate) velocity: Option<f64>,
}

/// The element `<dynamics>` of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct JointDynamics {
    /// N·m·s/rad.
    pub(crate) damping: f64,
    /// Coulomb friction, N·m.
    pub(crate) friction: f64,
    /// Inertia of the rotor at the joint, kg·m². Other programs do not know this attribute.
    pub(crate) armature: f64,
    /// φ2, s/rad, of friction that bends as f tanh(φ2 q̇ / 2). Other programs do not know this
    /// attribute.
    pub(crate) phi2: Option<f64>,
}

/// The joint's position is `multiplier` times that of `joint`, plus `offset`.
#[derive(Debug)]
pub(crate) struct Mimic {
    pub(crate) joint: String,
    pub(crate) multiplier: f64,
    pub(crate) offset: f64,
}
