//! The limits of an arm's joints, and the references that are drawn within them.

use spec::Range;

use crate::Joints;
use crate::draws::Draws;
use crate::reference::{
    FourierSeries, Harmonic, PointToPointMoves, Reference, ViaPoints, largest_speed, whole,
};

/// The limits that the references of an arm keep.
pub(crate) struct Room {
    /// Those of each joint.
    pub(crate) limits: Joints<Limits>,
}

/// The limits of a joint.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Limits {
    /// rad.
    pub(crate) least: f64,
    /// rad.
    pub(crate) center: f64,
    /// rad.
    pub(crate) most: f64,
    /// rad/s.
    pub(crate) speed: f64,
}

impl Limits {
    /// The share `reach` of the range on both sides of the center.
    pub(crate) fn within(&self, reach: f64) -> Range {
        Range::new(
            self.center - reach * (self.center - self.least),
            self.center + reach * (self.most - self.center),
        )
    }
}

impl Room {
    pub(crate) fn draw_fourier(
        &self,
        spec: &spec::FourierSeries,
        frequency_hz: f64,
        draws: &mut Draws,
    ) -> Reference {
        /// Instants per period of the highest harmonic at which extremes are sought. They may be
        /// missed by half a percent.
        const INSTANTS: u32 = 32;
        const UNIT: Range = Range::new(-1.0, 1.0);

        let joints = self.limits.len();
        let share = draws.uniform(spec.speed);
        let mut harmonics = Vec::new();
        for number in 1..=spec.harmonics {
            let mut draw = || draws.uniform(UNIT) / f64::from(number);
            harmonics.push(Harmonic {
                sine_rad: Joints::from_fn(joints, |_| draw()),
                cosine_rad: Joints::from_fn(joints, |_| draw()),
            });
        }
        let zero = Joints::splat(joints, 0.0);
        let mut series = FourierSeries { frequency_hz, offset_rad: zero, harmonics };
        let (mut least, mut most, mut fastest) = (zero, zero, zero);
        let instants = INSTANTS * spec.harmonics;
        for instant in 0..instants {
            let state = series.at(f64::from(instant) / f64::from(instants) / frequency_hz);
            for joint in 0..joints {
                least[joint] = least[joint].min(state.r[joint]);
                most[joint] = most[joint].max(state.r[joint]);
                fastest[joint] = fastest[joint].max(state.rd[joint].abs());
            }
        }
        for (joint, limits) in self.limits.iter().enumerate() {
            let room = limits.within(spec.reach);
            let narrow = (room.max - room.min) / (most[joint] - least[joint]);
            let slow = share * limits.speed / fastest[joint];
            let scale = draws.uniform(Range::new(0.5, 1.0)) * narrow.min(slow);
            for harmonic in &mut series.harmonics {
                harmonic.sine_rad[joint] *= scale;
                harmonic.cosine_rad[joint] *= scale;
            }
            let free = Range::new(room.min - scale * least[joint], room.max - scale * most[joint]);
            series.offset_rad[joint] = draws.uniform(free);
        }
        Reference::Fourier(series)
    }

    pub(crate) fn draw_moves(
        &self,
        spec: &spec::PointToPointMoves,
        frequency_hz: f64,
        duration_s: f64,
        draws: &mut Draws,
    ) -> Reference {
        let period_s = 1.0 / frequency_hz;
        let share = draws.uniform(spec.speed);
        let longest_s = share * spec.moving * period_s / largest_speed(spec.profile);
        let count = whole(duration_s / period_s) + 2;
        Reference::PointToPoint(PointToPointMoves {
            period_s,
            moving: spec.moving,
            profile: spec.profile,
            postures_rad: self.draw_postures(count, spec.reach, longest_s, draws),
        })
    }

    pub(crate) fn draw_spline(
        &self,
        spec: &spec::ViaPoints,
        frequency_hz: f64,
        duration_s: f64,
        draws: &mut Draws,
    ) -> Reference {
        let period_s = 1.0 / frequency_hz;
        // A B-spline is never faster than its control points.
        let longest_s = draws.uniform(spec.speed) * period_s;
        let count = whole(duration_s / period_s) + 5;
        Reference::ViaPoints(ViaPoints {
            period_s,
            postures_rad: self.draw_postures(count, spec.reach, longest_s, draws),
        })
    }

    /// Postures whose joints are at most as far from those before as they move in `longest_s` at
    /// their largest speed.
    fn draw_postures(
        &self,
        count: usize,
        reach: f64,
        longest_s: f64,
        draws: &mut Draws,
    ) -> Vec<Joints<f64>> {
        let mut postures: Vec<Joints<f64>> = Vec::with_capacity(count);
        for _ in 0..count {
            let before = postures.last().copied();
            let posture = self.limits.iter().enumerate().map(|(joint, limits)| {
                let drawn = draws.uniform(limits.within(reach));
                let Some(before) = before else { return drawn };
                let furthest = longest_s * limits.speed;
                before[joint] + (drawn - before[joint]).clamp(-furthest, furthest)
            });
            postures.push(posture.collect());
        }
        postures
    }
}
