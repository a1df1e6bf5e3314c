//! Model predictive path integral control by the law of [`spec::Planner`].

use dynamics::Joints;
use random::ChaCha8Rng;
use spec::{PlanWeights, Planner};

use crate::EvaluationError;
use crate::baselines::to_f32;

/// The key of a plan's random numbers. It does not depend on the controller, so that all draw the
/// same numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Key {
    pub seed: u64,
    pub robot: u64,
    /// Sample of control at which the plan begins.
    pub step: u64,
}

/// Improves `plan` (N·m, one torque per step, within `limits_nm`) so that the forecast of `foresee`
/// comes closer to `path` (rad).
///
/// # Errors
/// `foresee` fails, or gives a value that is not finite.
pub(super) fn improve(
    planner: &Planner,
    limits_nm: &Joints<f64>,
    key: Key,
    plan: &mut [Joints<f64>],
    path: &[Joints<f64>],
    foresee: impl Fn(&[Joints<f32>]) -> Result<Vec<Joints<f32>>, EvaluationError>,
) -> Result<(), EvaluationError> {
    let steps = plan.len();
    let mut scale = 1.0;
    for iteration in 0..planner.iterations {
        let candidates =
            candidates(planner, limits_nm, &mut generator(key, iteration), scale, plan);
        let positions = foresee(&candidates)?;
        let unfit = |row: &&[Joints<f32>]| row.iter().flatten().any(|q| !q.is_finite());
        let failed = positions.chunks_exact(steps).filter(unfit).count();
        if failed > 0 {
            let plans = planner.samples as usize;
            return Err(EvaluationError::NotFinite { failed, plans });
        }
        let costs: Vec<Joints<f64>> = candidates
            .chunks_exact(steps)
            .zip(positions.chunks_exact(steps))
            .map(|(torques, positions)| cost(planner, torques, positions, path))
            .collect();
        let weights = weights(planner, &costs);
        plan.fill(Joints::splat(limits_nm.len(), 0.0));
        for (torques, weights) in candidates.chunks_exact(steps).zip(&weights) {
            for (plan, torques) in plan.iter_mut().zip(torques) {
                for joint in 0..plan.len() {
                    plan[joint] += weights[joint] * f64::from(torques[joint]);
                }
            }
        }
        scale *= planner.noise_decay;
    }
    Ok(())
}

/// Torque sequences `[candidate, step]` within the limits of the joints.
fn candidates(
    planner: &Planner,
    limits_nm: &Joints<f64>,
    generator: &mut ChaCha8Rng,
    scale: f64,
    plan: &[Joints<f64>],
) -> Vec<Joints<f32>> {
    let every = planner.knot_every as usize;
    let knots = (plan.len() - 1).div_ceil(every) + 1;
    let mut candidates = Vec::with_capacity(planner.samples as usize * plan.len());
    for candidate in 0..planner.samples {
        let deviation = if candidate == 0 { 0.0 } else { scale };
        let noise: Vec<Joints<f64>> = (0..knots)
            .map(|_| {
                let noise = Joints::from(planner.noise_nm.as_slice());
                noise.map(|noise| deviation * noise * random::normal(generator))
            })
            .collect();
        candidates.extend(plan.iter().enumerate().map(|(step, torques)| {
            let (knot, share) = (step / every, (step % every) as f64 / every as f64);
            let (before, after) = (&noise[knot], &noise[(knot + 1).min(knots - 1)]);
            Joints::from_fn(torques.len(), |joint| {
                let noise = before[joint] + share * (after[joint] - before[joint]);
                let limit = limits_nm[joint];
                to_f32((torques[joint] + noise).clamp(-limit, limit))
            })
        }));
    }
    candidates
}

/// The cost of each joint.
fn cost(
    planner: &Planner,
    torques: &[Joints<f32>],
    positions: &[Joints<f32>],
    path: &[Joints<f64>],
) -> Joints<f64> {
    let joints = path[0].len();
    let mut cost = Joints::splat(joints, 0.0);
    for ((torques, positions), path) in torques.iter().zip(positions).zip(path) {
        for joint in 0..joints {
            let error = f64::from(positions[joint]) - path[joint];
            let effort = f64::from(torques[joint]);
            cost[joint] += error * error + planner.effort_rad2_nm2 * effort * effort;
        }
    }
    cost.map(|cost| cost / path.len() as f64)
}

/// The weight of each candidate and joint. The weights of a joint add up to 1.
fn weights(planner: &Planner, costs: &[Joints<f64>]) -> Vec<Joints<f64>> {
    let joints = costs[0].len();
    let mut weights = vec![Joints::splat(joints, 0.0); costs.len()];
    let mut spread_over = |joint: usize, cost: &dyn Fn(&Joints<f64>) -> f64| {
        let costs: Vec<f64> = costs.iter().map(cost).collect();
        for (weights, weight) in weights.iter_mut().zip(softmin(&costs, planner.temperature)) {
            weights[joint] = weight;
        }
    };
    for joint in 0..joints {
        match planner.weights {
            PlanWeights::Joint => spread_over(joint, &|cost| cost[joint]),
            PlanWeights::Sequence => spread_over(joint, &|cost| cost.iter().sum()),
        }
    }
    weights
}

fn softmin(costs: &[f64], temperature: f64) -> Vec<f64> {
    let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
    let excess = costs.iter().map(|cost| cost - least).sum::<f64>() / costs.len() as f64;
    // Candidates of equal cost get equal weights.
    let rate = if excess > 0.0 { 1.0 / (temperature * excess) } else { 0.0 };
    let weights: Vec<f64> = costs.iter().map(|cost| (-(cost - least) * rate).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

fn generator(key: Key, iteration: u32) -> ChaCha8Rng {
    random::keyed([key.seed, key.robot, key.step, u64::from(iteration)])
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOINTS: usize = 7;
    const KEY: Key = Key { seed: 1, robot: 2, step: 3 };

    fn limits_nm() -> Joints<f64> {
        [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0].into()
    }

    /// The positions of a massless arm, which follow the sum of torques so far.
    fn integrate(plans: &[Joints<f32>], steps: usize) -> Vec<Joints<f32>> {
        let followed = |plan: &[Joints<f32>]| {
            let mut q = Joints::splat(JOINTS, 0.0);
            let step = |torques: &Joints<f32>| {
                q.iter_mut().zip(torques).for_each(|(q, torque)| *q += torque);
                q
            };
            plan.iter().map(step).collect::<Vec<_>>()
        };
        plans.chunks_exact(steps).flat_map(followed).collect()
    }

    #[test]
    fn a_plan_finds_the_torques_that_lead_along_the_path() {
        for (weights, samples) in [(PlanWeights::Joint, 64), (PlanWeights::Sequence, 1024)] {
            let planner = Planner {
                samples,
                iterations: 20,
                horizon: 12,
                noise_decay: 0.9,
                weights,
                ..Planner::default()
            };
            // The path moves steadily at 0.7 N·m for joint 1, and at 0.1 N·m more for each later
            // joint.
            let torque = Joints::from_fn(JOINTS, |joint| 0.7 + 0.1 * joint as f64);
            let path: Vec<Joints<f64>> =
                (1..=12).map(|step| torque.map(|torque| torque * f64::from(step))).collect();
            let mut plan = vec![Joints::splat(JOINTS, 0.0); 12];
            improve(&planner, &limits_nm(), KEY, &mut plan, &path, |plans| {
                Ok(integrate(plans, 12))
            })
            .unwrap();
            for (found, torque) in plan[5].iter().zip(&torque) {
                assert!((found - torque).abs() < 0.3, "{weights:?}: {plan:?}");
            }
        }
    }

    #[test]
    fn torques_never_leave_what_the_joints_can_have() {
        let planner = Planner { noise_nm: vec![80.0; JOINTS], ..Planner::default() };
        let plan = vec![Joints::splat(JOINTS, 11.0); 40];
        let candidates = candidates(&planner, &limits_nm(), &mut generator(KEY, 0), 1.0, &plan);
        assert_eq!(candidates.len(), 64 * 40);
        assert_eq!(candidates[0], Joints::splat(JOINTS, 11.0));
        let largest = |joint: usize| candidates.iter().map(|u| u[joint].abs()).fold(0.0, f32::max);
        assert!((12.0..=87.0).contains(&largest(0)));
        assert!(largest(6) <= 12.0);
    }

    #[test]
    fn a_forecast_that_is_not_finite_is_an_error_that_counts_it() {
        let planner = Planner { samples: 4, ..Planner::default() };
        let path = vec![Joints::splat(JOINTS, 0.0); 3];
        let mut plan = path.clone();
        let broken = |plans: &[Joints<f32>]| {
            let mut positions = plans.to_vec();
            positions[7][2] = f32::NAN;
            Ok(positions)
        };
        let error = improve(&planner, &limits_nm(), KEY, &mut plan, &path, broken).unwrap_err();
        assert!(error.to_string().contains("1 of 4"), "{error}");
    }

    #[test]
    fn candidates_that_cost_the_same_weigh_the_same() {
        assert_eq!(softmin(&[2.0, 2.0], 0.1), [0.5, 0.5]);
        let weights = softmin(&[0.0, 1.0, 3.0], 0.5);
        assert!(weights[0] > weights[1] && weights[1] > weights[2]);
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
