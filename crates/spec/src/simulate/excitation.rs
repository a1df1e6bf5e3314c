//! The excitations of arms: torques (chirps, multisines and steps), or references of a controller,
//! with their frequencies and defaults.

use std::f64::consts::PI;
use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::references::{FourierSeries, HandPaths, PointToPointMoves, ViaPoints};
use crate::Range;

/// The torques that excite the arm, or the references that its controller follows. Each joint's
/// are drawn independently.
///
/// With both chirps and multisines, each trajectory draws one of them: `chirp` with probability
/// `chirp_fraction`, and otherwise `multisine`. If their frequencies are grids, the grids decide.
/// Steps and pulses stand alone, or beside other families if all have a grid. With several families of
/// references, each trajectory draws one of them, all with the same probability.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Excitation {
    /// Signals whose frequency changes. `null` for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chirp: Option<Chirp>,
    /// Sums of four sines. `null` for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub multisine: Option<Multisine>,
    /// Torques that jump. `null` for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<Box<Steps>>,
    /// Pulses of torque with rests in between. `null` for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulses: Option<Box<Pulses>>,
    /// References that are Fourier series. `null` for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fourier: Option<Box<FourierSeries>>,
    /// References that move from posture to posture. `null` for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point_to_point: Option<Box<PointToPointMoves>>,
    /// References that pass by postures without a stop. `null` for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub via_points: Option<Box<ViaPoints>>,
    /// References that follow from paths of the hand. `null` for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hand_paths: Option<Box<HandPaths>>,
    /// The probability of a chirp, 0 to 1, if there are multisines, too.
    #[serde(default = "half")]
    pub chirp_fraction: f64,
}

const fn half() -> f64 {
    0.5
}

/// The shape of an excitation signal.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Family {
    /// A signal whose frequency changes.
    Chirp,
    /// A sum of four sines.
    Multisine,
    /// Torques that jump.
    Steps,
    /// Pulses of torque.
    Pulses,
    /// A reference that is a Fourier series.
    Fourier,
    /// A reference that moves from posture to posture.
    PointToPoint,
    /// A reference that passes by postures.
    ViaPoints,
    /// A reference that follows from a path of the hand.
    HandPaths,
}

impl Family {
    /// In the order of grids, tables and figures.
    pub const ALL: [Self; 8] = [
        Self::Chirp,
        Self::Multisine,
        Self::Steps,
        Self::Pulses,
        Self::Fourier,
        Self::PointToPoint,
        Self::ViaPoints,
        Self::HandPaths,
    ];

    /// Whether a controller follows it. Otherwise it is a torque.
    pub const fn is_reference(self) -> bool {
        match self {
            Self::Chirp | Self::Multisine | Self::Steps | Self::Pulses => false,
            Self::Fourier | Self::PointToPoint | Self::ViaPoints | Self::HandPaths => true,
        }
    }

    /// Its field in an [`Excitation`].
    pub const fn field(self) -> &'static str {
        match self {
            Self::Chirp => "chirp",
            Self::Multisine => "multisine",
            Self::Steps => "steps",
            Self::Pulses => "pulses",
            Self::Fourier => "fourier",
            Self::PointToPoint => "point_to_point",
            Self::ViaPoints => "via_points",
            Self::HandPaths => "hand_paths",
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Chirp => "chirp",
            Self::Multisine => "multisine",
            Self::Steps => "steps",
            Self::Pulses => "pulses",
            Self::Fourier => "fourier",
            Self::PointToPoint => "point-to-point",
            Self::ViaPoints => "via-points",
            Self::HandPaths => "hand-paths",
        })
    }
}

/// The master frequency f of a trajectory; each joint's frequencies are drawn around it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Frequency {
    /// The same for all trajectories.
    Fixed(f64),
    /// Drawn uniformly for each trajectory.
    Uniform(Range),
    /// Equal contiguous blocks of trajectories, one per frequency. With several families, either
    /// all have a grid or none has. Blocks have the order of the families.
    Grid(Vec<f64>),
}

impl Frequency {
    /// The interval of possible master frequencies. It defines "in distribution".
    pub fn support(&self) -> Range {
        match self {
            Self::Fixed(f) => Range::new(*f, *f),
            Self::Uniform(range) => *range,
            Self::Grid(grid) => Range::new(
                grid.iter().copied().fold(f64::INFINITY, f64::min),
                grid.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ),
        }
    }
}

/// u(t) = (o + s·a·cos(2π f1 (1 + d·cos(2π f2 t)) t + φ)) / torque_divisor.
///
/// As the paper prints it, the phase is multiplied by t, so the instantaneous frequency grows with
/// t. Offset, sign and divisor come from the paper's code, not from its text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Chirp {
    /// f, the master frequency.
    pub frequency_hz: Frequency,
    /// a, in N·m.
    #[serde(default = "chirp::amplitude_nm")]
    pub amplitude_nm: Range,
    /// o, in N·m.
    #[serde(default = "chirp::offset_nm")]
    pub offset_nm: Range,
    /// φ, in rad.
    #[serde(default = "chirp::phase_rad")]
    pub phase_rad: Range,
    /// d.
    #[serde(default = "chirp::modulation_depth")]
    pub modulation_depth: f64,
    /// Whether s is ±1 with equal probability; otherwise s = 1.
    #[serde(default = "yes")]
    pub random_sign: bool,
    /// The divisor of every torque.
    #[serde(default = "chirp::torque_divisor")]
    pub torque_divisor: f64,
    /// The end of `low_band` and the beginning of `high_band`, in Hz of the master frequency.
    #[serde(default = "chirp::band_split_hz")]
    pub band_split_hz: f64,
    /// The intervals for master frequencies below `band_split_hz`.
    #[serde(default = "chirp::low_band")]
    pub low_band: ChirpBand,
    /// The intervals for the other master frequencies.
    #[serde(default = "chirp::high_band")]
    pub high_band: ChirpBand,
}

/// The intervals of f1 and f2 as multiples of the master frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ChirpBand {
    /// Interval of f1.
    pub f1: Range,
    /// Interval of f2.
    pub f2: Range,
}

/// u(t) = s·(a0 sin ωt + a1 cos m1ωt + a2 sin m2ωt + s'·a3 cos m3ωt) / torque_divisor, with ω =
/// 2π·f·c. c is drawn from `base`, and m0 = 1 in the default `multiples`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Multisine {
    /// f, the master frequency.
    pub frequency_hz: Frequency,
    /// Interval of every a, in N·m per Hz of the master frequency.
    #[serde(default = "multisine::amplitude_nm_per_hz")]
    pub amplitude_nm_per_hz: Range,
    /// Interval of c.
    #[serde(default = "multisine::base")]
    pub base: Range,
    /// m0 to m3.
    #[serde(default = "multisine::multiples")]
    #[schema(min_items = 4, max_items = 4)]
    pub multiples: [f64; 4],
    /// Whether s and s' are ±1 with equal probability; otherwise they are 1.
    #[serde(default = "yes")]
    pub random_sign: bool,
    /// κ of each joint.
    #[serde(default = "multisine::torque_divisor")]
    pub torque_divisor: Vec<f64>,
}

/// Torques that jump. Each joint's torque is held at one of eight levels after the other, and then
/// begins again with the first. Every level and its duration is drawn independently.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Steps {
    /// The master frequency, whose period is the unit of `hold_periods`.
    pub frequency_hz: Frequency,
    /// Interval of every level, in N·m.
    #[serde(default = "steps::level_nm")]
    pub level_nm: Range,
    /// Interval of a level's duration, in periods of the master frequency.
    #[serde(default = "steps::hold_periods")]
    pub hold_periods: Range,
}

/// Trapezoids of torque with rests in between. Each joint has four pulses, one after the other, and
/// then begins again with the first. The levels and durations of every pulse are drawn
/// independently. Short pulses are impulses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Pulses {
    /// The master frequency, whose period is the unit of the durations.
    pub frequency_hz: Frequency,
    /// Interval of every level, in N·m.
    #[serde(default = "pulses::level_nm")]
    pub level_nm: Range,
    /// Interval of the rest before a pulse, in periods of the master frequency.
    #[serde(default = "pulses::rest_periods")]
    pub rest_periods: Range,
    /// Interval of the time in which a pulse rises, and of that in which it falls again.
    #[serde(default = "pulses::rise_periods")]
    pub rise_periods: Range,
    /// Interval of the time for which the level is held.
    #[serde(default = "pulses::hold_periods")]
    pub hold_periods: Range,
}

/// Number of pulses of [`Pulses`] before they begin again.
pub const PULSES: usize = 4;

/// Number of levels of [`Steps`] before they begin again.
pub const STEP_LEVELS: usize = 8;

impl Excitation {
    /// Families and frequencies of the grid, in the order of their blocks. Empty without a grid.
    pub fn grid(&self) -> Vec<(Family, f64)> {
        Family::ALL
            .into_iter()
            .filter_map(|family| Some((family, self.frequency_hz(family)?)))
            .flat_map(|(family, frequency)| match frequency {
                Frequency::Grid(grid) => grid.iter().map(|&f| (family, f)).collect(),
                Frequency::Fixed(_) | Frequency::Uniform(_) => Vec::new(),
            })
            .collect()
    }

    /// The families that occur.
    pub fn families(&self) -> impl Iterator<Item = Family> {
        Family::ALL.into_iter().filter(|family| self.frequency_hz(*family).is_some())
    }

    /// The master frequencies of `family`; `None` if it does not occur.
    pub fn frequency_hz(&self, family: Family) -> Option<&Frequency> {
        match family {
            Family::Chirp => self.chirp.as_ref().map(|chirp| &chirp.frequency_hz),
            Family::Multisine => self.multisine.as_ref().map(|multisine| &multisine.frequency_hz),
            Family::Steps => self.steps.as_ref().map(|steps| &steps.frequency_hz),
            Family::Pulses => self.pulses.as_ref().map(|pulses| &pulses.frequency_hz),
            Family::Fourier => self.fourier.as_ref().map(|series| &series.frequency_hz),
            Family::PointToPoint => self.point_to_point.as_ref().map(|moves| &moves.frequency_hz),
            Family::ViaPoints => self.via_points.as_ref().map(|spline| &spline.frequency_hz),
            Family::HandPaths => self.hand_paths.as_ref().map(|paths| &paths.frequency_hz),
        }
    }

    /// The range of amplitudes of `family`, N·m; for multisines N·m per Hz. It is that of the joint
    /// with the smallest divisor. For references it is the interval of their speeds, as shares of the
    /// limits; for paths of the hand that of their radii, m. `None` if the family does not occur.
    pub fn amplitude(&self, family: Family) -> Option<Range> {
        let over =
            |range: Range, divisor: f64| Range::new(range.min / divisor, range.max / divisor);
        match family {
            Family::Chirp => {
                self.chirp.as_ref().map(|chirp| over(chirp.amplitude_nm, chirp.torque_divisor))
            }
            Family::Multisine => self.multisine.as_ref().map(|multisine| {
                let least = multisine.torque_divisor.iter().copied().fold(f64::INFINITY, f64::min);
                over(multisine.amplitude_nm_per_hz, least)
            }),
            Family::Steps => self.steps.as_ref().map(|steps| steps.level_nm),
            Family::Pulses => self.pulses.as_ref().map(|pulses| pulses.level_nm),
            Family::Fourier => self.fourier.as_ref().map(|series| series.speed),
            Family::PointToPoint => self.point_to_point.as_ref().map(|moves| moves.speed),
            Family::ViaPoints => self.via_points.as_ref().map(|spline| spline.speed),
            Family::HandPaths => self.hand_paths.as_ref().map(|paths| paths.radius_m),
        }
    }

    /// The master frequencies that `family` can have here; `None` if it does not occur.
    pub fn support(&self, family: Family) -> Option<Range> {
        self.frequency_hz(family).map(Frequency::support)
    }
}

const fn yes() -> bool {
    true
}

/// Source of every constant: the paper's code, GunesCaginAydin/dynamical-metalearning@ede6d35.
mod chirp {
    use super::{ChirpBand, PI, Range};

    pub const fn amplitude_nm() -> Range {
        Range::new(-4.0, 4.0)
    }
    pub const fn offset_nm() -> Range {
        Range::new(-0.5, 0.5)
    }
    pub const fn phase_rad() -> Range {
        Range::new(-PI, PI)
    }
    pub const fn modulation_depth() -> f64 {
        0.25
    }
    pub const fn torque_divisor() -> f64 {
        2.0
    }
    pub const fn band_split_hz() -> f64 {
        0.3
    }
    pub const fn low_band() -> ChirpBand {
        ChirpBand { f1: Range::new(1.0 / 1.1, 1.5), f2: Range::new(1.0 / 1.5, 2.0) }
    }
    pub const fn high_band() -> ChirpBand {
        ChirpBand { f1: Range::new(1.0 / 1.3, 1.0 / 1.2), f2: Range::new(1.0 / 1.1, 1.1) }
    }
}

mod pulses {
    use super::Range;

    pub const fn level_nm() -> Range {
        Range::new(-6.0, 6.0)
    }
    pub const fn rest_periods() -> Range {
        Range::new(0.25, 0.75)
    }
    pub const fn rise_periods() -> Range {
        Range::new(0.0, 0.2)
    }
    pub const fn hold_periods() -> Range {
        Range::new(0.05, 0.4)
    }
}

mod steps {
    use super::Range;

    /// Most torques of slow chirps and multisines lie in this range.
    pub const fn level_nm() -> Range {
        Range::new(-3.0, 3.0)
    }
    /// Half a period on average.
    pub const fn hold_periods() -> Range {
        Range::new(0.25, 0.75)
    }
}

mod multisine {
    use super::Range;
    use crate::RobotModel;

    pub const fn amplitude_nm_per_hz() -> Range {
        Range::new(-30.0, 30.0)
    }
    pub const fn base() -> Range {
        Range::new(1.0 / 1.5, 1.5)
    }
    pub const fn multiples() -> [f64; 4] {
        [1.0, 1.5, 2.0, 3.0]
    }
    pub fn torque_divisor() -> Vec<f64> {
        RobotModel::panda().description().per_joint(|joint| joint.multisine_divisor)
    }
}
