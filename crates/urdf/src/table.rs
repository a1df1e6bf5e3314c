//! The modified Denavit-Hartenberg table of a chain of axes.
//!
//! The axes are z of the base, the joints' own, and z of the tip. Each frame of the table has its z
//! along one of them, in the direction that the URDF gives it, so positions keep their signs. What
//! is left to choose is where on its axis a frame lies, and how it is turned about it. Two axes
//! that follow each other decide this for the frame of the first:
//!
//! - Axes that are not parallel have a common normal. The frame lies at its foot, with x along it.
//!   Of the two directions of x, the table has the one whose offset is nearest to 0.
//! - For parallel axes there are many normals. The frame lies where d is 0, with x towards the
//!   next axis, or with an offset of 0 if both axes are the same line.
//! - If the axes are nearly parallel, or their normal is far from the URDF's origins, a and d would
//!   be huge and lose digits. The frame lies where d is 0, and `shift_m` leads to the URDF's origin
//!   on the next axis.
//!
//! The base has its z through the URDF's base link. The tip is the URDF's link, so the hand's frame
//! is that link's.

use std::f64::consts::PI;

use nalgebra::{IsometryMatrix3, Rotation3, Unit, Vector3};

use crate::frames::{about_x, about_z, sin_cos_deg, to_degrees, to_length, with_z_along};

/// Sine of the angle between axes that are parallel within rounding.
const PARALLEL: f64 = 1e-12;
/// Sine of the angle between axes, below which their common normal is not used.
const NEARLY_PARALLEL: f64 = 1e-3;
/// Distance from the URDF's origins, beyond which a common normal is not used, m.
const FAR_M: f64 = 2.0;

/// An axis, seen from the link before it.
pub(crate) struct Axis {
    /// Pose of the frame with the axis, at position 0, in the frame with the axis before.
    pub(crate) pose: IsometryMatrix3<f64>,
    /// Direction of the axis in its own frame.
    pub(crate) direction: Unit<Vector3<f64>>,
}

/// A row of the table: the step from one frame to the next.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Row {
    pub(crate) a_m: f64,
    pub(crate) alpha_deg: f64,
    pub(crate) d_m: f64,
    /// The joint's offset, or the yaw of the hand.
    pub(crate) offset_deg: f64,
    pub(crate) shift_m: [f64; 3],
}

/// The table of a chain.
pub(crate) struct Table {
    /// Shift of the base along its z, m.
    pub(crate) base_shift_m: f64,
    /// Turn of the base about its z, degrees.
    pub(crate) base_yaw_deg: f64,
    /// One row for each joint, and one for the hand.
    pub(crate) rows: Vec<Row>,
    /// Pose of each joint's frame in the URDF frame with its axis.
    pub(crate) frames: Vec<IsometryMatrix3<f64>>,
}

/// A frame of the table while it is not known where on its axis it lies.
struct Open {
    /// A frame with its z along the axis, in the URDF frame with the axis.
    frame: Rotation3<f64>,
    /// Angle from the frame before to this one, rad, without the turn to be chosen.
    angle: f64,
    /// Length along the axis, m, without the shift to be chosen.
    length: f64,
}

impl Table {
    /// The table of these axes, those of the joints and at last that of the tip.
    pub(crate) fn new(axes: &[Axis]) -> Self {
        let mut rows: Vec<Row> = Vec::with_capacity(axes.len());
        let mut frames = Vec::with_capacity(axes.len());
        let mut before = Open { frame: Rotation3::identity(), angle: 0.0, length: 0.0 };
        for axis in axes {
            let frame = with_z_along(&axis.direction);
            let step = Step::new(&before, axis, &frame, frames.is_empty());
            let place = Vector3::new(0.0, 0.0, step.along);
            let turned = before.frame * about_z(step.turn.sin_cos());
            frames.push(IsometryMatrix3::from_parts((turned * place).into(), turned));
            if let Some(row) = rows.last_mut() {
                row.offset_deg = step.offset_deg;
                row.d_m = to_length(before.length + step.along);
            }
            rows.push(step.row);
            before = Open { frame, angle: step.angle, length: step.length };
        }
        // The tip's frame is the URDF's.
        if let Some(row) = rows.last_mut() {
            row.offset_deg = to_degrees(before.angle);
            row.d_m = to_length(before.length);
        }
        let base = frames.remove(0);
        let matrix = base.rotation.matrix();
        Self {
            base_shift_m: to_length(base.translation.z),
            base_yaw_deg: to_degrees(matrix.m21.atan2(matrix.m11)),
            rows,
            frames,
        }
    }
}

/// What two axes say about the frame of the first and the row of the second.
struct Step {
    /// Turn of the first frame about its axis, rad.
    turn: f64,
    /// The first frame's offset: its angle with that turn.
    offset_deg: f64,
    /// Shift of the first frame along its axis, m.
    along: f64,
    /// The second row, without offset and d.
    row: Row,
    /// Of the second frame.
    angle: f64,
    length: f64,
}

impl Step {
    fn new(before: &Open, axis: &Axis, frame: &Rotation3<f64>, is_base: bool) -> Self {
        // The second axis, seen from the first frame before it is turned.
        let rotation = before.frame.inverse() * axis.pose.rotation * frame;
        let origin = before.frame.inverse() * axis.pose.translation.vector;
        let direction = rotation * Vector3::z();
        let sine = direction.x.hypot(direction.y);
        let distance = origin.x.hypot(origin.y);
        let is_parallel = sine <= PARALLEL;

        // The direction of x: along the normal, towards the next axis, or as it comes.
        let mut turn = if !is_parallel {
            direction.x.atan2(-direction.y)
        } else if to_length(distance) != 0.0 {
            origin.y.atan2(origin.x)
        } else {
            -before.angle
        };
        let mut offset_deg = to_degrees(before.angle + turn);
        // At a right angle x points towards the next axis.
        let towards = |turn: f64| origin.x * turn.cos() + origin.y * turn.sin();
        let is_even = (offset_deg.abs() - 90.0).abs() < 1e-9;
        if if is_even { to_length(towards(turn)) < 0.0 } else { offset_deg.abs() > 90.0 } {
            turn += PI;
            offset_deg = to_degrees(before.angle + turn);
        }
        // As the description says it.
        let turn = offset_deg.to_radians() - before.angle;
        let unturned = about_z((-turn).sin_cos());
        let direction = unturned * direction;
        let origin = unturned * origin;
        let alpha_deg = if is_parallel {
            if direction.z < 0.0 { 180.0 } else { 0.0 }
        } else {
            to_degrees((-direction.y).atan2(direction.z))
        };
        let (sin, cos) = sin_cos_deg(alpha_deg);

        // Where d of the first row is 0. The base stays in its place.
        let level = if is_base { 0.0 } else { -before.length };
        let normal_length = -origin.y / sin;
        let normal_along = origin.z - normal_length * cos;
        let is_near = normal_length.abs() <= FAR_M && normal_along.abs() <= FAR_M;
        let mut row = Row { a_m: to_length(origin.x), alpha_deg, ..Row::default() };
        let (along, length) = if is_parallel {
            (level, (origin.z - level) * cos)
        } else if sine > NEARLY_PARALLEL && is_near {
            (normal_along, normal_length)
        } else {
            row.shift_m = [0.0, to_length(origin.y), to_length(origin.z - level)];
            (level, 0.0)
        };
        let rest = about_x((-sin, cos)) * unturned * rotation;
        let angle = rest.matrix().m21.atan2(rest.matrix().m11);
        Self { turn, offset_deg, along, row, angle, length }
    }
}
