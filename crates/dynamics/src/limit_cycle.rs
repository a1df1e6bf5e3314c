//! Limit cycles of unstable controllers: torques that swing from limit to limit.
//!
//! A controller whose gains are too high for its delay neither diverges nor loses its reference.
//! Its torques swing between their limits, faster than the arm can follow.

use simd::MAX_LANES;
use spec::{Controller, SimulateSpec};

use crate::reference::whole;

/// The swings in a row that make a limit cycle. No torque of 1000 draws of `panda-real` and of
/// `ur10e-real` swings. Of 180 trajectories of Pandas under `computed-torque` of 15 to 25 Hz with
/// delays of up to 3 ms, those of 56 do, each 82 times in a row or more within 4 s.
const SWINGS: u32 = 20;

/// The longest time between two swings of a limit cycle, s. The median of those above is 0.015.
const LONGEST_S: f64 = 0.05;

/// The largest product of an encoder's noise and the control rate, rad/s, at which swings count. More
/// noise swings the torques of stable controllers as well.
const QUIET_RAD_S: f64 = 0.1;

/// The share of its limit from which a torque counts as being there.
const AT_LIMIT: f32 = 0.999;

/// The torques of controllers in lanes, as far as they swing.
pub(crate) struct LimitCycles<const N: usize> {
    limits_nm: [f32; N],
    /// The most sampling periods between two swings. 0 if a sampling period is too long to tell, or
    /// positions are too noisy.
    longest: usize,
    lanes: [[Swings; N]; MAX_LANES],
}

/// The swings of a joint's torque.
#[derive(Clone, Copy, Default)]
struct Swings {
    /// The limit that it reached last.
    side: Option<Side>,
    /// Swings in a row.
    count: u32,
    /// Sampling periods since the last one.
    since: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Lowest,
    Highest,
}

impl<const N: usize> LimitCycles<N> {
    pub(crate) fn new(spec: &SimulateSpec, controller: &Controller) -> Self {
        let mut limits_nm = [0.0; N];
        for (limit, joint) in limits_nm.iter_mut().zip(&spec.robot.description().joints) {
            *limit = rounded(joint.torque_nm * controller.torque_share);
        }
        let observations = &spec.observations;
        let rounding_rad = observations.position_resolution_rad / 12.0_f64.sqrt();
        let noise_rad = observations.position_noise_rad.hypot(rounding_rad);
        let is_quiet = noise_rad * controller.rate_hz <= QUIET_RAD_S;
        let longest = if is_quiet { whole(LONGEST_S * spec.rate_hz) } else { 0 };
        Self { limits_nm, longest, lanes: [[Swings::default(); N]; MAX_LANES] }
    }

    /// Forgets the torques of a lane, whose next trajectory starts.
    pub(crate) fn start(&mut self, lane: usize) {
        self.lanes[lane] = [Swings::default(); N];
    }

    /// Adds a sampling period of a lane, and returns the joint with a limit cycle, if there is one.
    /// `peaks` are the largest torques, and the largest of their negatives.
    pub(crate) fn add(
        &mut self,
        joints: usize,
        lane: usize,
        peaks: &[[[f32; MAX_LANES]; N]; 2],
    ) -> Option<usize> {
        (0..joints).find(|&joint| {
            let reached =
                |side: usize| peaks[side][joint][lane] >= AT_LIMIT * self.limits_nm[joint];
            self.lanes[lane][joint].add(reached(0), reached(1), self.longest) >= SWINGS
        })
    }
}

impl Swings {
    /// The swings in a row after a sampling period in which the torque reached its limits or not.
    fn add(&mut self, highest: bool, lowest: bool, longest: usize) -> u32 {
        self.since = self.since.saturating_add(1);
        let side = match (highest, lowest) {
            (false, false) => return self.count,
            (true, true) => self.side.map(Side::other),
            (true, false) => Some(Side::Highest),
            (false, true) => Some(Side::Lowest),
        };
        let swings = highest && lowest || (self.side.is_some() && self.side != side);
        if swings {
            self.count = if self.since <= longest { self.count + 1 } else { 1 };
            self.since = 0;
        }
        self.side = side.or(Some(Side::Highest));
        self.count
    }
}

impl Side {
    const fn other(self) -> Self {
        match self {
            Self::Lowest => Self::Highest,
            Self::Highest => Self::Lowest,
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "series hold f32")]
fn rounded(torque_nm: f64) -> f32 {
    torque_nm as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest number of swings in a row of a torque that stands at +1, −1 or in between.
    fn swings(torques: impl IntoIterator<Item = i32>) -> u32 {
        let mut swings = Swings::default();
        let counts = torques.into_iter().map(|u| swings.add(u > 0, u < 0, 5));
        counts.max().unwrap_or_default()
    }

    #[test]
    fn a_torque_that_swings_from_limit_to_limit_is_counted() {
        assert_eq!(swings([1, 1, 1, 0, 0, 1, 1]), 0);
        let square = |half: usize| {
            (0..100).map(
                move |sample: usize| {
                    if (sample / half).is_multiple_of(2) { 1 } else { -1 }
                },
            )
        };
        assert!(swings(square(1)) >= 98);
        assert!(swings(square(5)) >= 18);
        assert_eq!(swings(square(6)), 1, "too slow for a limit cycle");
        assert!(swings((0..100).map(|sample| [1, 0, -1, 0][sample % 4])) >= 48);
    }

    #[test]
    fn both_limits_in_a_sampling_period_are_a_swing() {
        let mut swings = Swings::default();
        let counts: Vec<u32> = (0..4).map(|_| swings.add(true, true, 3)).collect();
        assert_eq!(counts, [1, 2, 3, 4]);
    }

    #[test]
    fn a_pause_ends_a_row_of_swings() {
        let burst = [1, -1, 1, -1, 1, -1];
        assert_eq!(swings(burst), 5);
        assert_eq!(swings(burst.into_iter().chain([0; 10]).chain(burst)), 6);
    }
}
