//! The delay of a channel: the shift at which its torques fit the arm's best.

use wire::Measurement;

/// The largest delay that is looked for, s. Motions leave [`crate::motion::UNCERTAIN_S`] at their
/// ends, so that shifted torques are known.
pub const LARGEST_S: f64 = 0.2;

/// A first look has steps of 10 ms, a fraction of the fastest motion's period.
const STEPS: i32 = 20;
const STEP_S: f64 = LARGEST_S / STEPS as f64;

/// A delay is told if all others but its neighbours cost this much more: a likelihood of 400 to 1.
const CLEARLY: f64 = 6.0;

/// Less than this share of a sample is never told.
const LEAST_SHARE: f64 = 0.05;

/// A delay with a larger standard deviation is not told, s; samples of a slower log are longer.
const LARGEST_DEVIATION_S: f64 = 4e-3;
const LARGEST_DEVIATION_SAMPLES: f64 = 0.25;

/// Why a delay is not told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// The motion is too slow or too small.
    Flat,
    /// There are two that fit.
    Ambiguous,
    /// It is larger than [`LARGEST_S`], or torques fit at none.
    Beyond,
    /// Torques are cut off.
    Cut,
}

/// The least cost of a first look is at this shift, s.
pub fn nearest_s(cost: impl Fn(f64) -> f64) -> f64 {
    let looks = shifts_s().map(|later_s| (later_s, cost(later_s)));
    looks.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |(later_s, _)| later_s)
}

fn shifts_s() -> impl Iterator<Item = f64> {
    (-STEPS..=STEPS).map(|step| f64::from(step) * STEP_S)
}

/// The shift with the least cost, and its standard deviation. `cost` is half of the misfit's
/// squares, weighted by the noise, if torques are taken so many seconds later.
pub fn find(cost: impl Fn(f64) -> f64, period_s: f64) -> Result<Measurement, Unknown> {
    let looks: Vec<(f64, f64)> = shifts_s().map(|later_s| (later_s, cost(later_s))).collect();
    let Some(&(mut best_s, least)) = looks.iter().min_by(|a, b| a.1.total_cmp(&b.1)) else {
        return Err(Unknown::Flat);
    };
    let is_rival = |triple: &[(f64, f64)]| {
        let is_lowest = triple[1].1 <= triple[0].1 && triple[1].1 <= triple[2].1;
        is_lowest && triple[1].1 < least + CLEARLY && (triple[1].0 - best_s).abs() > 1.5 * STEP_S
    };
    let is_ambiguous = looks.windows(3).any(is_rival);

    // Parabolas through three shifts, which come closer to each other.
    let mut curvature = 0.0;
    for step_s in [STEP_S, 0.5 * STEP_S, 0.2 * STEP_S, 0.2 * STEP_S] {
        let [before, at, after] = [-step_s, 0.0, step_s].map(|more| cost(best_s + more));
        curvature = (before - 2.0 * at + after) / (step_s * step_s);
        if curvature.is_nan() || curvature <= 0.0 {
            return Err(Unknown::Flat);
        }
        best_s += ((before - after) / (2.0 * step_s * curvature)).clamp(-step_s, step_s);
    }
    let deviation = (1.0 / curvature).sqrt().hypot(LEAST_SHARE * period_s);
    let largest = LARGEST_DEVIATION_S.max(LARGEST_DEVIATION_SAMPLES * period_s);
    if !deviation.is_finite() || deviation > largest {
        return Err(Unknown::Flat);
    }
    if best_s.abs() > LARGEST_S - STEP_S {
        return Err(Unknown::Beyond);
    }
    if is_ambiguous {
        return Err(Unknown::Ambiguous);
    }
    Ok(Measurement { value: best_s, deviation })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_point_of_a_curve_is_found_or_it_is_said_why_not() {
        let parabola = |center: f64, width: f64| {
            move |later_s: f64| 7.0 + 0.5 * ((later_s - center) / width).powi(2)
        };
        let found = find(parabola(0.0337, 1e-3), 0.002).unwrap();
        assert!((found.value - 0.0337).abs() < 1e-9 && (found.deviation - 1e-3).abs() < 1e-4);
        assert_eq!(find(parabola(0.0, 0.1), 0.002), Err(Unknown::Flat));
        assert_eq!(find(|_| 1.0, 0.002), Err(Unknown::Flat));
        assert_eq!(find(|_| f64::NAN, 0.002), Err(Unknown::Flat));
        assert_eq!(find(parabola(0.3, 1e-3), 0.002), Err(Unknown::Beyond));
        let waves = |later_s: f64| 1e4 * (1.0 - (later_s * 62.8).cos());
        assert_eq!(find(waves, 0.002), Err(Unknown::Ambiguous));
    }
}
