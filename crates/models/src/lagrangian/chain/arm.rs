//! An arm that is sought: its chain, and how its joints rub.

use random::ChaCha8Rng;

use super::Chain;

/// Slopes at rest of the frictions that a joint has while their shape is not fitted, s/rad.
const ROUGH_SLOPES: [f64; 2] = [4.0, 20.0];
/// The slope where a fit of the shape begins, and the least and the largest, s/rad.
const FIRST_SLOPE: f64 = 5.0;
const SLOPES: [f64; 2] = [0.2, 200.0];
/// Ways to change the shape of a friction: the logarithm of its slope, and its shift.
pub(super) const SHAPE_MOVES: usize = 2;

/// An arm by its axes and the shapes of its frictions. Its torques are linear in all other numbers.
#[derive(Clone, Debug)]
pub(in crate::lagrangian) struct Arm {
    pub chain: Chain,
    frictions: Frictions,
}

/// The shapes of the frictions of each joint.
#[derive(Clone, Debug)]
enum Frictions {
    /// Sums of frictions with [`ROUGH_SLOPES`].
    Rough,
    /// One shape for each joint, which moves.
    Fitted(Vec<FrictionShape>),
}

/// Friction at velocity v as tanh(slope (v + shift)), less its value at rest.
#[derive(Clone, Copy, Debug)]
pub(in crate::lagrangian) struct FrictionShape {
    /// s/rad.
    pub slope: f64,
    /// rad/s.
    pub shift: f64,
}

impl Arm {
    pub fn new(chain: Chain) -> Self {
        Self { chain, frictions: Frictions::Rough }
    }

    /// The arm with shapes of friction that are fitted, too.
    pub fn with_fitted_frictions(self) -> Self {
        let first = FrictionShape { slope: FIRST_SLOPE, shift: 0.0 };
        let frictions = match self.frictions {
            Frictions::Rough => vec![first; self.chain.joints()],
            Frictions::Fitted(shapes) => shapes,
        };
        Self { frictions: Frictions::Fitted(frictions), ..self }
    }

    /// See [`Chain::with_opposite_axis`].
    pub fn with_opposite_axis(&self, joint: usize) -> Self {
        Self { chain: self.chain.with_opposite_axis(joint), ..self.clone() }
    }

    /// See [`Chain::with_random_axis`].
    pub fn with_random_axis(&self, joint: usize, generator: &mut ChaCha8Rng) -> Self {
        Self { chain: self.chain.with_random_axis(joint, generator), ..self.clone() }
    }

    /// The same arm, written with [`Chain::gathered`].
    pub fn gathered(self) -> Self {
        Self { chain: self.chain.gathered(), ..self }
    }

    /// The shape of each joint's friction, once fitted.
    pub fn friction_shapes(&self) -> Option<&[FrictionShape]> {
        match &self.frictions {
            Frictions::Rough => None,
            Frictions::Fitted(shapes) => Some(shapes),
        }
    }

    /// A friction of a joint of 1 N·m at a velocity in rad/s.
    pub(super) fn friction(&self, joint: usize, kind: usize, velocity: f64) -> f64 {
        match &self.frictions {
            Frictions::Rough => (ROUGH_SLOPES[kind] * velocity).tanh(),
            Frictions::Fitted(shapes) => shapes[joint].at(velocity),
        }
    }

    pub(super) fn frictions_per_joint(&self) -> usize {
        match self.frictions {
            Frictions::Rough => ROUGH_SLOPES.len(),
            Frictions::Fitted(_) => 1,
        }
    }

    pub(super) fn moved(&self, moves: &[f64]) -> Self {
        let (of_chain, of_shapes) = moves.split_at(self.chain.moves());
        let frictions = match &self.frictions {
            Frictions::Rough => Frictions::Rough,
            Frictions::Fitted(shapes) => {
                let each = shapes.iter().zip(of_shapes.as_chunks::<SHAPE_MOVES>().0);
                Frictions::Fitted(each.map(|(shape, moves)| shape.moved(*moves)).collect())
            }
        };
        Self { chain: self.chain.moved(of_chain), frictions }
    }
}

impl FrictionShape {
    pub(super) fn at(self, velocity: f64) -> f64 {
        (self.slope * (velocity + self.shift)).tanh() - (self.slope * self.shift).tanh()
    }

    pub(super) fn moved(self, [slope, shift]: [f64; SHAPE_MOVES]) -> Self {
        let [least, most] = SLOPES;
        let slope = (self.slope * slope.exp()).clamp(least, most);
        Self { slope, shift: self.shift + shift }
    }
}
