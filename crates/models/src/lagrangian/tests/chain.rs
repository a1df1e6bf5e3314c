//! Chains that are found in the motions of arms.

use std::f64::consts::FRAC_PI_2;

use burn::tensor::{Device, Tensor, TensorData};
use nalgebra::Matrix3;
use random::{ChaCha8Rng, keyed, normal};
use series::MeasurementNoise;
use simd::InstructionSet;
use spec::{Gravity, LagrangianSpec, UnknownChain};

use super::{EXACT, predict, spec};
use crate::architecture::{Architecture, Extents, Model, ModelInput};
use crate::initialization::InitialWeights;
use crate::lagrangian::Lagrangian;
use crate::lagrangian::chain::{Chain, Motions, find};
use crate::lagrangian::kinematics::Kinematics;
use crate::lagrangian::recorded::Recorded;
use crate::lagrangian::regression::Bounds;

const JOINTS: usize = 3;
const SAMPLES: usize = 200;
const CONTEXT: usize = 160;
const RATE_HZ: f32 = 50.0;
const ROBOTS: usize = 12;
/// Moments of an arm: masses of 4, 2.5 and 1 kg with their centres off the joints.
const MASSES: [f32; JOINTS] = [4.0, 2.5, 1.0];

/// Motions along sums of waves, and the torques that arms of this chain take, `[sample, joint]` of
/// each robot.
struct Arms {
    u: Vec<Vec<f32>>,
    y: Vec<Vec<f32>>,
}

/// A shoulder that turns about the vertical and lifts, and an elbow across it.
fn arm() -> Chain {
    let turned = |axis: [f64; 3], origin: [f64; 3]| {
        let axis = nalgebra::Vector3::from(axis).normalize();
        let turn = nalgebra::Rotation3::rotation_between(&nalgebra::Vector3::z(), &axis).unwrap();
        turn.matrix()
            .transpose()
            .iter()
            .map(|value| *value as f32)
            .chain(origin.map(|value| value as f32))
            .chain([-3.0, 3.0, 5.0])
            .collect::<Vec<f32>>()
    };
    let rows = [
        turned([0.0, 0.0, 1.0], [0.0, 0.0, 0.0]),
        turned([0.0, 1.0, 0.0], [0.05, 0.0, 0.3]),
        turned([0.2, 0.9, 0.1], [0.4, 0.02, 0.35]),
    ];
    Chain::of_stored(&rows.concat()).0
}

impl Arms {
    fn new(kinematics: &Kinematics, robots: usize, generator: &mut ChaCha8Rng) -> Self {
        let mut arms = Self { u: Vec::new(), y: Vec::new() };
        for _ in 0..robots {
            let waves: Vec<[f64; 3]> = (0..4 * JOINTS)
                .map(|wave| {
                    let rate = 1.5 + (wave / JOINTS) as f64 + 0.3 * normal(generator);
                    [0.35 * normal(generator), rate, FRAC_PI_2 * normal(generator)]
                })
                .collect();
            let position = |sample: f64, joint: usize| -> f64 {
                let of_joint = waves.iter().skip(joint).step_by(JOINTS);
                let time = sample / f64::from(RATE_HZ);
                of_joint.map(|[size, rate, phase]| size * (rate * time + phase).sin()).sum()
            };
            let samples = || (0..SAMPLES).flat_map(|k| (0..JOINTS).map(move |joint| (k, joint)));
            let y =
                samples().map(|(k, joint)| position(k as f64, joint) as f32).collect::<Vec<_>>();
            // The torque at a sample acts until the next one, where it meets the equation half-way.
            let states = |k: f64, joint: usize| {
                let [before, here, after] = [-1.0, 0.0, 1.0].map(|off| position(k + off, joint));
                let rate = f64::from(RATE_HZ);
                [here, (after - before) * rate / 2.0, (after - 2.0 * here + before) * rate * rate]
            };
            let at = |kind: usize, half: f64| -> Vec<f32> {
                samples().map(|(k, joint)| states(k as f64 + half, joint)[kind] as f32).collect()
            };
            let moments: Vec<f32> = MASSES
                .iter()
                .flat_map(|mass| {
                    let mut drawn = [0.0; 10].map(|_: f64| 0.3 * mass * normal(generator) as f32);
                    drawn[0] = mass * (1.0 + 0.2 * normal(generator) as f32);
                    drawn[1] += 2.0 * mass;
                    drawn[6] += 4.0 * mass;
                    drawn
                })
                .collect();
            let [q, v, a] = [0, 1, 2].map(|kind| at(kind, 0.5));
            let each = kinematics.torques_of_moments(InstructionSet::best(), [&q, &v, &a]);
            let torques = each.chunks_exact(moments.len());
            let u = torques.zip(&v).zip(&a).map(|((torques, v), a)| {
                let links: f32 = torques.iter().zip(&moments).map(|(one, two)| one * two).sum();
                links + 0.6 * v + 0.05 * a
            });
            arms.u.push(u.collect());
            arms.y.push(y);
        }
        arms
    }

    fn recordings(&self, samples: usize) -> Vec<Recorded<'_>> {
        let each = self.u.iter().zip(&self.y);
        each.map(|(u, y)| Recorded {
            u,
            y: &y[..samples * JOINTS],
            joints: JOINTS,
            rate_hz: RATE_HZ,
        })
        .collect()
    }

    fn input(&self, device: &Device) -> ModelInput {
        let tensor = |rows: &[Vec<f32>], samples: usize| -> Tensor<3> {
            let rows = rows.iter().flat_map(|row| row[..samples * JOINTS].to_vec()).collect();
            Tensor::from_data(
                TensorData::new::<f32, _>(rows, [self.u.len(), samples, JOINTS]),
                device,
            )
        };
        let (all, seen) = (tensor(&self.u, SAMPLES), tensor(&self.y, CONTEXT));
        ModelInput {
            u: all.clone(),
            y_context: seen.clone(),
            seen_context: seen,
            path: all.zeros_like(),
            unit: all.ones_like(),
            rate_hz: f64::from(RATE_HZ),
            measurement_noise: MeasurementNoise::default(),
        }
    }
}

/// The angle between the axes of two joints, rad.
fn angle(chain: &Chain, one: usize, other: usize) -> f64 {
    let stored = chain.stored(&[super::super::law::Limits::UNKNOWN; JOINTS]);
    let axis = |joint: usize| {
        let turn = Matrix3::from_row_slice(&stored[joint * 15..][..9]).map(f64::from);
        turn.column(2).into_owned()
    };
    axis(one).angle(&axis(other))
}

#[test]
fn the_axes_of_an_arm_are_found_in_its_motions() {
    let truth = arm();
    let mut generator = keyed([5, 0, 0, 0]);
    for gravity in [Gravity::On, Gravity::Off] {
        let arms = Arms::new(&truth.kinematics(gravity), ROBOTS, &mut generator);
        let motions = Motions::new(&arms.recordings(CONTEXT), 80, gravity);
        let found = find(&motions, &mut generator).chain;
        // A mirror image has the same torques, and turns the other way about two of three axes.
        for (one, other) in [(0, 1), (1, 2), (0, 2)] {
            let [found, expected] = [&found, &truth].map(|chain| angle(chain, one, other));
            let off = (found - expected).abs().min((found + expected - 2.0 * FRAC_PI_2).abs());
            assert!(off < 0.02, "{gravity:?} {one} {other}: {found} rad, not {expected} rad");
        }
        let [misfit, best] = [&found, &truth].map(|chain| motions.misfit(chain));
        assert!(misfit < best + 0.3, "{gravity:?}: {misfit}, not {best}");
        assert!(motions.misfit(&Chain::straight(JOINTS)) > best + 2.0);
    }
}

#[test]
fn numbers_in_a_basis_have_the_torques_of_their_moments() {
    let plain = arm().kinematics(Gravity::On);
    let count = plain.particles();
    let mut generator: ChaCha8Rng = keyed([3, 0, 0, 0]);
    let mut drawn =
        |count: usize| -> Vec<f32> { (0..count).map(|_| normal(&mut generator) as f32).collect() };
    let (basis, numbers) = (drawn(count * count), drawn(count));
    let states = [(); 3].map(|()| drawn(5 * JOINTS));
    let dot = |row: &[f32], values: &[f32]| -> f32 {
        row.iter().zip(values).map(|(one, other)| one * other).sum()
    };
    let moments: Vec<f32> = basis.chunks_exact(count).map(|row| dot(row, &numbers)).collect();
    let mixed = plain.clone().in_basis(&basis);
    let states = states.each_ref().map(Vec::as_slice);
    let near = |one: f32, other: f32| (one - other).abs() < 1e-4 * (1.0 + other.abs());
    for instructions in InstructionSet::available() {
        let [of_moments, of_numbers] =
            [&plain, &mixed].map(|kinematics| kinematics.torques_of_moments(instructions, states));
        let rows = of_moments.chunks_exact(count).zip(of_numbers.chunks_exact(count));
        for (of_moments, of_numbers) in rows {
            let [expected, found] = [dot(of_moments, &moments), dot(of_numbers, &numbers)];
            // Sums of hundreds of terms.
            assert!((found - expected).abs() < 1e-2, "{found} {expected}");
        }
    }
    let (mut expected, mut found) = (moments, numbers);
    plain.weigh(&mut expected);
    mixed.weigh(&mut found);
    let mut both = found.iter().zip(&expected);
    assert!(both.all(|(found, expected)| near(*found, *expected)), "{found:?} {expected:?}");
}

#[test]
fn the_numbers_of_arms_of_a_found_chain_vary_by_one() {
    let mut generator = keyed([9, 0, 0, 0]);
    let kinematics = arm().kinematics(Gravity::On);
    let [trained, others] =
        [3 * ROBOTS, ROBOTS].map(|robots| Arms::new(&kinematics, robots, &mut generator));
    let begun = unknown(1).begin(&trained.input(&Device::flex()), 7);
    let law = begun.law();
    let weights = law.numbers.weights();
    assert!(law.prior.spread[weights.clone()].iter().all(|spread| (spread - 1.0).abs() < 1e-3));
    // How far other arms are from the mean, in spreads, as their torques tell.
    let recordings = others.recordings(CONTEXT);
    let mut squares = vec![0.0; weights.len()];
    for recorded in &recordings {
        let found = law.fit(InstructionSet::best(), recorded, Bounds::Dissipation);
        for (square, number) in squares.iter_mut().zip(weights.clone()) {
            *square += (found.mean[number] - law.prior.mean[number]).powi(2);
        }
    }
    // The largest numbers are those that torques tell best.
    squares.sort_by(f64::total_cmp);
    let most = squares.last().unwrap() / recordings.len() as f64;
    assert!((0.3..4.0).contains(&most), "{squares:?}");
}

fn unknown(seed: u64) -> Lagrangian {
    let chain = Some(UnknownChain { gravity: Gravity::On });
    let spec = LagrangianSpec { chain, rotor_inertia: true, ..spec() };
    let device = Device::flex().autodiff();
    let extents = Extents::new(CONTEXT as u32, SAMPLES as u32, JOINTS).unwrap();
    spec.init(extents, &mut InitialWeights::new(seed, &device)).unwrap()
}

#[test]
fn a_law_that_has_begun_predicts_arms_of_its_chain_within_their_range() {
    let mut generator = keyed([9, 0, 0, 0]);
    let kinematics = arm().kinematics(Gravity::On);
    let [trained, others] =
        [ROBOTS, 4].map(|robots| Arms::new(&kinematics, robots, &mut generator));
    let before = unknown(1);
    let begun = before.clone().begin(&trained.input(&Device::flex()), 7);
    let law = begun.law();
    let recordings = others.recordings(CONTEXT);
    let answers = predict(&law, &recordings, EXACT);
    let rows = (SAMPLES - CONTEXT) * JOINTS;
    let mut squares = [0.0; 2];
    for (robot, answer) in answers.chunks_exact(rows).enumerate() {
        let truth = &others.y[robot][CONTEXT * JOINTS..];
        let held = &others.y[robot][(CONTEXT - 1) * JOINTS..];
        for (at, (answer, truth)) in answer.iter().zip(truth).enumerate() {
            squares[0] += (answer - truth).powi(2);
            squares[1] += (held[at % JOINTS] - truth).powi(2);
        }
    }
    assert!(squares[0] < 1e-3 * squares[1], "{squares:?}");

    // The chain is as a file of weights keeps it, and a second beginning finds the same.
    let stored = |law: &Lagrangian| law.chain.as_ref().unwrap().places();
    let again = begun.clone().begin(&trained.input(&Device::flex()), 7);
    assert_eq!(stored(&again), stored(&begun));
    assert_ne!(stored(&before), stored(&begun));
    for (joint, limits) in begun.limits().into_iter().enumerate() {
        let positions = trained.y.iter().flat_map(|y| y[..CONTEXT * JOINTS].iter().skip(joint));
        let most = positions.step_by(JOINTS).fold(f32::MIN, |most, position| most.max(*position));
        assert!(limits.position[1] > most && limits.position[1] < most + 6.0, "{limits:?}");
    }
}

#[test]
fn a_law_that_is_told_its_arm_does_not_begin_with_a_search() {
    let told: LagrangianSpec =
        serde_json::from_value(serde_json::json!({"robot": {"model": "ur10e"}})).unwrap();
    let device = Device::flex().autodiff();
    let extents = Extents::new(60, 90, 6).unwrap();
    let law = told.init(extents, &mut InitialWeights::new(1, &device)).unwrap();
    assert!(law.chain.is_none());
}
