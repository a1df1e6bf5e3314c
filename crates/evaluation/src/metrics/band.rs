//! The band of an excitation.

use std::f64::consts::TAU;

use series::SeriesView;
use spec::{Excitation, Family};

use crate::metrics::jitter::Spectrum;

/// The highest frequency in torques of `family` with master frequency `frequency_hz` during
/// `duration_s`, for any draw. `None` for steps, for references, and when the excitation has no such family.
///
/// For a chirp it is its highest instantaneous frequency. This grows with time because the phase is
/// multiplied by time: d/dt f1 (1 + d cos 2π f2 t) t ≤ f1 (1 + d √(1 + (2π f2 t)²)).
pub fn highest_component_hz(
    excitation: &Excitation,
    family: Family,
    frequency_hz: f64,
    duration_s: f64,
) -> Option<f64> {
    match family {
        Family::Multisine => {
            let law = excitation.multisine.as_ref()?;
            let multiple = law.multiples.iter().copied().fold(0.0, f64::max);
            Some(frequency_hz * law.base.max * multiple)
        }
        Family::Chirp => {
            let law = excitation.chirp.as_ref()?;
            let band = if frequency_hz < law.band_split_hz { law.low_band } else { law.high_band };
            let turned = TAU * frequency_hz * band.f2.max * duration_s;
            let deviation = law.modulation_depth * 1.0_f64.hypot(turned);
            Some(frequency_hz * band.f1.max * (1.0 + deviation))
        }
        // Jumps have components of all frequencies, and the torques of a controller those of its
        // noise.
        Family::Steps
        | Family::Pulses
        | Family::Fourier
        | Family::PointToPoint
        | Family::ViaPoints
        | Family::HandPaths => None,
    }
}

/// The frequency below which 99.9 % of the torques' power lies, over all joints and scenarios. It
/// is for excitations that are not known. `None` without any power.
pub fn occupied_band_hz(scenarios: &SeriesView<'_>) -> Option<f64> {
    const SHARE: f64 = 0.999;

    let spectrum = Spectrum::new(scenarios.samples(), 0.0, scenarios.rate_hz())?;
    let mut power = vec![0.0; spectrum.bins_hz().len()];
    for robot in 0..scenarios.robots() {
        for joint in 0..scenarios.joints() {
            let torque: Vec<f64> = scenarios.u(robot).joint(joint).map(f64::from).collect();
            for (sum, of_bin) in power.iter_mut().zip(spectrum.power(&torque)) {
                *sum += of_bin;
            }
        }
    }
    let total: f64 = power.iter().sum();
    let mut below = 0.0;
    let found = power.iter().position(|of_bin| {
        below += of_bin;
        below >= SHARE * total
    });
    found.filter(|_| total > 0.0).map(|bin| spectrum.bins_hz()[bin])
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use series::{Series, Shape};

    use super::*;

    /// Joints of the Panda.
    const JOINTS: usize = 7;

    #[test]
    fn the_band_of_a_multisine_is_its_highest_multiple() {
        let excitation: Excitation =
            serde_json::from_value(json!({"multisine": {"frequency_hz": {"fixed": 0.2}}})).unwrap();
        let highest = highest_component_hz(&excitation, Family::Multisine, 0.2, 6.0).unwrap();
        assert!((highest - 0.2 * 1.5 * 3.0).abs() < 1e-12);
        assert_eq!(highest_component_hz(&excitation, Family::Chirp, 0.2, 6.0), None);
    }

    #[test]
    fn no_chirp_is_ever_faster_than_its_band() {
        let excitation: Excitation =
            serde_json::from_value(json!({"chirp": {"frequency_hz": {"fixed": 0.5}}})).unwrap();
        let chirp = excitation.chirp.clone().unwrap();
        let (f1, f2) = (0.5 * chirp.high_band.f1.max, 0.5 * chirp.high_band.f2.max);
        let cycles = |t: f64| f1 * (1.0 + chirp.modulation_depth * (TAU * f2 * t).cos()) * t;
        let duration = 20.0;
        let h = 1e-5;
        let fastest = (0..200_000)
            .map(|k| f64::from(k) * duration / 200_000.0)
            .map(|t| ((cycles(t + h) - cycles(t)) / h).abs())
            .fold(0.0, f64::max);
        let band = highest_component_hz(&excitation, Family::Chirp, 0.5, duration).unwrap();
        assert!(fastest <= band + 1e-3 && fastest > 0.9 * band, "{fastest} {band}");
    }

    #[test]
    fn the_band_of_unknown_torques_is_that_of_their_fastest_tone() {
        let tone = |k: usize, hz: f64| (TAU * hz * k as f64 / 60.0).sin();
        #[expect(clippy::cast_possible_truncation, reason = "torques in f32")]
        let u: Vec<f32> = (0..400)
            .flat_map(|k| {
                std::array::from_fn::<f32, JOINTS, _>(|joint| {
                    (tone(k, 0.5) + if joint == 3 { tone(k, 4.0) } else { 0.0 }) as f32
                })
            })
            .collect();
        let series = |u: Vec<f32>| {
            let shape = Shape { robots: 1, samples: 400, joints: JOINTS };
            Series::new(shape, 60.0, u.clone(), u).unwrap()
        };
        let band = occupied_band_hz(&series(u).view()).unwrap();
        assert!((4.0..4.5).contains(&band), "{band}");
        assert_eq!(occupied_band_hz(&series(vec![0.0; 400 * JOINTS]).view()), None);
    }
}
