//! Autoregression with exogenous inputs, one model per joint and robot.

use models::Interrupt;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use series::{Observed, Track};

use super::filtered::smoothed;
use super::rollout::{mean_velocities, to_f32};
use crate::{EvaluationError, Predictor};

/// v[k] = Σ a_i v[k-i] + Σ b_ij u_j[k+1-i] + c, i = 1 .. order, in mean velocities v over sampling
/// periods, fitted to each robot's context by ridge regression (Ljung 1999, "System Identification",
/// section 4.2).
///
/// Each joint chooses the order, the ridge, and whether the torques of all joints or only its own
/// are inputs. It takes the choice that best predicts the last quarter of the context, rolled out
/// freely after a fit to the first three quarters. Then this law is fitted to all of the context.
///
/// With noise, predictions begin with the position and the velocities of the smoothed context.
/// Smoothing removes some of the fast motions, and without it a fit mistakes noise for slow motion.
/// So laws are fitted both to the measured velocities and to smoothed ones, and the choice is made
/// among all of them.
///
/// If a fit has poles outside the circle of radius [`LARGEST_POLE`], all its poles are scaled into
/// the circle: a_i is multiplied by the i-th power of one factor. The reason is that a damped arm
/// does not run away.
#[derive(Clone, Copy, Debug)]
pub struct Arx;

const ORDERS: [usize; 5] = [1, 2, 3, 4, 6];
/// Ridges relative to the mean square of a regressor.
const RIDGES: [f64; 6] = [1e-8, 1e-6, 1e-4, 1e-2, 1e-1, 1.0];
/// It corresponds to a time constant of 1000 samples.
const LARGEST_POLE: f64 = 0.999;
/// The share of the context that is held out for the choice.
const HELD_OUT: f64 = 0.25;

impl Predictor for Arx {
    fn name(&self) -> &'static str {
        "arx"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        let smoothed = smoothed(observed)?;
        let smoothed = smoothed.as_ref().map(|series| series.observed(observed.context()));
        let interrupt = Interrupt::current();
        let each = (0..observed.robots()).into_par_iter();
        Ok(each
            .flat_map_iter(|scenario| {
                interrupt.leave_if_raised();
                let smoothed = smoothed.as_ref().map(|smoothed| smoothed.y(scenario));
                predict_one(observed, scenario, smoothed)
            })
            .collect())
    }
}

/// The positions of a scenario's horizon, `[horizon, joint]`. With noise, `smoothed` has those of
/// the context without it.
fn predict_one(observed: &Observed<'_>, scenario: usize, smoothed: Option<Track<'_>>) -> Vec<f32> {
    let (horizon, joints) = (observed.horizon(), observed.joints());
    let period = 1.0 / observed.rate_hz();
    let (measured, torques) = (observed.y(scenario), observed.u(scenario));
    let positions = smoothed.unwrap_or(measured);
    let last = observed.context() - 1;
    let mut predicted = vec![0.0; horizon * joints];
    for joint in 0..joints {
        let velocities: Vec<f64> = mean_velocities(positions, joint, period).collect();
        let series = JointSeries { velocities: &velocities, torques, joint };
        let mut position = f64::from(positions[last][joint]);
        let law = if smoothed.is_some() {
            let velocities: Vec<f64> = mean_velocities(measured, joint, period).collect();
            series.choose(&[series, JointSeries { velocities: &velocities, ..series }])
        } else {
            series.choose(&[series])
        };
        let future = series.rollout(law.as_ref(), last, horizon);
        for (predicted, velocity) in predicted[joint..].iter_mut().step_by(joints).zip(future) {
            position += velocity * period;
            *predicted = to_f32(position);
        }
    }
    predicted
}

/// The data of one joint.
#[derive(Clone, Copy)]
struct JointSeries<'a> {
    /// Mean velocities over each period of the context.
    velocities: &'a [f64],
    /// Torques of all samples.
    torques: Track<'a>,
    joint: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Inputs {
    Own,
    All,
}

/// A law of motion. Coefficients are in the order of [`JointSeries::regressors`].
#[derive(Clone, Debug)]
struct Law {
    order: usize,
    inputs: Inputs,
    coefficients: DVector<f64>,
}

impl JointSeries<'_> {
    /// The law that best predicts the end of the context, fitted to all of one of `sources`. `None`
    /// if the context is too short or has too little motion. The joint is then held.
    fn choose(&self, sources: &[JointSeries<'_>]) -> Option<Law> {
        let known = self.velocities.len();
        let held_out = share(known);
        let first = known - held_out;
        let mut best = (self.squared_error(None, first, held_out), None);
        for source in sources {
            for inputs in [Inputs::Own, Inputs::All] {
                for order in ORDERS {
                    let Some(normal) = Normal::of(source, order, inputs, first) else { continue };
                    for ridge in RIDGES {
                        let law = normal.solve(ridge);
                        let error = self.squared_error(law.as_ref(), first, held_out);
                        if law.is_some() && error < best.0 {
                            best = (error, Some((source, order, inputs, ridge)));
                        }
                    }
                }
            }
        }
        let (source, order, inputs, ridge) = best.1?;
        Normal::of(source, order, inputs, known)?.solve(ridge)
    }

    /// Sum of the squared position errors. Velocities are known up to `first`, and a period counts
    /// as 1 s.
    fn squared_error(&self, law: Option<&Law>, first: usize, count: usize) -> f64 {
        let mut distance = 0.0;
        let mut sum = 0.0;
        for (step, predicted) in self.rollout(law, first, count).into_iter().enumerate() {
            distance += predicted - self.velocities[first + step];
            sum += distance * distance;
        }
        sum
    }

    /// Velocities over `count` periods from period `first` on. Those before it are known.
    fn rollout(&self, law: Option<&Law>, first: usize, count: usize) -> Vec<f64> {
        let Some(law) = law else { return vec![0.0; count] };
        let mut velocities = self.velocities[first - law.order..first].to_vec();
        let mut row = Vec::new();
        for step in 0..count {
            let past = &velocities[step..];
            self.regressors(law.order, law.inputs, past, first + step, &mut row);
            velocities.push(row.iter().zip(&law.coefficients).map(|(x, c)| x * c).sum());
        }
        velocities.split_off(law.order)
    }

    /// Writes the regressors into `row`: v[k-1], .. v[k-order] of `past`, which ends at k - 1, then
    /// u[k], .. u[k+1-order] of each input, then 1.
    fn regressors(&self, order: usize, inputs: Inputs, past: &[f64], k: usize, row: &mut Vec<f64>) {
        row.clear();
        row.extend(past.iter().rev().take(order));
        let joints = match inputs {
            Inputs::Own => self.joint..self.joint + 1,
            Inputs::All => 0..self.torques.joints(),
        };
        for joint in joints {
            row.extend((0..order).map(|lag| f64::from(self.torques[k - lag][joint])));
        }
        row.push(1.0);
    }
}

fn share(known: usize) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a length"
    )]
    let held_out = (known as f64 * HELD_OUT) as usize;
    held_out
}

/// Normal equations of a fit, which can be solved for several ridges.
struct Normal {
    order: usize,
    inputs: Inputs,
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

impl Normal {
    /// The equations of periods 0 to `end`. `None` with fewer equations than twice the unknowns.
    fn of(series: &JointSeries<'_>, order: usize, inputs: Inputs, end: usize) -> Option<Self> {
        let torques = match inputs {
            Inputs::Own => 1,
            Inputs::All => series.torques.joints(),
        };
        let unknowns = order * (1 + torques) + 1;
        if end < order + 2 * unknowns {
            return None;
        }
        let mut matrix = DMatrix::zeros(unknowns, unknowns);
        let mut right = DVector::zeros(unknowns);
        let mut row = Vec::with_capacity(unknowns);
        for k in order..end {
            series.regressors(order, inputs, &series.velocities[k - order..k], k, &mut row);
            let row = DVector::from_column_slice(&row);
            matrix.syger(1.0, &row, &row, 1.0);
            right.axpy(series.velocities[k], &row, 1.0);
        }
        matrix.fill_upper_triangle_with_lower_triangle();
        Some(Self { order, inputs, matrix, right })
    }

    /// Solves with `ridge` times the mean square of each regressor. The constant has no ridge.
    fn solve(&self, ridge: f64) -> Option<Law> {
        let mut matrix = self.matrix.clone();
        let constant = self.right.len() - 1;
        for k in 0..constant {
            matrix[(k, k)] *= 1.0 + ridge;
        }
        let mut coefficients = matrix.cholesky()?.solve(&self.right);
        damp(&mut coefficients.as_mut_slice()[..self.order]);
        Some(Law { order: self.order, inputs: self.inputs, coefficients })
    }
}

/// Scales the poles of v[k] = Σ a_i v[k-i] into the circle of radius [`LARGEST_POLE`].
fn damp(a: &mut [f64]) {
    let order = a.len();
    // The eigenvalues of the companion matrix are the poles.
    let companion = DMatrix::from_fn(order, order, |row, column| match row {
        0 => a[column],
        _ => f64::from(u8::from(row == column + 1)),
    });
    let largest =
        companion.complex_eigenvalues().iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    if largest > LARGEST_POLE {
        let mut factor = 1.0;
        for a in a {
            factor *= LARGEST_POLE / largest;
            *a *= factor;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use series::Series;

    use super::*;
    use crate::baselines::LeastSquares;
    use crate::baselines::fixture::{error_of, first_order_robot};

    /// Joints of the Panda.
    const JOINTS: usize = 7;

    fn largest_pole(a: &[f64]) -> f64 {
        // Plain power iteration: the growth of the free response over many steps.
        let mut past = vec![0.0; a.len()];
        past[0] = 1.0;
        let (steps, mut log) = (20_000, 0.0);
        for _ in 0..steps {
            let next = a.iter().zip(&past).map(|(a, v)| a * v).sum();
            past.rotate_right(1);
            past[0] = next;
            let norm = past.iter().map(|v: &f64| v * v).sum::<f64>().sqrt();
            if norm == 0.0 {
                return 0.0;
            }
            past.iter_mut().for_each(|v| *v /= norm);
            log += norm.ln();
        }
        (log / f64::from(steps)).exp()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn no_law_has_a_pole_outside_the_circle(
            a in proptest::collection::vec(-2.0..2.0f64, 1..6),
        ) {
            let before = largest_pole(&a);
            let mut damped = a.clone();
            damp(&mut damped);
            prop_assert!(largest_pole(&damped) < LARGEST_POLE + 1e-3);
            if before < LARGEST_POLE - 1e-3 {
                prop_assert_eq!(damped, a);
            }
        }
    }

    /// A joint that its own torque and that of its neighbour move, with two poles each.
    fn coupled_robot() -> Series {
        let mut scenarios = first_order_robot(0.0, 0.0);
        let mut velocity = [[0.0; JOINTS]; 2];
        let mut position = [0.2; JOINTS];
        for k in 0..scenarios.samples() {
            let u: [f32; JOINTS] = std::array::from_fn(|joint| {
                let t = k as f32;
                (0.05 * t * (1.0 + 0.21 * joint as f32)).sin() + (0.11 * t).cos()
            });
            let row = k * JOINTS..(k + 1) * JOINTS;
            scenarios.u_mut()[row.clone()].copy_from_slice(&u);
            scenarios.y_mut()[row].copy_from_slice(&position.map(to_f32));
            let before = velocity;
            for joint in 0..JOINTS {
                let neighbour = u[(joint + 1) % JOINTS];
                velocity[0][joint] = 1.2 * before[0][joint] - 0.5 * before[1][joint]
                    + 0.03 * f64::from(u[joint])
                    - 0.01 * f64::from(neighbour);
                position[joint] += velocity[0][joint] / scenarios.rate_hz();
            }
            velocity[1] = before[0];
        }
        scenarios
    }

    #[test]
    fn coupled_joints_of_second_order_are_identified_where_order_1_cannot() {
        let robot = coupled_robot();
        let (arx, first_order) = (error_of(&Arx, &robot), error_of(&LeastSquares, &robot));
        assert!(arx < 0.01, "{arx}");
        assert!(first_order > 10.0 * arx, "{first_order}");
    }

    #[test]
    fn noise_of_a_milliradian_leaves_most_of_what_is_identified() {
        let mut robot = coupled_robot();
        let held = error_of(&crate::HoldLast, &robot);
        dynamics::add_position_noise(&mut robot, 1e-3, 320, 7, 0);
        let arx = error_of(&Arx, &robot);
        assert!(arx < 0.25 * held, "{arx} {held}");
        assert_eq!(Arx.predict(&robot.observed(320)).unwrap().len(), 80 * JOINTS);
    }

    #[test]
    fn an_arm_that_does_not_move_is_held() {
        let mut still = first_order_robot(0.0, 0.0);
        still.u_mut().fill(0.0);
        assert!(error_of(&Arx, &still) < 1e-9);
    }

    #[test]
    fn a_context_too_short_to_tell_is_held() {
        let robot = first_order_robot(0.8, 0.03);
        for context in 1..8 {
            let predicted = Arx.predict(&robot.observed(context)).unwrap();
            assert!(predicted.iter().all(|q| q.is_finite()));
        }
    }
}
