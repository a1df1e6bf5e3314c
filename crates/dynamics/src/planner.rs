//! The controller's planner: it evaluates a reference at every sample, and interpolates in between
//! with the polynomial of degree 5 that has the same positions, velocities and accelerations at
//! both samples. So a reference costs little, whatever the rate of the controller.

use simd::{Kernel, Lanes};
use spec::MAX_JOINTS;

use crate::reference::{Reference, ReferenceState};

/// [`Reference::at`] with the instructions of some lanes.
pub(crate) struct ReferenceAt<'a> {
    pub(crate) reference: &'a Reference,
    /// s.
    pub(crate) t: f64,
    pub(crate) state: &'a mut ReferenceState,
}

impl<L: Lanes> Kernel<L> for ReferenceAt<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        *self.state = self.reference.at(self.t);
    }
}

/// Gives a lane its polynomials between two samples.
pub(crate) struct Interpolate<'a, L, const N: usize> {
    pub(crate) lane: usize,
    /// s.
    pub(crate) period_s: f64,
    pub(crate) from: &'a ReferenceState,
    pub(crate) to: &'a ReferenceState,
    /// In powers of the share of the period that has passed, one after another for each joint.
    pub(crate) coefficients: &'a mut [[L; 6]; N],
}

impl<L: Lanes, const N: usize> Kernel<L> for Interpolate<'_, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let powers = polynomials(self.period_s, self.from, self.to);
        for joint in 0..self.from.r.len().min(N) {
            for power in 0..6 {
                self.coefficients[joint][power].set_lane(self.lane, powers[power][joint]);
            }
        }
    }
}

/// The polynomials of degree 5 of all joints between two states, in powers of the share of the
/// period that has passed.
#[inline(always)]
pub(crate) fn polynomials(
    period_s: f64,
    from: &ReferenceState,
    to: &ReferenceState,
) -> [[f64; MAX_JOINTS]; 6] {
    let h = period_s;
    let (from_r, from_rd, from_rdd) = (from.r.padded(), from.rd.padded(), from.rdd.padded());
    let (to_r, to_rd, to_rdd) = (to.r.padded(), to.rd.padded(), to.rdd.padded());
    let mut powers = [*from_r; 6];
    for joint in 0..MAX_JOINTS {
        let (v0, v1) = (h * from_rd[joint], h * to_rd[joint]);
        let (a0, a1) = (0.5 * h * h * from_rdd[joint], 0.5 * h * h * to_rdd[joint]);
        let change = to_r[joint] - from_r[joint];
        powers[1][joint] = v0;
        powers[2][joint] = a0;
        powers[3][joint] = 10.0 * change - 6.0 * v0 - 4.0 * v1 - 3.0 * a0 + a1;
        powers[4][joint] = -15.0 * change + 8.0 * v0 + 7.0 * v1 + 3.0 * a0 - 2.0 * a1;
        powers[5][joint] = 6.0 * change - 3.0 * v0 - 3.0 * v1 - a0 + a1;
    }
    powers
}
