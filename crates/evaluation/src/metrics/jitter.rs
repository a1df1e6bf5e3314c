//! Motion above the band of the excitation.

use std::f64::consts::TAU;

use series::LowPass;

/// The frequency above which the power of a prediction is jitter, Hz. It is 1.5 times the signal's
/// highest component, and at least that component plus the width by which a series as short as the
/// horizon smears it.
///
/// `None` if less than a tenth of all frequencies lies above.
pub fn band_edge_hz(highest_component_hz: f64, horizon: usize, rate_hz: f64) -> Option<f64> {
    // Half width of the main lobe of the Hann window, in bins.
    const LOBE: f64 = 2.0;

    let resolution = rate_hz / horizon as f64;
    let edge = (1.5 * highest_component_hz).max(highest_component_hz + LOBE * resolution);
    let largest = 0.9 * 0.5 * rate_hz;
    (edge > 0.0 && edge <= largest).then_some(edge)
}

/// Measures the power of series above a frequency, before and after a low-pass at this frequency.
pub(crate) struct JitterMeter {
    spectrum: Spectrum,
    low_pass: LowPass,
}

impl JitterMeter {
    /// A meter for series of `samples` values. `None` if no frequency lies above the edge, or if
    /// the series is too short for the filter.
    pub fn new(samples: usize, edge_hz: f64, rate_hz: f64) -> Option<Self> {
        let low_pass = LowPass::new(edge_hz, rate_hz)?;
        low_pass.apply(&vec![0.0; samples])?;
        Some(Self { spectrum: Spectrum::new(samples, edge_hz, rate_hz)?, low_pass })
    }

    /// Root mean square of the part above the edge, in the unit of `series`.
    pub fn jitter(&self, series: &[f64]) -> f64 {
        self.spectrum.power(series).sum::<f64>().sqrt()
    }

    /// The series without the part above the edge.
    pub fn smoothed(&self, series: &[f64]) -> Vec<f64> {
        self.low_pass.apply(series).unwrap_or_else(|| series.to_vec())
    }
}

/// Power per frequency of series of one length, after removing the straight-line trend and through
/// a Hann window (Welch 1967, with a single segment).
pub(super) struct Spectrum {
    window: Vec<f64>,
    bins: Vec<Bin>,
    bins_hz: Vec<f64>,
}

struct Bin {
    /// Turns per sample.
    step: f64,
    /// Factor from the square of the transform to power. The bin also counts for its negative
    /// frequency.
    scale: f64,
}

impl Spectrum {
    /// The bins from `edge_hz` up. `None` when there are none, or fewer than four samples.
    pub(super) fn new(samples: usize, edge_hz: f64, rate_hz: f64) -> Option<Self> {
        if samples < 4 {
            return None;
        }
        let window: Vec<f64> = (0..samples)
            .map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / samples as f64).cos())
            .collect();
        let power: f64 = window.iter().map(|w| w * w).sum();
        let (mut bins, mut bins_hz) = (Vec::new(), Vec::new());
        for k in 1..=samples / 2 {
            let frequency = k as f64 * rate_hz / samples as f64;
            if frequency < edge_hz {
                continue;
            }
            let sides = if 2 * k == samples { 1.0 } else { 2.0 };
            let step = k as f64 / samples as f64;
            bins.push(Bin { step, scale: sides / (samples as f64 * power) });
            bins_hz.push(frequency);
        }
        (!bins.is_empty()).then_some(Self { window, bins, bins_hz })
    }

    pub(super) fn bins_hz(&self) -> &[f64] {
        &self.bins_hz
    }

    /// Mean square of the part of `series` in each bin.
    pub(super) fn power(&self, series: &[f64]) -> impl Iterator<Item = f64> {
        let windowed = self.windowed(series);
        self.bins.iter().map(move |bin| {
            // Goertzel's recurrence needs one multiplication per sample.
            let double_cos = 2.0 * (TAU * bin.step).cos();
            let (mut last, mut before) = (0.0, 0.0);
            for x in &windowed {
                (last, before) = (x + double_cos * last - before, last);
            }
            bin.scale * (last * last + before * before - double_cos * last * before).max(0.0)
        })
    }

    fn windowed(&self, series: &[f64]) -> Vec<f64> {
        let count = series.len() as f64;
        let middle = 0.5 * (count - 1.0);
        let mean = series.iter().sum::<f64>() / count;
        let (mut products, mut squares) = (0.0, 0.0);
        for (k, x) in series.iter().enumerate() {
            let at = k as f64 - middle;
            products += at * x;
            squares += at * at;
        }
        let slope = products / squares;
        let trend = |k: usize| mean + slope * (k as f64 - middle);
        series.iter().zip(&self.window).enumerate().map(|(k, (x, w))| w * (x - trend(k))).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const RATE: f64 = 60.0;
    const STEPS: usize = 80;

    fn tone(amplitude: f64, hz: f64, phase: f64) -> Vec<f64> {
        (0..STEPS).map(|k| amplitude * (TAU * hz * k as f64 / RATE + phase).sin()).collect()
    }

    proptest! {
        #[test]
        fn a_pure_tone_above_the_edge_is_its_own_root_mean_square(
            amplitude in 0.01..10.0f64, hz in 8.0..26.0f64, phase in 0.0..TAU,
            offset in -90.0..90.0f64, slope in -2.0..2.0f64,
        ) {
            let meter = JitterMeter::new(STEPS, 5.0, RATE).unwrap();
            let mut series = tone(amplitude, hz, phase);
            for (k, x) in series.iter_mut().enumerate() {
                *x += offset + slope * k as f64;
            }
            let expected = amplitude / 2.0_f64.sqrt();
            prop_assert!((meter.jitter(&series) / expected - 1.0).abs() < 0.03);
            // The edge is well below, so nearly all of the jitter is removed. At its beginning, the
            // filter bends the line by less than a thousandth of the slope.
            let smoothed = meter.smoothed(&series);
            prop_assert!(meter.jitter(&smoothed) < 0.12 * expected + 1e-3 * slope.abs());
        }

        #[test]
        fn a_slow_motion_has_no_jitter_and_passes_the_filter(
            hz in 0.05..1.0f64, phase in 0.0..TAU,
        ) {
            let edge = band_edge_hz(1.0, STEPS, RATE).unwrap();
            let meter = JitterMeter::new(STEPS, edge, RATE).unwrap();
            let series = tone(1.0, hz, phase);
            prop_assert!(meter.jitter(&series) < 0.03);
            let smoothed = meter.smoothed(&series);
            let worst = smoothed.iter().zip(&series).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            prop_assert!(worst < 0.08, "{}", worst);
        }

        #[test]
        fn all_bins_together_hold_the_windowed_power(
            series in proptest::collection::vec(-1.0..1.0f64, STEPS),
        ) {
            let spectrum = Spectrum::new(STEPS, 0.0, RATE).unwrap();
            let windowed = spectrum.windowed(&series);
            let constant = windowed.iter().sum::<f64>().powi(2) / STEPS as f64;
            let squares = windowed.iter().map(|x| x * x).sum::<f64>() - constant;
            let weight: f64 = spectrum.window.iter().map(|w| w * w).sum();
            let power: f64 = spectrum.power(&series).sum();
            prop_assert!((power - squares / weight).abs() < 1e-9);
        }
    }

    #[test]
    fn a_band_that_leaves_nothing_above_has_no_jitter() {
        assert_eq!(band_edge_hz(25.0, STEPS, RATE), None);
        assert!(band_edge_hz(10.0, STEPS, RATE).is_some());
        assert!(JitterMeter::new(15, 5.0, RATE).is_none());
        assert!(JitterMeter::new(STEPS, 30.0, RATE).is_none());
    }
}
