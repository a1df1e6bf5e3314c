use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use spec::BaseDescription;

/// Which arm of a URDF to take, and how.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Options {
    /// The link that stands. The default is the root.
    pub base: Option<String>,
    /// The link with the hand's frame. The default is the end of the chain with the most moving
    /// joints, if there is only one.
    pub tip: Option<String>,
    /// Positions of joints that shall not move, by name, rad or m.
    pub locks: BTreeMap<String, f64>,
    /// Whether to take the nearest inertia that a body can have where the URDF's is impossible.
    pub nearest_physical: bool,
    /// Pose of the base link in the world, whose z axis points up.
    pub mount: BaseDescription,
}

/// A lock as text, `JOINT=VALUE`: the joint and its position, rad or m.
///
/// # Errors
/// The allowed texts, in words.
pub fn read_lock(text: &str) -> Result<(String, f64), &'static str> {
    const ALLOWED: &str = "JOINT=VALUE, with the position in rad, or in m for a joint that slides";

    // A joint may have any name, and a number has no `=`.
    let (joint, position) = text.rsplit_once('=').ok_or(ALLOWED)?;
    let position: f64 = position.trim().parse().map_err(|_| ALLOWED)?;
    if joint.is_empty() || !position.is_finite() {
        return Err(ALLOWED);
    }
    Ok((joint.to_owned(), position))
}

/// A mount as text, `X,Y,Z,ROLL,PITCH,YAW`.
///
/// # Errors
/// The allowed texts, in words.
pub fn read_mount(text: &str) -> Result<BaseDescription, &'static str> {
    const ALLOWED: &str = "six numbers X,Y,Z,ROLL,PITCH,YAW, in m and degrees";

    let numbers: Vec<f64> = text
        .split(',')
        .map(|number| number.trim().parse())
        .collect::<Result<_, _>>()
        .map_err(|_| ALLOWED)?;
    match numbers[..] {
        [x, y, z, roll, pitch, yaw] if numbers.iter().all(|number| number.is_finite()) => {
            Ok(BaseDescription { position_m: [x, y, z], rpy_deg: [roll, pitch, yaw] })
        }
        _ => Err(ALLOWED),
    }
}
