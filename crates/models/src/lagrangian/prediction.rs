//! Predictions of a trained law: it fits robots to their contexts, draws others, and rolls them out.
//! A robot's answer does not depend on the other robots of the call.

use kernels::Interrupt;
use rayon::prelude::*;
use series::{MeasurementNoise, Smoother};
use simd::InstructionSet;

use super::draws::{ResidualTorques, RobotDraw};
use super::filtering::{is_filtered, smoother};
use super::fitting::RobotPosterior;
use super::law::Law;
use super::recorded::Recorded;
use super::regression::Bounds;
use super::rollout::{Rollouts, Start};

/// The smoother of contexts like this one, if their positions are noisy enough to need it.
pub(super) fn smoother_of(robot: &Recorded<'_>, noise: MeasurementNoise) -> Option<Smoother> {
    is_filtered(robot, noise).then(|| smoother(robot, noise))
}

impl Law {
    /// Positions of the horizons, `[robot, sample, joint]`, rad. They are the same for all
    /// instruction sets. `draws` is empty, or has [`Law::normals_per_draw`] standard normal numbers
    /// for each robot. Without draws a robot is the most likely one. With draws it is another one
    /// that the context allows. A robot with negative masses that reaches a pose of too little
    /// inertia is fitted again without them. Answers begin with the last `behind` positions of the
    /// context, at most two, as the most likely robot or the draw had them.
    pub fn predict(
        &self,
        instructions: InstructionSet,
        robots: &[Recorded<'_>],
        noise: MeasurementNoise,
        draws: &[&[f32]],
        behind: usize,
    ) -> Vec<f32> {
        let Some(first) = robots.first() else { return Vec::new() };
        let smoother = smoother_of(first, noise);
        let filter = smoother.as_ref().map(|smoother| (smoother, noise));
        let mut found =
            self.predict_within(instructions, robots, filter, draws, behind, Bounds::Dissipation);
        let redone = found.with_too_little_inertia();
        if !redone.is_empty() {
            let robots: Vec<Recorded<'_>> = redone.iter().map(|&robot| robots[robot]).collect();
            let drawn = redone.iter().filter_map(|&robot| draws.get(robot).copied());
            let draws: Vec<&[f32]> = drawn.collect();
            let again = self.predict_within(
                instructions,
                &robots,
                filter,
                &draws,
                behind,
                Bounds::DissipationAndMasses,
            );
            for (place, &robot) in redone.iter().enumerate() {
                found.replace(robot, &again, place);
            }
        }
        found.positions
    }

    /// The distribution of a robot given its context, whose noise a filter removes.
    pub(super) fn posterior(
        &self,
        instructions: InstructionSet,
        robot: &Recorded<'_>,
        filter: Option<(&Smoother, MeasurementNoise)>,
        bounds: Bounds,
    ) -> RobotPosterior {
        match filter {
            None => self.identify(instructions, robot, bounds),
            Some((smoother, noise)) => {
                self.identify_filtered(instructions, robot, smoother, noise, bounds)
            }
        }
    }

    /// The horizons of robots that are fitted within these bounds, whatever poses they reach.
    fn predict_within(
        &self,
        instructions: InstructionSet,
        robots: &[Recorded<'_>],
        filter: Option<(&Smoother, MeasurementNoise)>,
        draws: &[&[f32]],
        behind: usize,
        bounds: Bounds,
    ) -> Rollouts {
        let interrupt = Interrupt::current();
        let asked: Vec<&[Recorded<'_>]> = robots.chunk_by(Recorded::has_the_past_of).collect();
        let posteriors: Vec<RobotPosterior> = asked
            .par_iter()
            .inspect(|_| interrupt.leave_if_raised())
            .map(|same| self.posterior(instructions, &same[0], filter, bounds))
            .collect();
        let spread = |place: usize, same: &[Recorded<'_>]| std::iter::repeat_n(place, same.len());
        let places: Vec<usize> =
            asked.iter().enumerate().flat_map(|(place, same)| spread(place, same)).collect();
        if draws.is_empty() {
            let torques: Vec<Vec<f32>> = robots
                .iter()
                .zip(&places)
                .map(|(robot, &place)| posteriors[place].disturbance.less(robot))
                .collect();
            let starts =
                robots.iter().zip(&places).zip(&torques).map(|((robot, &place), u)| {
                    Start::new(robot, u, &posteriors[place].most_likely)
                });
            let starts: Vec<Start<'_>> = starts.collect();
            return self.roll_out(instructions, &starts).behind(behind, &starts);
        }
        let residuals: Vec<ResidualTorques> = asked
            .par_iter()
            .inspect(|_| interrupt.leave_if_raised())
            .zip(&posteriors)
            .map(|(same, posterior)| self.residual_torques(instructions, &same[0], posterior))
            .collect();
        let drawn: Vec<RobotDraw> = draws
            .par_iter()
            .inspect(|_| interrupt.leave_if_raised())
            .zip(&places)
            .zip(robots)
            .map(|((normals, &place), robot)| {
                self.draw(instructions, robot, &posteriors[place], &residuals[place], normals)
            })
            .collect();
        let starts = robots.iter().zip(&drawn);
        let starts = starts.map(|(robot, drawn)| Start::new(robot, &drawn.u, &drawn.state));
        let starts: Vec<Start<'_>> = starts.collect();
        self.roll_out(instructions, &starts).behind(behind, &starts)
    }
}
