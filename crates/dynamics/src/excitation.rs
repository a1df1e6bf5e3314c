//! Joint torques: drawn per trajectory, then sampled at the rate of the simulation.

use std::f64::consts::TAU;

use simd::{Lanes, MAX_LANES};
use spec::{Family, PULSES, STEP_LEVELS};

use crate::Joints;
use crate::draws::Draws;

/// The torque law of one trajectory, one set of coefficients per joint. Signs and divisors of the
/// spec are already in the amplitudes.
#[derive(Clone, Debug, PartialEq)]
pub enum Torques {
    /// A chirp on each joint.
    Chirp(Joints<Chirp>),
    /// A sum of sines on each joint.
    Multisine(Joints<Multisine>),
    /// Boxed, since most trajectories have none and would be twice as large.
    Steps(Box<Joints<Steps>>),
    /// Pulses on each joint.
    Pulses(Box<Joints<Pulses>>),
}

/// u(t) = offset + amplitude · cos(2π f1 (1 + depth · cos(2π f2 t)) t + phase).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chirp {
    /// N·m.
    pub offset_nm: f64,
    /// N·m.
    pub amplitude_nm: f64,
    /// The master frequency f1, Hz.
    pub f1_hz: f64,
    /// The frequency f2 of the sweep, Hz.
    pub f2_hz: f64,
    /// The depth of the sweep, a share of f1.
    pub depth: f64,
    /// rad.
    pub phase_rad: f64,
}

/// u(t) = Σ over the four components of a_i · sin or cos(2π f_i t): sine, cosine, sine, cosine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Multisine {
    /// a_i, N·m.
    pub amplitude_nm: [f64; 4],
    /// f_i, Hz.
    pub frequency_hz: [f64; 4],
}

/// u(t) is held at each level in turn, from t = 0 on, and then again from the first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steps {
    /// The levels, N·m.
    pub level_nm: [f64; STEP_LEVELS],
    /// How long each level is held, s.
    pub hold_s: [f64; STEP_LEVELS],
}

/// u(t) rests at 0, rises to a level, holds it and falls to 0 as it rose; then the next pulse, and
/// after the last again the first, from t = 0 on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pulses {
    /// The level of each pulse, N·m.
    pub level_nm: [f64; PULSES],
    /// The rest before it, s.
    pub rest_s: [f64; PULSES],
    /// The time in which it rises, and that in which it falls, s.
    pub rise_s: [f64; PULSES],
    /// The time for which its level is held, s.
    pub hold_s: [f64; PULSES],
}

impl Torques {
    /// The family of these torques.
    pub fn family(&self) -> Family {
        match self {
            Self::Chirp(_) => Family::Chirp,
            Self::Multisine(_) => Family::Multisine,
            Self::Steps(_) => Family::Steps,
            Self::Pulses(_) => Family::Pulses,
        }
    }

    /// The number of joints that they drive.
    pub fn joints(&self) -> usize {
        match self {
            Self::Chirp(joints) => joints.len(),
            Self::Multisine(joints) => joints.len(),
            Self::Steps(joints) => joints.len(),
            Self::Pulses(joints) => joints.len(),
        }
    }

    /// The torque of each joint at time `t` (s), N·m.
    pub fn at(&self, t: f64) -> Joints<f64> {
        match self {
            Self::Chirp(joints) => joints.map(|joint| joint.at(t)),
            Self::Multisine(joints) => joints.map(|joint| joint.at(t)),
            Self::Steps(joints) => joints.map(|joint| joint.at(t)),
            Self::Pulses(joints) => joints.map(|joint| joint.at(t)),
        }
    }

    /// Samples k / `rate_hz` for k = 0, 1, .. into `u`, of shape [samples, joint].
    ///
    /// Always in f64, whatever the precision of the simulation, with joints side by side in lanes.
    /// `count` is the number of joints; where the compiler knows it, no loop over joints is left.
    #[inline(always)]
    pub(crate) fn sample<D: Lanes>(&self, count: usize, rate_hz: f64, u: &mut [f32]) {
        assert_eq!(count, self.joints(), "each joint has its torque");
        match self {
            Self::Chirp(joints) => sample_chirps::<D>(joints, count, rate_hz, u),
            Self::Multisine(joints) => sample_multisines::<D>(joints, count, rate_hz, u),
            Self::Steps(joints) => sample_each(joints, count, rate_hz, u, Steps::at),
            Self::Pulses(joints) => sample_each(joints, count, rate_hz, u, Pulses::at),
        }
    }
}

impl Chirp {
    fn at(&self, t: f64) -> f64 {
        let modulation = 1.0 + self.depth * (TAU * self.f2_hz * t).cos();
        self.offset_nm
            + self.amplitude_nm * (TAU * self.f1_hz * modulation * t + self.phase_rad).cos()
    }
}

impl Multisine {
    fn at(&self, t: f64) -> f64 {
        let [a, b, c, d] = self.amplitude_nm;
        let [fa, fb, fc, fd] = self.frequency_hz.map(|frequency| TAU * frequency * t);
        a * fa.sin() + b * fb.cos() + c * fc.sin() + d * fd.cos()
    }
}

impl Steps {
    fn at(&self, t: f64) -> f64 {
        let mut left = t % self.hold_s.iter().sum::<f64>();
        for (level, hold) in self.level_nm.iter().zip(self.hold_s) {
            if left < hold {
                return *level;
            }
            left -= hold;
        }
        // Rounding may leave the end of the last level.
        self.level_nm[STEP_LEVELS - 1]
    }
}

impl Pulses {
    fn at(&self, t: f64) -> f64 {
        let length =
            |pulse: usize| self.rest_s[pulse] + 2.0 * self.rise_s[pulse] + self.hold_s[pulse];
        let mut left = t % (0..PULSES).map(length).sum::<f64>();
        for pulse in 0..PULSES {
            if left < length(pulse) {
                let since = left - self.rest_s[pulse];
                let (rise, hold) = (self.rise_s[pulse], self.hold_s[pulse]);
                return self.level_nm[pulse]
                    * if since < 0.0 {
                        0.0
                    } else if since < rise {
                        since / rise
                    } else if since < rise + hold {
                        1.0
                    } else {
                        (1.0 - (since - rise - hold) / rise).max(0.0)
                    };
            }
            left -= length(pulse);
        }
        // Rounding may leave the end of the last pulse.
        0.0
    }
}

pub(crate) fn draw_chirps(
    spec: &spec::Chirp,
    joints: usize,
    frequency_hz: f64,
    draws: &mut Draws,
) -> Torques {
    let band = if frequency_hz < spec.band_split_hz { spec.low_band } else { spec.high_band };
    let mut joints = Joints::splat(joints, Chirp::default());
    for joint in joints.iter_mut() {
        let sign = random_sign(spec.random_sign, draws);
        *joint = Chirp {
            offset_nm: draws.uniform(spec.offset_nm) / spec.torque_divisor,
            amplitude_nm: sign * draws.uniform(spec.amplitude_nm) / spec.torque_divisor,
            f1_hz: frequency_hz * draws.uniform(band.f1),
            f2_hz: frequency_hz * draws.uniform(band.f2),
            depth: spec.modulation_depth,
            phase_rad: draws.uniform(spec.phase_rad),
        };
    }
    Torques::Chirp(joints)
}

pub(crate) fn draw_multisines(
    spec: &spec::Multisine,
    frequency_hz: f64,
    draws: &mut Draws,
) -> Torques {
    let mut joints = Joints::splat(spec.torque_divisor.len(), Multisine::default());
    for (joint, divisor) in joints.iter_mut().zip(&spec.torque_divisor) {
        let sign = random_sign(spec.random_sign, draws);
        let last_sign = random_sign(spec.random_sign, draws);
        let base_hz = frequency_hz * draws.uniform(spec.base);
        joint.frequency_hz = spec.multiples.map(|multiple| multiple * base_hz);
        for amplitude in &mut joint.amplitude_nm {
            *amplitude = sign * draws.uniform(spec.amplitude_nm_per_hz) * frequency_hz / divisor;
        }
        joint.amplitude_nm[3] *= last_sign;
    }
    Torques::Multisine(joints)
}

pub(crate) fn draw_steps(
    spec: &spec::Steps,
    joints: usize,
    frequency_hz: f64,
    draws: &mut Draws,
) -> Torques {
    let mut joints = Joints::splat(joints, Steps::default());
    for joint in joints.iter_mut() {
        for (level, hold) in joint.level_nm.iter_mut().zip(&mut joint.hold_s) {
            *level = draws.uniform(spec.level_nm);
            *hold = draws.uniform(spec.hold_periods) / frequency_hz;
        }
    }
    Torques::Steps(Box::new(joints))
}

pub(crate) fn draw_pulses(
    spec: &spec::Pulses,
    joints: usize,
    frequency_hz: f64,
    draws: &mut Draws,
) -> Torques {
    let mut joints = Joints::splat(joints, Pulses::default());
    for joint in joints.iter_mut() {
        for pulse in 0..PULSES {
            joint.level_nm[pulse] = draws.uniform(spec.level_nm);
            joint.rest_s[pulse] = draws.uniform(spec.rest_periods) / frequency_hz;
            joint.rise_s[pulse] = draws.uniform(spec.rise_periods) / frequency_hz;
            joint.hold_s[pulse] = draws.uniform(spec.hold_periods) / frequency_hz;
        }
    }
    Torques::Pulses(Box::new(joints))
}

fn random_sign(random: bool, draws: &mut Draws) -> f64 {
    if random { draws.sign() } else { 1.0 }
}

/// A rotating pair (sin, cos) of angles that grow by a constant step per sample.
///
/// Four operations instead of a sine; in f64 the error after k samples is about k · 10⁻¹⁶.
struct Rotor<D> {
    sin: D,
    cos: D,
    step_sin: D,
    step_cos: D,
}

impl<D: Lanes> Rotor<D> {
    /// From angle 0, by the given steps in rad.
    #[inline(always)]
    fn new(step: D) -> Self {
        let (step_sin, step_cos) = step.sin_cos();
        Self { sin: D::splat(0.0), cos: D::splat(1.0), step_sin, step_cos }
    }

    #[inline(always)]
    fn advance(&mut self) {
        let sin = self.sin.mul_add(self.step_cos, self.cos * self.step_sin);
        self.cos = self.sin.neg_mul_add(self.step_sin, self.cos * self.step_cos);
        self.sin = sin;
    }
}

#[inline(always)]
fn sample_chirps<D: Lanes>(joints: &Joints<Chirp>, count: usize, rate_hz: f64, u: &mut [f32]) {
    for first in (0..count).step_by(D::LANES) {
        let of = |value: fn(&Chirp) -> f64| joints.map(|joint| value(&joint));
        let offset = gather::<D>(&of(|joint| joint.offset_nm), first);
        let amplitude = gather::<D>(&of(|joint| joint.amplitude_nm), first);
        let angular_rate = gather::<D>(&of(|joint| TAU * joint.f1_hz), first);
        let depth = gather::<D>(&of(|joint| joint.depth), first);
        let phase = gather::<D>(&of(|joint| joint.phase_rad), first);
        let mut modulation =
            Rotor::new(gather::<D>(&joints.map(|joint| TAU * joint.f2_hz / rate_hz), first));
        for (k, sample) in u.chunks_exact_mut(count).enumerate() {
            let t = D::splat(k as f64 / rate_hz);
            let factor = depth.mul_add(modulation.cos, D::splat(1.0));
            let (_, cos) = (angular_rate * factor).mul_add(t, phase).sin_cos();
            scatter(amplitude.mul_add(cos, offset), first, count, sample);
            modulation.advance();
        }
    }
}

#[inline(always)]
fn sample_multisines<D: Lanes>(
    joints: &Joints<Multisine>,
    count: usize,
    rate_hz: f64,
    u: &mut [f32],
) {
    /// Samples whose sines wait for their cosines: all four rotors at once would not fit into registers.
    const PIECE: usize = 64;

    for first in (0..count).step_by(D::LANES) {
        let amplitude = |component: usize| joints.map(|joint| joint.amplitude_nm[component]);
        let step =
            |component: usize| joints.map(|joint| TAU * joint.frequency_hz[component] / rate_hz);
        let a0 = gather::<D>(&amplitude(0), first);
        let a1 = gather::<D>(&amplitude(1), first);
        let a2 = gather::<D>(&amplitude(2), first);
        let a3 = gather::<D>(&amplitude(3), first);
        let mut rotor0 = Rotor::new(gather::<D>(&step(0), first));
        let mut rotor1 = Rotor::new(gather::<D>(&step(1), first));
        let mut rotor2 = Rotor::new(gather::<D>(&step(2), first));
        let mut rotor3 = Rotor::new(gather::<D>(&step(3), first));
        let mut sines = [D::splat(0.0); PIECE];
        for piece in u.chunks_mut(PIECE * count) {
            let samples = piece.len() / count;
            for sines in &mut sines[..samples] {
                *sines = a2.mul_add(rotor2.sin, a0 * rotor0.sin);
                rotor0.advance();
                rotor2.advance();
            }
            for (sample, &sines) in piece.chunks_exact_mut(count).zip(&sines) {
                let cosines = a3.mul_add(rotor3.cos, a1 * rotor1.cos);
                scatter(sines + cosines, first, count, sample);
                rotor1.advance();
                rotor3.advance();
            }
        }
    }
}

fn sample_each<T: Copy>(
    joints: &Joints<T>,
    count: usize,
    rate_hz: f64,
    u: &mut [f32],
    at: fn(&T, f64) -> f64,
) {
    for (k, sample) in u.chunks_exact_mut(count).enumerate() {
        let t = k as f64 / rate_hz;
        for (torque, joint) in sample.iter_mut().zip(joints.iter()) {
            #[expect(clippy::cast_possible_truncation, reason = "torques are recorded in f32")]
            let held = at(joint, t) as f32;
            *torque = held;
        }
    }
}

/// Joints `first`, `first + 1`, .. in the lanes; lanes beyond the last joint are 0.
#[inline(always)]
fn gather<D: Lanes>(values: &Joints<f64>, first: usize) -> D {
    let mut lanes = D::splat(0.0);
    for (lane, &value) in values[first..].iter().take(D::LANES).enumerate() {
        lanes.set_lane(lane, value);
    }
    lanes
}

/// The inverse of [`gather`], into one sample of all joints.
#[inline(always)]
fn scatter<D: Lanes>(lanes: D, first: usize, joints: usize, sample: &mut [f32]) {
    let mut values = [0.0; MAX_LANES];
    lanes.store(&mut values);
    for (to, value) in sample[first..joints].iter_mut().zip(&values[..D::LANES]) {
        *to = *value;
    }
}

#[cfg(test)]
mod tests {
    use simd::F64Array;

    use super::*;

    /// The largest distance from the law evaluated directly, in units of the largest torque.
    fn sampling_error<D: Lanes>(torques: &Torques, samples: usize) -> f64 {
        let mut u = vec![0.0; samples * torques.joints()];
        torques.sample::<D>(torques.joints(), 60.0, &mut u);
        let mut error: f64 = 0.0;
        let mut largest: f64 = 0.0;
        for (k, sample) in u.chunks_exact(torques.joints()).enumerate() {
            for (expected, &torque) in torques.at(k as f64 / 60.0).iter().zip(sample) {
                error = error.max((f64::from(torque) - expected).abs());
                largest = largest.max(expected.abs());
            }
        }
        error / largest
    }

    #[test]
    fn steps_hold_each_level_and_begin_again() {
        let steps = Steps {
            level_nm: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0],
            hold_s: [0.5, 0.25, 1.0, 0.25, 0.5, 0.5, 0.5, 0.5],
        };
        let found = [0.0, 0.49, 0.5, 0.74, 0.75, 3.99, 4.0, 4.6].map(|t| steps.at(t));
        assert_eq!(found, [1.0, 1.0, 2.0, 2.0, 3.0, 8.0, 1.0, 2.0]);
    }

    #[test]
    fn pulses_rest_rise_hold_and_fall() {
        let pulses = Pulses {
            level_nm: [2.0, -4.0, 1.0, 8.0],
            rest_s: [1.0, 0.5, 0.5, 0.0],
            rise_s: [0.5, 0.0, 0.25, 0.0],
            hold_s: [1.0, 0.5, 0.0, 0.5],
        };
        for (t, expected) in [
            (0.5, 0.0),
            (1.25, 1.0),
            (1.5, 2.0),
            (2.4, 2.0),
            (2.75, 1.0),
            (3.25, 0.0),
            (3.5, -4.0),
            (3.9, -4.0),
            (4.25, 0.0),
            (4.625, 0.5),
            (4.75, 1.0),
            (4.875, 0.5),
            (5.25, 8.0),
            (6.0, 0.0),
            (6.75, 1.0),
        ] {
            assert!((pulses.at(t) - expected).abs() < 1e-12, "{} at {t} s", pulses.at(t));
        }
    }

    #[test]
    fn sampled_torques_are_the_law_rounded_to_f32() {
        let chirps = Torques::Chirp(Joints::from_fn(7, |joint| Chirp {
            offset_nm: 0.1 * joint as f64,
            amplitude_nm: 2.0 - 0.5 * joint as f64,
            f1_hz: 0.2 + 0.15 * joint as f64,
            f2_hz: 0.9 - 0.1 * joint as f64,
            depth: 0.25,
            phase_rad: joint as f64 - 3.0,
        }));
        let multisines = Torques::Multisine(Joints::from_fn(6, |joint| Multisine {
            amplitude_nm: [1.0, -2.0, 3.0, 0.5 * joint as f64],
            frequency_hz: [0.1, 0.15, 0.2, 0.3].map(|frequency| frequency * (1.0 + joint as f64)),
        }));
        let steps = Torques::Steps(Box::new(Joints::from_fn(7, |joint| Steps {
            level_nm: [1.0, -2.0, 3.0, 0.5, 0.0, -1.5, 2.5, 0.1 * joint as f64],
            hold_s: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8].map(|hold| hold + 0.01 * joint as f64),
        })));
        for torques in [chirps, multisines, steps] {
            for samples in [400, 20_000] {
                assert!(sampling_error::<F64Array<1>>(&torques, samples) < 6e-8);
                assert!(sampling_error::<F64Array<4>>(&torques, samples) < 6e-8);
                assert!(sampling_error::<F64Array<8>>(&torques, samples) < 6e-8);
            }
        }
    }
}
