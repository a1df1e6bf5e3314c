//! The uses of a recording, which settle some doubts themselves.

use wire::Measurement;

/// How far a scale must be from 1 or from a unit's, in standard deviations.
pub const CLEAR: f64 = 3.0;

/// How far a torque may be beyond its limit, as a share of it.
pub const BEYOND: f64 = 1.1;

/// The use of a recording.
#[derive(Clone, Copy)]
pub enum Purpose {
    Import,
    /// Gains have this standard deviation around 1, and a delay of the torques is found up to this, s.
    Identification {
        gain_deviation: f64,
        most_delay_s: f64,
    },
    /// The same with a load in the hand, which is found.
    Load {
        gain_deviation: f64,
        most_delay_s: f64,
    },
}

impl Purpose {
    /// Whether a scale of the torques is found later.
    pub fn finds_scale(self, size: f64) -> bool {
        match self {
            Self::Import => false,
            Self::Identification { gain_deviation, .. } | Self::Load { gain_deviation, .. } => {
                size.ln().abs() < CLEAR * gain_deviation
            }
        }
    }

    /// The share of a limit from which a torque is doubtful. A gain may be off.
    pub fn doubtful_torque(self) -> f64 {
        match self {
            Self::Import => BEYOND,
            Self::Identification { gain_deviation, .. } | Self::Load { gain_deviation, .. } => {
                BEYOND * (CLEAR * gain_deviation).exp()
            }
        }
    }

    /// Whether a delay is found later.
    pub fn finds_delay(self, delay: &Measurement) -> bool {
        match self {
            Self::Import => false,
            Self::Identification { most_delay_s, .. } | Self::Load { most_delay_s, .. } => {
                delay.value.abs() < most_delay_s
            }
        }
    }

    /// Whether a load in the hand is expected.
    pub const fn has_load(self) -> bool {
        matches!(self, Self::Load { .. })
    }

    /// The name of the field with gains.
    pub const fn gains(self) -> &'static str {
        match self {
            Self::Import => "columns.gains",
            Self::Identification { .. } | Self::Load { .. } => "gains",
        }
    }
}
