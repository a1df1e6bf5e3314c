//! The first parts of a horizon, over which errors are measured as well.

/// The first part of a horizon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorHorizon {
    /// Its length, s.
    pub seconds: f64,
    /// Its length in samples, at least 1.
    pub samples: usize,
}

impl ErrorHorizon {
    /// The first parts of a horizon of `horizon` samples, with the lengths `seconds`. A length
    /// below a sample becomes a sample, and one above the horizon becomes the horizon. A part
    /// occurs once.
    pub fn all(seconds: &[f64], rate_hz: f64, horizon: usize) -> Vec<Self> {
        let mut parts: Vec<Self> = Vec::new();
        for &seconds in seconds {
            let samples = nearest_whole(seconds * rate_hz).clamp(1, horizon.max(1));
            let fits = samples as f64 == (seconds * rate_hz).round();
            let seconds = if fits { seconds } else { samples as f64 / rate_hz };
            if parts.iter().all(|part| part.samples != samples) {
                parts.push(Self { seconds, samples });
            }
        }
        parts
    }

    /// The name of its column in the table of scenarios, in whole milliseconds:
    /// `rmse_100_ms_deg`.
    pub fn column(seconds: f64) -> String {
        format!("rmse_{:.0}_ms_deg", 1e3 * seconds)
    }
}

/// The nearest whole number of samples.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast saturates, and lengths are not negative"
)]
pub(crate) fn nearest_whole(samples: f64) -> usize {
    samples.round() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_clipped_to_the_horizon_and_occur_once() {
        let parts = |seconds: &[f64], horizon| -> Vec<(f64, usize)> {
            let all = ErrorHorizon::all(seconds, 60.0, horizon);
            all.into_iter().map(|part| (part.seconds, part.samples)).collect()
        };
        assert_eq!(parts(&[0.1, 0.5, 1.33], 80), [(0.1, 6), (0.5, 30), (1.33, 80)]);
        assert_eq!(parts(&[0.1, 0.5, 1.33], 36), [(0.1, 6), (0.5, 30), (0.6, 36)]);
        assert_eq!(parts(&[0.5, 1.33, 0.001], 6), [(0.1, 6), (1.0 / 60.0, 1)]);
        assert_eq!(parts(&[], 6), []);
    }

    #[test]
    fn columns_have_whole_milliseconds() {
        let columns = [0.1, 1.33, 1.0 / 60.0].map(ErrorHorizon::column);
        assert_eq!(columns, ["rmse_100_ms_deg", "rmse_1330_ms_deg", "rmse_17_ms_deg"]);
    }
}
