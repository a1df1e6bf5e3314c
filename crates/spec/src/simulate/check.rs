//! Checks the values of a simulation.

use super::excitation::{Chirp, Excitation, Family, Frequency, Multisine, Pulses, Steps};
use super::integrator::{Integrator, MAX_SUBSTEPS};
use super::robot_spec::{Friction, Payload, RobotSpec};
use super::spec::{MAX_TRAJECTORIES, Rejection, SimulateSpec};
use crate::MAX_SAMPLING_RATE_HZ;
use crate::check::{Check, Violations};
use crate::robot::check::{ARMATURE_KG_M2, DAMPING_NM_S_RAD, PHI1_NM, PHI2_S_RAD, PHI3_RAD_S};

/// The largest number of frequencies of a grid.
const MAX_GRID: usize = 200;
/// The most postures of a reference. The table of robots lists them.
const MAX_POSTURES: f64 = 1000.0;
const TORQUE_NM: std::ops::RangeInclusive<f64> = -1000.0..=1000.0;
const FACTOR: std::ops::RangeInclusive<f64> = 0.01..=100.0;

impl Check for SimulateSpec {
    fn check(&self, violations: &mut Violations) {
        violations.within("trajectories", self.trajectories, 1..=MAX_TRAJECTORIES);
        violations.seed("seed", self.seed);
        violations.within("samples", self.samples, 2..=10_000);
        violations.within("rate_hz", self.rate_hz, 1.0..=MAX_SAMPLING_RATE_HZ);
        violations.within("shard_trajectories", self.shard_trajectories, 1..=100_000);
        violations.part("excitation", &self.excitation);
        violations.part("robot", &self.robot);
        violations.part("initial_state", &self.initial_state);
        violations.part("observations", &self.observations);
        violations.part("rejection", &self.rejection);
        violations.part("integrator", &self.integrator);
        violations.part("execution", &self.execution);
        self.check_controller(violations);
        self.check_families(violations);
        let joints = self.joints();
        let center = &self.initial_state.center_rad;
        violations.one_per_joint("initial_state.center_rad", center, joints);
        if let Some(multisine) = &self.excitation.multisine {
            let field = "excitation.multisine.torque_divisor";
            violations.one_per_joint(field, &multisine.torque_divisor, joints);
        }
        self.check_nyquist(violations);
        self.check_stability(violations);
        let grid = self.excitation.grid();
        if !grid.is_empty() && !self.trajectories.is_multiple_of(grid.len() as u64) {
            violations.add(
                "trajectories",
                self.trajectories,
                format!("a multiple of {}, the number of grid frequencies", grid.len()),
            );
        }
    }
}

impl SimulateSpec {
    /// A controller follows references, and nothing else does.
    fn check_families(&self, violations: &mut Violations) {
        for family in self.excitation.families() {
            let field = format!("excitation.{}", family.field());
            match (&self.controller, family.is_reference()) {
                (None, true) => violations.add(
                    &field,
                    "a reference",
                    "chirp, multisine, steps or pulses: references need a controller",
                ),
                (Some(_), false) => violations.add(
                    &field,
                    "torques",
                    "fourier, point_to_point, via_points or hand_paths: a controller follows references",
                ),
                _ => {}
            }
        }
    }

    /// Refuses components above half the rate, because torques are held between samples.
    fn check_nyquist(&self, violations: &mut Violations) {
        let nyquist = self.rate_hz / 2.0;
        let mut check = |field: &str, highest: f64| {
            if highest > nyquist {
                violations.add(
                    field,
                    format!("up to {highest} Hz with its multiples"),
                    format!("at most {nyquist} Hz, half of rate_hz"),
                );
            }
        };
        if let Some(chirp) = &self.excitation.chirp {
            check("excitation.chirp.frequency_hz", chirp.highest_frequency_hz());
        }
        if let Some(multisine) = &self.excitation.multisine {
            check("excitation.multisine.frequency_hz", multisine.highest_frequency_hz());
        }
        if let Some(series) = &self.excitation.fourier {
            let highest = series.frequency_hz.support().max * f64::from(series.harmonics);
            check("excitation.fourier.frequency_hz", highest);
        }
        let parts = [Family::PointToPoint, Family::ViaPoints, Family::HandPaths];
        for (family, frequency) in
            parts.map(|family| (family, self.excitation.frequency_hz(family)))
        {
            let Some(highest) = frequency.map(|frequency| frequency.support().max) else {
                continue;
            };
            let field = format!("excitation.{}.frequency_hz", family.field());
            let most = self.rate_hz / 4.0;
            if highest > most {
                let allowed = format!("at most {most} Hz, a quarter of rate_hz");
                violations.add(&field, format!("up to {highest} Hz"), allowed);
            }
            let postures = highest * f64::from(self.samples) / self.rate_hz;
            if family != Family::HandPaths && postures > MAX_POSTURES {
                let allowed = format!("at most {MAX_POSTURES} postures in a trajectory");
                violations.add(&field, format!("up to {postures:.0} postures"), allowed);
            }
        }
        if let Some(pulses) = &self.excitation.pulses {
            let Pulses { rise_periods, hold_periods, .. } = pulses.as_ref();
            let shortest =
                (2.0 * rise_periods.min + hold_periods.min) / pulses.frequency_hz.support().max;
            if shortest * self.rate_hz < 1.0 {
                violations.add(
                    "excitation.pulses.hold_periods",
                    format!("pulses down to {shortest} s"),
                    format!("at least {} s, the time between two samples", 1.0 / self.rate_hz),
                );
            }
        }
        if let Some(steps) = &self.excitation.steps {
            let shortest = steps.hold_periods.min / steps.frequency_hz.support().max;
            if shortest * self.rate_hz < 1.0 {
                violations.add(
                    "excitation.steps.hold_periods",
                    format!("down to {shortest} s"),
                    format!("at least {} s, the time between two samples", 1.0 / self.rate_hz),
                );
            }
        }
    }
}

impl Check for Excitation {
    fn check(&self, violations: &mut Violations) {
        violations.within("chirp_fraction", self.chirp_fraction, 0.0..=1.0);
        let families: Vec<(Family, &Frequency)> = Family::ALL
            .into_iter()
            .filter_map(|family| Some((family, self.frequency_hz(family)?)))
            .collect();
        if families.is_empty() {
            let allowed = "chirp, multisine, both, steps, or pulses; with a controller fourier, \
                           point_to_point, via_points or hand_paths";
            violations.add("chirp", "missing", allowed);
        }
        for (family, frequency) in &families {
            check_frequency(frequency, family.field(), violations);
        }
        if let Some(chirp) = &self.chirp {
            violations.part("chirp", chirp);
        }
        if let Some(multisine) = &self.multisine {
            violations.part("multisine", multisine);
        }
        if let Some(steps) = &self.steps {
            violations.part("steps", steps.as_ref());
        }
        if let Some(pulses) = &self.pulses {
            violations.part("pulses", pulses.as_ref());
        }
        if let Some(series) = &self.fourier {
            violations.part("fourier", series.as_ref());
        }
        if let Some(moves) = &self.point_to_point {
            violations.part("point_to_point", moves.as_ref());
        }
        if let Some(spline) = &self.via_points {
            violations.part("via_points", spline.as_ref());
        }
        if let Some(paths) = &self.hand_paths {
            violations.part("hand_paths", paths.as_ref());
        }
        let is_grid = |frequency: &Frequency| matches!(frequency, Frequency::Grid(_));
        let grids = families.iter().filter(|(_, frequency)| is_grid(frequency));
        if grids.clone().count() < families.len() {
            for (family, _) in grids {
                let field = format!("{}.frequency_hz.grid", family.field());
                let allowed = "a grid only when there is one family, or all have one";
                violations.add(&field, "a grid", allowed);
            }
            for (family, occurs) in
                [("steps", self.steps.is_some()), ("pulses", self.pulses.is_some())]
            {
                if occurs && families.len() > 1 {
                    let allowed = "no other family, or a grid for each";
                    violations.add(family, "beside another family", allowed);
                }
            }
        }
    }
}

fn check_frequency(frequency: &Frequency, family: &str, violations: &mut Violations) {
    let field = format!("{family}.frequency_hz");
    let allowed = 0.001..=500.0;
    match frequency {
        Frequency::Fixed(value) => violations.within(&format!("{field}.fixed"), *value, allowed),
        Frequency::Uniform(range) => {
            violations.interval(&format!("{field}.uniform"), *range, &allowed);
        }
        Frequency::Grid(grid) => {
            let field = format!("{field}.grid");
            violations.all_within(&field, grid, &allowed);
            if grid.is_empty() || grid.len() > MAX_GRID {
                violations.add(&field, format!("{} values", grid.len()), "1 to 200 frequencies");
            }
            if grid.windows(2).any(|pair| pair[0] >= pair[1]) {
                violations.add(&field, "unordered", "frequencies in rising order");
            }
        }
    }
}

impl Check for Chirp {
    fn check(&self, violations: &mut Violations) {
        violations.interval("amplitude_nm", self.amplitude_nm, &TORQUE_NM);
        violations.interval("offset_nm", self.offset_nm, &TORQUE_NM);
        violations.interval("phase_rad", self.phase_rad, &(-10.0..=10.0));
        violations.within("modulation_depth", self.modulation_depth, 0.0..=1.0);
        violations.within("torque_divisor", self.torque_divisor, FACTOR);
        violations.within("band_split_hz", self.band_split_hz, 0.0..=500.0);
        for (name, band) in [("low_band", self.low_band), ("high_band", self.high_band)] {
            violations.interval(&format!("{name}.f1"), band.f1, &FACTOR);
            violations.interval(&format!("{name}.f2"), band.f2, &FACTOR);
        }
    }
}

impl Chirp {
    fn highest_frequency_hz(&self) -> f64 {
        let factor = self.low_band.f1.max.max(self.high_band.f1.max);
        self.frequency_hz.support().max * factor * (1.0 + self.modulation_depth)
    }
}

impl Check for Multisine {
    fn check(&self, violations: &mut Violations) {
        violations.interval("amplitude_nm_per_hz", self.amplitude_nm_per_hz, &TORQUE_NM);
        violations.interval("base", self.base, &FACTOR);
        violations.all_within("multiples", &self.multiples, &FACTOR);
        violations.all_within("torque_divisor", &self.torque_divisor, &FACTOR);
    }
}

impl Multisine {
    fn highest_frequency_hz(&self) -> f64 {
        let multiple = self.multiples.iter().copied().fold(0.0, f64::max);
        self.frequency_hz.support().max * self.base.max * multiple
    }
}

impl Check for Steps {
    fn check(&self, violations: &mut Violations) {
        violations.interval("level_nm", self.level_nm, &TORQUE_NM);
        violations.interval("hold_periods", self.hold_periods, &FACTOR);
    }
}

impl Check for Pulses {
    fn check(&self, violations: &mut Violations) {
        violations.interval("level_nm", self.level_nm, &TORQUE_NM);
        let periods = 0.0..=100.0;
        violations.interval("rest_periods", self.rest_periods, &periods);
        violations.interval("rise_periods", self.rise_periods, &periods);
        violations.interval("hold_periods", self.hold_periods, &periods);
    }
}

impl Check for RobotSpec {
    fn check(&self, violations: &mut Violations) {
        violations.part("model", &self.model);
        let joints = self.joints();
        violations.one_per_joint("damping_nm_s_rad", &self.damping_nm_s_rad, joints);
        violations.one_per_joint("armature_kg_m2", &self.armature_kg_m2, joints);
        if let Some(friction) = &self.friction {
            violations.one_per_joint("friction.phi1_nm", &friction.phi1_nm, joints);
            violations.one_per_joint("friction.phi2_s_rad", &friction.phi2_s_rad, joints);
            violations.one_per_joint("friction.phi3_rad_s", &friction.phi3_rad_s, joints);
        }
        let fraction = 0.0..=0.9;
        violations.within("mass_fraction", self.mass_fraction, fraction.clone());
        violations.within("com_fraction", self.com_fraction, fraction.clone());
        violations.within("inertia_fraction", self.inertia_fraction, fraction.clone());
        violations.within("damping_fraction", self.damping_fraction, fraction.clone());
        violations.within("armature_fraction", self.armature_fraction, fraction);
        violations.within("geometry_fraction", self.geometry_fraction, 0.0..=0.5);
        violations.all_within("damping_nm_s_rad", &self.damping_nm_s_rad, &DAMPING_NM_S_RAD);
        violations.all_within("armature_kg_m2", &self.armature_kg_m2, &ARMATURE_KG_M2);
        if let Some(friction) = &self.friction {
            violations.part("friction", friction);
        }
        if let Some(payload) = &self.payload {
            violations.part("payload", payload);
        }
    }
}

impl Check for Friction {
    fn check(&self, violations: &mut Violations) {
        violations.all_within("phi1_nm", &self.phi1_nm, &PHI1_NM);
        violations.all_within("phi2_s_rad", &self.phi2_s_rad, &PHI2_S_RAD);
        violations.all_within("phi3_rad_s", &self.phi3_rad_s, &PHI3_RAD_S);
        violations.within("phi1_fraction", self.phi1_fraction, 0.0..=0.9);
    }
}

impl Check for Payload {
    fn check(&self, violations: &mut Violations) {
        violations.interval("mass_kg", self.mass_kg, &(0.0..=50.0));
        for (axis, range) in ["x", "y", "z"].into_iter().zip(self.center_m) {
            violations.interval(&format!("center_m.{axis}"), range, &(-1.0..=1.0));
        }
        violations.interval("radius_m", self.radius_m, &(0.001..=1.0));
    }
}

impl Check for Rejection {
    fn check(&self, violations: &mut Violations) {
        if let Some(margin) = self.position_margin_rad {
            violations.within("position_margin_rad", margin, 0.0..=1.0);
        }
        violations.within("max_draws", self.max_draws, 1..=100_000);
    }
}

impl Check for Integrator {
    fn check(&self, violations: &mut Violations) {
        match self {
            Self::Extrapolated { order, substeps } => {
                violations.within("order", *order, 1..=4);
                violations.within("substeps", *substeps, 1..=MAX_SUBSTEPS);
            }
            Self::Rk4 { substeps } | Self::Midpoint { substeps } => {
                violations.within("substeps", *substeps, 1..=MAX_SUBSTEPS);
            }
            Self::Reference => {}
        }
    }
}
