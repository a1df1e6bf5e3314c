//! The spec of an import: the file's columns and units, the allowed values, and the cut into
//! trajectories.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::omitted::is_zero;
use crate::{Digest, Execution, Range, RobotModel, RobotSpec};

/// Turns an uploaded file, or several that are alike, into a dataset.
///
/// Rows are samples, sorted by time. They have the measured positions, and the torques applied from
/// then on. `split` says how recordings are cut into trajectories.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportSpec {
    /// SHA-256 of the uploaded file; `POST /v1/datasets` fills it in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<Digest>,
    /// Several uploaded files instead of one, in the order of their recordings. They have the same
    /// columns. `POST /v1/datasets` fills this in if a form has several files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<NamedFile>,
    /// The format of the file.
    pub format: FileFormat,
    /// The names of its columns.
    pub columns: ImportColumns,
    /// How the text of a CSV file is written.
    #[serde(default, skip_serializing_if = "CsvLayout::is_default")]
    pub csv: CsvLayout,
    /// Which messages of an MCAP file are rows.
    #[serde(default, skip_serializing_if = "McapMessages::is_default")]
    pub mcap: McapMessages,
    /// The recorded arm, with the same fields as in a simulation. Baselines know this about it.
    /// Default: a Panda whose limits are not checked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotSpec>,
    /// The units of its numbers.
    #[serde(default)]
    pub units: ImportUnits,
    /// The values that are allowed after conversion.
    #[serde(default)]
    pub ranges: ImportRanges,
    /// Standard deviation of the noise that the recorded positions have, rad in any case, 0 to 0.1.
    /// An encoder of resolution r has r / √12. It changes no value; models and baselines that know
    /// the noise filter with it.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// Makes positions continuous that the recording wraps at ±π or at 2π: a step of more than half
    /// a turn is taken for the shorter way round. Without it, such a step is refused.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unwrap: bool,
    /// Sampling rate of the dataset in Hz.
    #[serde(default = "defaults::rate_hz")]
    pub rate_hz: f64,
    /// The handling of samples that are not `1 / rate_hz` apart.
    #[serde(default)]
    pub resampling: Resampling,
    /// Edge of the low-pass that recordings pass before samples are left out, Hz: `rate_hz` / 20 to
    /// below `rate_hz` / 2, or `"none"`. It shifts nothing in time, and has half the amplitude at
    /// its edge. Recordings with at most 1.1 times `rate_hz` do not pass it. The default of an
    /// import that resamples is 0.4 times `rate_hz`. Specs that were stored before this field
    /// existed lack it, and mean `"none"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low_pass_hz: Option<LowPassHz>,
    /// The longest time between two samples that resampling bridges, s. A longer pause in the file
    /// is refused.
    #[serde(default = "defaults::max_gap_s")]
    pub max_gap_s: f64,
    /// Number of samples per trajectory.
    #[serde(default = "defaults::samples")]
    pub samples: u32,
    /// How recordings are cut into trajectories.
    #[serde(default)]
    pub split: Split,
    /// How the job is executed. It is not part of the digest.
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

/// One of several files. Its rows are a recording with its name; if they name recordings
/// themselves, each is called `NAME/RECORDING`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedFile {
    /// A name that no other of the files has, 1 to 100 bytes.
    pub name: String,
    /// SHA-256 of the uploaded file.
    pub file: Digest,
}

impl NamedFile {
    /// The largest number of files of an import.
    pub const MOST: usize = 1000;
    /// The largest number of bytes of a name.
    pub const NAME_BYTES: usize = 100;
}

/// The format of an uploaded file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FileFormat {
    /// A Parquet file with columns of numbers, or of lists of numbers.
    Parquet,
    /// Comma-separated values, or text as `csv` says.
    Csv,
    /// NumPy arrays in an archive, as `numpy.savez` writes them.
    Npz,
    /// Messages, as ROS 2 records them.
    Mcap,
}

impl FileFormat {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::Parquet, Self::Csv, Self::Npz, Self::Mcap];

    /// The word in specs.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Parquet => "parquet",
            Self::Csv => "csv",
            Self::Npz => "npz",
            Self::Mcap => "mcap",
        }
    }

    /// The format that the extension of a file's name implies.
    pub fn of_name(name: &str) -> Option<Self> {
        let extension = std::path::Path::new(name).extension()?.to_str()?;
        Self::ALL.into_iter().find(|format| extension.eq_ignore_ascii_case(format.as_str()))
    }

    /// The media type of an uploaded file in this format.
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Parquet => "application/vnd.apache.parquet",
            Self::Csv => "text/csv",
            Self::Npz => "application/x-npz",
            Self::Mcap => "application/x-mcap",
        }
    }
}

/// The columns of the file, by their meaning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportColumns {
    /// Time of each sample, which increases within a recording. Rows that repeat the time of the row
    /// before are left out and counted. Without this column, rows are 1 / `rate_hz` apart.
    #[serde(default)]
    pub time: Option<String>,
    /// Consecutive rows with the same value are one recording. Without it, the file is one
    /// recording.
    #[serde(default)]
    pub recording: Option<String>,
    /// Torques, one column per joint from the base. `u` at a sample is held until the next one.
    /// A single name is a column of lists with one element per joint, or a range of elements such as
    /// `state[0:6]`. `state[2]` is one element of the lists.
    pub u: Vec<String>,
    /// Positions, one column per joint, or one column of lists.
    pub q: Vec<String>,
    /// Velocities, one column per joint, or one column of lists.
    #[serde(default)]
    pub qd: Option<Vec<String>>,
    /// Torque per unit of the columns `u`, one number per joint, such as N·m per ampere of a motor's
    /// current. A negative number turns the sign. Default: the columns are torques in N·m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gains: Option<Vec<f64>>,
}

/// How the text of a CSV file is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CsvLayout {
    /// Whether the first line names the columns. Without a header, columns have the names `1`, `2`
    /// and so on.
    pub header: bool,
    /// The character between two values: a comma, a semicolon, a tab, or another one. A space means
    /// any number of spaces and tabs.
    pub separator: char,
    /// Whether numbers have a comma before their decimals.
    pub decimal_comma: bool,
}

impl Default for CsvLayout {
    fn default() -> Self {
        Self { header: true, separator: ',', decimal_comma: false }
    }
}

impl CsvLayout {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Which messages of an MCAP file are rows: those of type `sensor_msgs/JointState` on one topic.
/// Their columns are `stamp`, `log_time`, `publish_time`, and the lists `position`, `velocity` and
/// `effort`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct McapMessages {
    /// The topic. Default: the only one with such messages.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
    /// The name of each joint in the messages, from the base outwards. Default: the names in the
    /// robot's description.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
}

impl McapMessages {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// The edge of a low-pass, or none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum LowPassHz {
    /// The edge, Hz.
    Edge(f64),
    /// No low-pass.
    Word(NoLowPass),
}

impl LowPassHz {
    /// The edge by default, as a share of the rate of the samples. Half of the rate may hold
    /// everything that the samples can. At the edge the amplitude is halved, and at half of the
    /// rate a seventh is left, which would be folded into the samples.
    pub const DEFAULT_SHARE: f64 = 0.4;

    /// The edge, Hz; `None` without a low-pass.
    pub const fn edge(self) -> Option<f64> {
        match self {
            Self::Edge(edge) => Some(edge),
            Self::Word(NoLowPass::None) => None,
        }
    }
}

/// The word for no low-pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NoLowPass {
    /// Samples are left out as they are.
    None,
}

/// The units of the file's numbers. The dataset has s, N·m, rad and rad/s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImportUnits {
    /// Unit of times.
    pub time: TimeUnit,
    /// Unit of positions; velocities have this unit per second.
    pub angle: AngleUnit,
}

/// A unit of time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TimeUnit {
    /// Seconds.
    #[default]
    S,
    /// Milliseconds.
    Ms,
    /// Microseconds.
    Us,
    /// Nanoseconds.
    Ns,
}

impl TimeUnit {
    /// All units, the longest first.
    pub const ALL: [Self; 4] = [Self::S, Self::Ms, Self::Us, Self::Ns];

    /// The symbol, as in specs.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::S => "s",
            Self::Ms => "ms",
            Self::Us => "us",
            Self::Ns => "ns",
        }
    }

    /// Its length in seconds.
    pub const fn seconds(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e-3,
            Self::Us => 1e-6,
            Self::Ns => 1e-9,
        }
    }
}

/// A unit of angles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AngleUnit {
    /// Radians.
    #[default]
    Rad,
    /// Degrees.
    Deg,
}

/// The allowed ranges of values after conversion. A value outside is refused, which detects wrong
/// units and wrong columns. `null`, the default if `robot` is given, uses the limits of each joint
/// in the robot's description. `qd_rad_s` also limits the step of a position from one row to the
/// next, which detects wrapped angles, lost rows and spikes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImportRanges {
    /// Torques, N·m.
    pub u_nm: Option<Range>,
    /// Positions, rad.
    pub q_rad: Option<Range>,
    /// Velocities, rad/s.
    pub qd_rad_s: Option<Range>,
}

impl Default for ImportRanges {
    fn default() -> Self {
        Self {
            u_nm: Some(Range::new(-200.0, 200.0)),
            q_rad: Some(Range::new(-6.5, 6.5)),
            qd_rad_s: Some(Range::new(-20.0, 20.0)),
        }
    }
}

/// Handling of samples that are not `1 / rate_hz` apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Resampling {
    /// Refuses the file if one period is off by more than a tenth, or all of them together by more
    /// than a hundredth.
    #[default]
    None,
    /// Interpolates positions and velocities linearly between two samples, and holds torques.
    /// Behind a low-pass (`low_pass_hz`), torques are interpolated as well. Sampling begins anew
    /// with each recording.
    Linear,
    /// Like `linear`, but a torque is the mean until the next sample, so that its impulse stays.
    Mean,
}

impl Resampling {
    /// Whether samples of the dataset lie between those of the file.
    pub fn makes_samples(self) -> bool {
        self != Self::None
    }
}

/// How a recording is cut into trajectories of `samples` samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum Split {
    /// Every recording is one trajectory and must have exactly `samples` samples.
    #[default]
    Whole,
    /// Each recording gives as many trajectories as fit, each `stride` samples after the one
    /// before. The remaining samples at the end are dropped and counted.
    Windows {
        /// Number of samples from the beginning of a trajectory to that of the next.
        stride: u32,
    },
}

impl Split {
    /// The field and its value, as JSON, for trajectories of so many samples without a gap or an overlap.
    pub fn in_a_row(samples: u32) -> String {
        format!("\"split\": {{\"kind\": \"windows\", \"stride\": {samples}}}")
    }
}

impl ImportSpec {
    /// The most samples of a trajectory.
    pub const MOST_SAMPLES: u32 = 10_000;

    /// The uploaded files in their order, with their names if there are several.
    pub fn sources(&self) -> Vec<(Option<&str>, Digest)> {
        let one = self.file.iter().map(|file| (None, *file));
        one.chain(self.files.iter().map(|named| (Some(named.name.as_str()), named.file))).collect()
    }

    /// The recorded arm; a Panda by default.
    pub fn robot(&self) -> RobotSpec {
        self.robot.clone().unwrap_or_default()
    }

    /// Number of joints of the robot.
    pub fn joints(&self) -> usize {
        match &self.robot {
            Some(robot) => robot.joints(),
            None => RobotModel::panda().description().joints.len(),
        }
    }
}

impl ImportColumns {
    /// Every requested column, with the field that names it.
    pub fn named(&self) -> Vec<(String, &str)> {
        let mut named = Vec::new();
        for (field, name) in [("time", &self.time), ("recording", &self.recording)] {
            named.extend(name.as_deref().map(|name| (field.to_owned(), name)));
        }
        for (field, names) in [("u", Some(&self.u)), ("q", Some(&self.q)), ("qd", self.qd.as_ref())]
        {
            for (i, name) in names.into_iter().flatten().enumerate() {
                named.push((format!("{field}[{i}]"), name.as_str()));
            }
        }
        named
    }
}

pub(super) mod defaults {
    pub const fn rate_hz() -> f64 {
        60.0
    }
    pub const fn max_gap_s() -> f64 {
        0.1
    }
    pub const fn samples() -> u32 {
        400
    }
}
