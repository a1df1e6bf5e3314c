//! The settings of an excitation, and what is allowed.

use super::error::ExcitationError;
use super::steps::Steps;
use crate::motion::whole;

/// The settings of an excitation.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationSettings {
    /// The length of the motion, s: 5 to 600.
    pub seconds: f64,
    /// One over the period, Hz. The motion has a whole number of periods. `None` takes periods of at
    /// most 30 s.
    pub base_frequency_hz: Option<f64>,
    /// Sines and cosines of each joint, 2 to 30, up to 4 Hz. `None` takes as many as reach
    /// 0.5 Hz, but 5 to 15.
    pub harmonics: Option<usize>,
    /// The share of every limit that stays free, 0 to 0.9.
    pub margin: f64,
    /// The height of a table in the world, m. The origins of the joints from the third on and of the
    /// hand stay above it.
    pub table_z_m: Option<f64>,
    /// The least height of these origins over the table, m.
    pub clearance_m: f64,
    /// Limits of the accelerations, rad/s². `None` lets joints reach their highest speed in half a
    /// second.
    pub accelerations_rad_s2: Option<Vec<f64>>,
    /// Standard deviation of what the arm's parameters cannot explain of each torque, N·m, after a
    /// low-pass, independent at 25 samples per second. `None` takes
    /// 0.5 % of the rated torques.
    pub noise_nm: Option<Vec<f64>>,
    /// Standard deviation of the torques' gains around 1, as for an identification.
    pub gain_deviation: f64,
    /// Random motions, of which the best are improved: at least 1.
    pub random_motions: usize,
}

/// The frequency of the highest harmonic, Hz.
pub(crate) const USUAL_BANDWIDTH_HZ: f64 = 0.5;
/// No harmonic is faster, because an identification's low-pass takes such motions away, Hz.
const HIGHEST_HZ: f64 = 4.0;
/// Unexplained torque as a share of the rated torque.
pub(crate) const USUAL_NOISE: f64 = 0.005;
/// The longest period, s.
const LONGEST_PERIOD_S: f64 = 30.0;

impl Default for ExcitationSettings {
    fn default() -> Self {
        Self {
            seconds: 20.0,
            base_frequency_hz: None,
            harmonics: None,
            margin: 0.1,
            table_z_m: None,
            clearance_m: 0.1,
            accelerations_rad_s2: None,
            noise_nm: None,
            gain_deviation: 0.0,
            random_motions: 64,
        }
    }
}

impl ExcitationSettings {
    /// One over the period, Hz.
    pub fn base_frequency_hz(&self) -> f64 {
        let periods = (self.seconds / LONGEST_PERIOD_S).ceil();
        self.base_frequency_hz.unwrap_or(periods / self.seconds)
    }

    /// Sines and cosines of each joint.
    pub fn harmonics(&self) -> usize {
        let usual = whole(USUAL_BANDWIDTH_HZ / self.base_frequency_hz());
        self.harmonics.unwrap_or(usual.clamp(5, 15))
    }

    /// The most steps of the search.
    pub const fn steps(&self) -> u64 {
        Steps::most(self.random_motions)
    }

    /// Checks what does not depend on the arm.
    ///
    /// # Errors
    /// [`ExcitationError::Setting`].
    pub fn check(&self) -> Result<(), ExcitationError> {
        const WHOLE: f64 = 1e-6;

        let setting = |name, value: f64, least: f64, most: f64, unit: &str| {
            if (least..=most).contains(&value) {
                return Ok(());
            }
            let allowed = format!("{least} to {most}{unit}");
            Err(ExcitationError::Setting { name, value, allowed })
        };
        setting("--seconds", self.seconds, 5.0, 600.0, " s")?;
        let base_hz = self.base_frequency_hz();
        setting("--base-frequency", base_hz, 1.0 / self.seconds, 0.5, " Hz")?;
        let periods = self.seconds * base_hz;
        if (periods - periods.round()).abs() > WHOLE * periods {
            let usual_hz = periods.round() / self.seconds;
            return Err(ExcitationError::Setting {
                name: "--base-frequency",
                value: base_hz,
                allowed: format!(
                    "a whole number of periods in {} s, such as {usual_hz} Hz, so that the motion ends at rest",
                    self.seconds
                ),
            });
        }
        let most = (HIGHEST_HZ / base_hz).floor().min(30.0);
        setting("--harmonics", self.harmonics() as f64, 2.0, most, "")?;
        setting("--margin", self.margin, 0.0, 0.9, "")?;
        setting("--table-z", self.table_z_m.unwrap_or(0.0), -100.0, 100.0, " m")?;
        setting("--clearance", self.clearance_m, 0.0, 10.0, " m")?;
        setting("--gain-deviation", self.gain_deviation, 0.0, 1.0, "")?;
        setting("random_motions", self.random_motions as f64, 1.0, 10_000.0, "")
    }

    pub(crate) fn check_lists(&self, joints: usize) -> Result<(), ExcitationError> {
        for (name, values) in
            [("--accelerations", &self.accelerations_rad_s2), ("--noise-nm", &self.noise_nm)]
        {
            let (least, most) = (1e-6, 1e5);
            let Some(values) = values else { continue };
            if values.len() != joints {
                let found = values.len();
                return Err(ExcitationError::Count { name, found, joints });
            }
            for (joint, &value) in (1..).zip(values) {
                if !(least..=most).contains(&value) {
                    return Err(ExcitationError::OfJoint { name, joint, value, least, most });
                }
            }
        }
        Ok(())
    }
}
