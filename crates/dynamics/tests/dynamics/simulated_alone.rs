//! A controller and an integrator that are written again, one robot at a time.

use std::f64::consts::TAU;

use dynamics::{
    Gains, Joints, ReferenceState, Robot, Scenario, bias_forces, forward_dynamics, gravity,
    mass_matrix,
};
use nalgebra::{DMatrix, DVector, Matrix3, Quaternion, UnitQuaternion, Vector3};
use spec::{ControlLaw, RobotSpec, SimulateSpec};

use crate::JOINTS;

/// Position and orientation of the hand in the world.
pub fn hand(arm: &Robot, q: &Numbers) -> (Vector3<f64>, Matrix3<f64>) {
    let pose = arm.kinematics.end_effector_pose(*q);
    let turn = UnitQuaternion::from_quaternion(Quaternion::from(pose.quaternion_xyzw));
    (pose.position_m.into(), turn.to_rotation_matrix().into_inner())
}

/// The hand's Jacobian by differences of poses.
fn jacobian(arm: &Robot, q: &Numbers) -> DMatrix<f64> {
    const STEP: f64 = 1e-5;

    let mut jacobian = DMatrix::zeros(6, JOINTS);
    for joint in 0..JOINTS {
        let [before, after] = [-STEP, STEP].map(|step| {
            let mut q = *q;
            q[joint] += step;
            hand(arm, &q)
        });
        let turn = (after.1 * before.1.transpose() - before.1 * after.1.transpose()) / (8.0 * STEP);
        let column = jacobian.column_mut(joint);
        let linear = (after.0 - before.0) / (2.0 * STEP);
        let turn =
            [turn[(2, 1)] - turn[(1, 2)], turn[(0, 2)] - turn[(2, 0)], turn[(1, 0)] - turn[(0, 1)]];
        let values = linear.iter().copied().chain(turn);
        column.into_iter().zip(values).for_each(|(entry, value)| *entry = value);
    }
    jacobian
}

/// Velocity and acceleration of the hand.
fn motion(arm: &Robot, q: &Numbers, qd: &Numbers, qdd: &Numbers) -> [DVector<f64>; 2] {
    const STEP: f64 = 1e-4;

    let moved = |step: f64| Joints::from_fn(JOINTS, |joint| q[joint] + step * qd[joint]);
    let [slower, faster] = [-STEP, STEP].map(|step| jacobian(arm, &moved(step)));
    let vector = |numbers: &Numbers| DVector::from_iterator(JOINTS, numbers.iter().copied());
    let here = jacobian(arm, q);
    [&here * vector(qd), here * vector(qdd) + (faster - slower) / (2.0 * STEP) * vector(qd)]
}

/// The torques of a controller of the hand, from matrices and their inverses.
fn hand_torques(
    law: &ControlLaw,
    gains: &Gains,
    known: &Robot,
    reference: &ReferenceState,
    [q, v]: [&Numbers; 2],
) -> Numbers {
    let dims = gains.kp.len();
    let zero = Joints::splat(JOINTS, 0.0);
    let ([x, axes], [x_r, axes_r]) = (hand_of(known, q), hand_of(known, &reference.r));
    let [speed, bias] = motion(known, q, v, &zero);
    let [speed_r, acceleration_r] = motion(known, &reference.r, &reference.rd, &reference.rdd);
    let turn: Vector3<f64> =
        (0..3).map(|axis| 0.5 * axes.column(axis).cross(&axes_r.column(axis))).sum();
    let error: Vec<f64> =
        (x_r.column(0) - x.column(0)).iter().chain(turn.iter()).copied().collect();
    let pull = DVector::from_fn(dims, |row, _| {
        gains.kp[row] * error[row] + gains.kd[row] * (speed_r[row] - speed[row])
    });
    let jacobian = jacobian(known, q).rows(0, dims).into_owned();
    let (kn, dn) = (gains.kn.unwrap(), gains.dn.unwrap());
    let kept = DVector::from_fn(JOINTS, |joint, _| {
        kn * (reference.r[joint] - q[joint]) + dn * (reference.rd[joint] - v[joint])
    });
    let torques = match law {
        ControlLaw::OperationalSpace(_) => {
            let matrix = mass_matrix(known, *q);
            let matrix = DMatrix::from_fn(JOINTS, JOINTS, |row, column| matrix[row][column]);
            let inverse = matrix.clone().try_inverse().unwrap();
            let lambda = (&jacobian * inverse * jacobian.transpose()).try_inverse().unwrap();
            let kept = kept + DVector::from_iterator(JOINTS, reference.rdd.iter().copied());
            let wanted = pull + acceleration_r.rows(0, dims) - bias.rows(0, dims);
            let force = lambda * (wanted - &jacobian * &kept);
            let forces = bias_forces(known, *q, *v);
            matrix * kept
                + jacobian.transpose() * force
                + DVector::from_iterator(JOINTS, forces.iter().copied())
        }
        _ => {
            let gram = (&jacobian * jacobian.transpose()).try_inverse().unwrap();
            let free = DMatrix::identity(JOINTS, JOINTS) - jacobian.transpose() * gram * &jacobian;
            let weight = gravity(known, *q);
            jacobian.transpose() * pull
                + free * kept
                + DVector::from_iterator(JOINTS, weight.iter().copied())
        }
    };
    torques.iter().copied().collect()
}

/// The hand's position as the first column of a matrix, and its axes as the columns of another.
fn hand_of(arm: &Robot, q: &Numbers) -> [Matrix3<f64>; 2] {
    let (position, axes) = hand(arm, q);
    [Matrix3::from_columns(&[position, Vector3::zeros(), Vector3::zeros()]), axes]
}

/// Positions at each sample and mean torques after it, by an integration and a controller that share
/// nothing with the lanes.
pub fn simulated_alone(spec: &SimulateSpec, scenario: &Scenario) -> [Vec<[f64; JOINTS]>; 2] {
    const STEPS: usize = 4;

    let controller = spec.controller.as_ref().unwrap();
    let tracking = scenario.excitation.tracking().unwrap();
    let gains = &tracking.gains;
    let known = Robot::nominal(&RobotSpec { payload: None, ..spec.robot.clone() });
    let period = 1.0 / controller.rate_hz;
    let periods = controller.periods(spec.rate_hz);
    let settling = controller.settling_samples(spec.rate_hz);
    let limits = spec.robot.description().per_joint(|joint| joint.torque_nm);
    let ratio = TAU * controller.velocity_cutoff_hz * period;

    let (mut q, mut qd) = (scenario.q0, scenario.qd0);
    let (mut measured, mut velocity) = (q, qd);
    let mut sum = Joints::splat(JOINTS, 0.0);
    let mut commands = vec![gravity(&known, q)];
    let (mut positions, mut torques) = (Vec::new(), Vec::new());
    for sample in 0..settling + spec.samples as usize {
        let start = q;
        let mut impulse = [0.0; JOINTS];
        for of_sample in 0..periods {
            let reference = tracking.reference.at((sample * periods + of_sample) as f64 * period);
            let mut wish = Joints::splat(JOINTS, 0.0);
            for joint in 0..JOINTS {
                let difference = (q[joint] - measured[joint]) / period;
                velocity[joint] += ratio / (1.0 + ratio) * (difference - velocity[joint]);
                if gains.kn.is_some() {
                    continue;
                }
                let error = reference.r[joint] - q[joint];
                sum[joint] += error * period;
                wish[joint] = gains.kp[joint] * error
                    + gains.kd[joint] * (reference.rd[joint] - velocity[joint])
                    + gains.ki[joint] * sum[joint];
            }
            measured = q;
            let mut command = match controller.law {
                ControlLaw::JointPd(_) => {
                    let weight = gravity(&known, q);
                    Joints::from_fn(JOINTS, |joint| wish[joint] + weight[joint])
                }
                ControlLaw::ComputedTorque(_) => {
                    let matrix = mass_matrix(&known, q);
                    let bias = bias_forces(&known, q, velocity);
                    Joints::from_fn(JOINTS, |row| {
                        let inertia = |joint: usize| {
                            matrix[row][joint] * (reference.rdd[joint] + wish[joint])
                        };
                        bias[row] + (0..JOINTS).map(inertia).sum::<f64>()
                    })
                }
                ControlLaw::OperationalSpace(_) | ControlLaw::CartesianImpedance(_) => {
                    hand_torques(&controller.law, gains, &known, &reference, [&q, &velocity])
                }
            };
            let before = commands[commands.len() - 1];
            let most = controller.torque_rate_nm_s.unwrap() * period;
            for joint in 0..JOINTS {
                let limited = command[joint].clamp(-limits[joint], limits[joint]);
                command[joint] = before[joint] + (limited - before[joint]).clamp(-most, most);
            }
            commands.push(command);
            let age = gains.delay_periods as usize;
            let torque = commands[(commands.len() - 1).saturating_sub(age)];
            for joint in 0..JOINTS {
                impulse[joint] += torque[joint];
            }
            for _ in 0..STEPS {
                (q, qd) = runge_kutta(&scenario.robot, &q, &qd, &torque, period / STEPS as f64);
            }
        }
        if sample >= settling {
            positions.push(std::array::from_fn(|joint| start[joint]));
            torques.push(impulse.map(|sum| sum / periods as f64));
        }
    }
    [positions, torques]
}

type Numbers = Joints<f64>;

fn runge_kutta(
    robot: &Robot,
    q: &Numbers,
    qd: &Numbers,
    torque: &Numbers,
    h: f64,
) -> (Numbers, Numbers) {
    let ahead = |from: &Numbers, slope: &Numbers, h: f64| {
        Joints::from_fn(JOINTS, |joint| from[joint] + h * slope[joint])
    };
    let at = |q: &Numbers, qd: &Numbers| forward_dynamics(robot, *q, *qd, *torque);
    let a1 = at(q, qd);
    let (q2, v2) = (ahead(q, qd, 0.5 * h), ahead(qd, &a1, 0.5 * h));
    let a2 = at(&q2, &v2);
    let (q3, v3) = (ahead(q, &v2, 0.5 * h), ahead(qd, &a2, 0.5 * h));
    let a3 = at(&q3, &v3);
    let (q4, v4) = (ahead(q, &v3, h), ahead(qd, &a3, h));
    let a4 = at(&q4, &v4);
    let mean = |a: &Numbers, b: &Numbers, c: &Numbers, d: &Numbers| {
        Joints::from_fn(JOINTS, |joint| {
            (a[joint] + 2.0 * b[joint] + 2.0 * c[joint] + d[joint]) / 6.0
        })
    };
    (ahead(q, &mean(qd, &v2, &v3, &v4), h), ahead(qd, &mean(&a1, &a2, &a3, &a4), h))
}
