//! Inertia of rigid bodies: composition, and the conditions for a physical tensor.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// Mass, centre of mass and inertia of a rigid body in its own frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RigidBody {
    /// kg.
    pub mass: f64,
    /// m.
    pub com: [f64; 3],
    /// kg·m², about the centre of mass, axes of the body's frame. Symmetric.
    pub inertia: [[f64; 3]; 3],
}

impl RigidBody {
    /// A body from the six distinct entries (xx, xy, xz, yy, yz, zz) of its inertia.
    pub const fn new(mass: f64, com: [f64; 3], inertia: [f64; 6]) -> Self {
        let [xx, xy, xz, yy, yz, zz] = inertia;
        Self { mass, com, inertia: [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] }
    }

    /// The same body seen from a frame in which its own frame has this pose.
    #[must_use]
    pub fn seen_from(&self, rotation: &Rotation3<f64>, translation: &Vector3<f64>) -> Self {
        let com = rotation * Vector3::from(self.com) + translation;
        let inertia = rotation.matrix() * matrix(self.inertia) * rotation.matrix().transpose();
        Self { mass: self.mass, com: com.into(), inertia: symmetric_rows(&inertia) }
    }

    /// Both bodies welded together. Both are given in the same frame.
    #[must_use]
    pub fn welded_to(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let com =
            (Vector3::from(self.com) * self.mass + Vector3::from(other.com) * other.mass) / mass;
        let about_common = |body: &Self| {
            matrix(body.inertia) + point_inertia(body.mass, Vector3::from(body.com) - com)
        };
        let inertia = about_common(self) + about_common(other);
        Self { mass, com: com.into(), inertia: symmetric_rows(&inertia) }
    }

    /// Inertia about the origin of the body's frame, entries (xx, xy, xz, yy, yz, zz).
    pub(crate) fn inertia_about_origin(&self) -> [f64; 6] {
        let inertia = matrix(self.inertia) + point_inertia(self.mass, Vector3::from(self.com));
        [inertia.m11, inertia.m12, inertia.m13, inertia.m22, inertia.m23, inertia.m33]
    }

    /// Second moments of the mass about its centre, Σ = ∫ r rᵀ dm = ½ tr(I) 1 − I.
    ///
    /// A body with these inertias exists exactly when Σ is positive semi-definite (Wensing, Kim and
    /// Slotine 2018, "Linear matrix inequalities for physically consistent inertial parameter
    /// identification"); the triangle inequality of the principal moments follows.
    pub fn second_moments(&self) -> Matrix3<f64> {
        let inertia = matrix(self.inertia);
        Matrix3::identity() * (0.5 * inertia.trace()) - inertia
    }

    /// The principal moments of inertia about the centre of mass, kg·m², in ascending order.
    pub fn principal_moments(&self) -> [f64; 3] {
        let mut moments: [f64; 3] = matrix(self.inertia).symmetric_eigenvalues().into();
        moments.sort_by(f64::total_cmp);
        moments
    }

    /// The same mass and centre with second moments Σ: I = tr(Σ) 1 − Σ.
    #[must_use]
    pub fn with_second_moments(&self, moments: &Matrix3<f64>) -> Self {
        let inertia = Matrix3::identity() * moments.trace() - moments;
        Self { inertia: symmetric_rows(&inertia), ..*self }
    }

    /// The body stretched along the axes of its frame: Σ → A Σ Aᵀ with A = diag(√factors). Its
    /// second moments about the planes across these axes are multiplied by `factors`. Mass and
    /// centre stay the same, and a physical body stays physical (Sylvester's law of inertia).
    #[must_use]
    pub fn stretched(&self, factors: [f64; 3]) -> Self {
        let stretches = Matrix3::from_diagonal(&factors.map(f64::sqrt).into());
        self.with_second_moments(&(stretches * self.second_moments() * stretches))
    }

    /// The nearest physical body: negative principal second moments are raised to (almost) zero.
    ///
    /// A body that is physical already is returned bit for bit.
    #[must_use]
    pub fn projected(&self) -> Self {
        /// Relative to the largest moment. It keeps rounding from making the result unphysical
        /// again.
        const SMALLEST: f64 = 1e-9;

        let moments = self.second_moments().symmetric_eigen();
        let floor = SMALLEST * moments.eigenvalues.max();
        if moments.eigenvalues.min() >= 0.0 {
            return *self;
        }
        let raised = Matrix3::from_diagonal(&moments.eigenvalues.map(|moment| moment.max(floor)));
        let axes = moments.eigenvectors;
        self.with_second_moments(&(axes * raised * axes.transpose()))
    }

    /// Whether a rigid body can have this mass and inertia.
    pub fn is_physical(&self) -> bool {
        self.mass > 0.0 && self.second_moments().symmetric_eigenvalues().min() >= 0.0
    }
}

/// Inertia about the origin of a point mass at `r`: m (|r|² 1 − r rᵀ).
fn point_inertia(mass: f64, r: Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * mass
}

fn matrix(rows: [[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| rows[row][column])
}

/// The rows of the symmetric part. This removes the asymmetry that rounding causes.
fn symmetric_rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| 0.5 * (matrix[(row, column)] + matrix[(column, row)]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROD: RigidBody =
        RigidBody::new(2.0, [0.1, 0.0, 0.3], [0.02, 0.001, 0.0, 0.03, 0.0, 0.025]);

    #[test]
    fn a_body_cut_in_two_and_welded_is_itself() {
        let half = |shift: f64| {
            let com = [ROD.com[0] + shift, ROD.com[1], ROD.com[2]];
            // Moving half of the mass by ±shift along x adds m·shift² to yy and zz of the whole.
            let spread = ROD.mass * shift * shift;
            let i = ROD.inertia;
            let entries = [i[0][0], i[0][1], i[0][2], i[1][1] - spread, i[1][2], i[2][2] - spread];
            RigidBody::new(0.5 * ROD.mass, com, entries.map(|entry| 0.5 * entry))
        };
        let welded = half(0.02).welded_to(&half(-0.02));
        assert!((welded.mass - ROD.mass).abs() < 1e-15);
        for row in 0..3 {
            assert!((welded.com[row] - ROD.com[row]).abs() < 1e-15);
            for column in 0..3 {
                assert!((welded.inertia[row][column] - ROD.inertia[row][column]).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn second_moments_and_inertia_determine_each_other() {
        let back = ROD.with_second_moments(&ROD.second_moments());
        for (row, expected) in back.inertia.iter().zip(ROD.inertia) {
            for (entry, expected) in row.iter().zip(expected) {
                assert!((entry - expected).abs() < 1e-16);
            }
        }
    }

    #[test]
    fn projection_repairs_an_impossible_tensor_and_leaves_a_possible_one_alone() {
        let needle = RigidBody::new(1.0, [0.0; 3], [0.01, 0.0, 0.0, 0.002, 0.0, 0.003]);
        assert!(!needle.is_physical());
        assert!(needle.projected().is_physical());
        assert_eq!(ROD.projected(), ROD);
    }
}
