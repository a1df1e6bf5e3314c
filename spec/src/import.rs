//! An import: somebody's own recordings, made a dataset like any other.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Report};
use crate::kind::KindSpec;
use crate::{
    Column, ColumnType, DataSpec, Digest, Execution, JOINTS, Product, Range, Reference, Referred,
};

/// Turn an uploaded file into a dataset.
///
/// Rows are samples in rising time: positions as they were, and the torques applied from then on.
/// Each recording is cut into trajectories as `split` says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportSpec {
    /// SHA-256 of the uploaded file; `POST /v1/datasets` fills it in.
    pub file: Digest,
    pub format: FileFormat,
    pub columns: ImportColumns,
    #[serde(default)]
    pub units: ImportUnits,
    #[serde(default)]
    pub ranges: ImportRanges,
    /// Sampling rate of the dataset in Hz.
    #[serde(default = "defaults::rate_hz")]
    pub rate_hz: f64,
    #[serde(default)]
    pub resampling: Resampling,
    /// The longest time between two samples, in s, that resampling bridges; more is a pause, and the
    /// file is refused.
    #[serde(default = "defaults::max_gap_s")]
    pub max_gap_s: f64,
    /// Samples per trajectory.
    #[serde(default = "defaults::samples")]
    pub samples: u32,
    #[serde(default)]
    pub split: Split,
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FileFormat {
    Parquet,
    /// With a header line, comma-separated.
    Csv,
}

impl FileFormat {
    pub const ALL: [Self; 2] = [Self::Parquet, Self::Csv];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Parquet => "parquet",
            Self::Csv => "csv",
        }
    }

    /// The media type under which a file of this format is sent.
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Parquet => "application/vnd.apache.parquet",
            Self::Csv => "text/csv",
        }
    }
}

/// Which column of the file is what.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportColumns {
    /// Time of each sample, rising within a recording. Without it, rows are `rate_hz` apart.
    #[serde(default)]
    pub time: Option<String>,
    /// Rows that follow each other with the same value are one recording. Without it, the file is one.
    #[serde(default)]
    pub recording: Option<String>,
    /// Torques of joints 1 to 7: `u` at a sample is held until the next.
    pub u: [String; JOINTS],
    /// Positions of joints 1 to 7.
    pub q: [String; JOINTS],
    /// Velocities of joints 1 to 7.
    #[serde(default)]
    pub qd: Option<[String; JOINTS]>,
}

/// In what the file's numbers are written. The dataset has s, N·m, rad and rad/s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImportUnits {
    pub time: TimeUnit,
    /// Of positions, and per second of velocities.
    pub angle: AngleUnit,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TimeUnit {
    #[default]
    S,
    Ms,
    Us,
    Ns,
}

impl TimeUnit {
    pub const ALL: [Self; 4] = [Self::S, Self::Ms, Self::Us, Self::Ns];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::S => "s",
            Self::Ms => "ms",
            Self::Us => "us",
            Self::Ns => "ns",
        }
    }

    pub const fn seconds(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e-3,
            Self::Us => 1e-6,
            Self::Ns => 1e-9,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AngleUnit {
    #[default]
    Rad,
    Deg,
}

/// What values may lie in, after conversion: one outside is refused, which catches wrong units and
/// wrong columns.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImportRanges {
    pub u_nm: Range,
    pub q_rad: Range,
    pub qd_rad_s: Range,
}

impl Default for ImportRanges {
    fn default() -> Self {
        Self {
            u_nm: Range::new(-200.0, 200.0),
            q_rad: Range::new(-6.5, 6.5),
            qd_rad_s: Range::new(-20.0, 20.0),
        }
    }
}

/// What happens when samples are not `1 / rate_hz` apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Resampling {
    /// The file is refused when a period is off by more than a tenth, or all of them together by
    /// more than a hundredth.
    #[default]
    None,
    /// Positions and velocities between two samples lie on a line, torques are held. Sampling begins
    /// with each recording.
    Linear,
}

/// How a recording becomes trajectories of `samples` samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum Split {
    /// Every recording is one trajectory and must have exactly `samples` samples.
    #[default]
    Whole,
    /// As many as fit, each `stride` samples after the one before; what is left over at the end is
    /// dropped and counted.
    Windows { stride: u32 },
}

impl ImportSpec {
    /// Of the table with a row per time step.
    pub fn trajectory_columns(&self) -> Vec<Column> {
        let mut columns = vec![Column::trajectory(), Column::step()];
        columns.extend(Column::torques(JOINTS).chain(Column::positions(JOINTS)));
        if self.columns.qd.is_some() {
            columns.extend(Column::velocities(JOINTS));
        }
        columns
    }

    /// Of the table with a row per trajectory: where in the file it comes from.
    pub fn table_columns(&self) -> Vec<Column> {
        vec![
            Column::trajectory(),
            Column::new(
                "recording",
                ColumnType::Text,
                "name of its recording in the file; empty when the file names none",
            ),
            Column::new(
                "first_time_s",
                ColumnType::Float64,
                "time of its first sample in the file",
            )
            .unit("s"),
            Column::new(
                "first_row",
                ColumnType::Int64,
                "row of the file at or before its first sample",
            ),
        ]
    }
}

mod defaults {
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

impl KindSpec for ImportSpec {
    fn makes() -> Option<Product> {
        Some(Product::Trajectories)
    }

    fn execution(&self) -> Execution {
        self.execution
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        vec![Reference { field: "file".to_owned(), to: Referred::File(&mut self.file) }]
    }

    fn data(&self) -> Option<DataSpec> {
        Some(DataSpec::Import(self.clone()))
    }
}

impl Check for ImportSpec {
    fn check(&self, report: &mut Report) {
        report.part("columns", &self.columns);
        report.interval("ranges.u_nm", self.ranges.u_nm, &(-1e6..=1e6));
        report.interval("ranges.q_rad", self.ranges.q_rad, &(-1e6..=1e6));
        report.interval("ranges.qd_rad_s", self.ranges.qd_rad_s, &(-1e6..=1e6));
        report.within("rate_hz", self.rate_hz, 1.0..=1000.0);
        report.within("max_gap_s", self.max_gap_s, 0.001..=1.0);
        report.within("samples", self.samples, 2..=10_000);
        if let Split::Windows { stride } = self.split {
            report.within("split.stride", stride, 1..=1_000_000);
        }
        if self.resampling == Resampling::Linear && self.columns.time.is_none() {
            report.violation("columns.time", "missing", "a column, which resampling needs");
        }
        report.part("execution", &self.execution);
    }
}

impl ImportColumns {
    /// Every column that is asked for, with the field that asks for it.
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

impl Check for ImportColumns {
    fn check(&self, report: &mut Report) {
        let named = self.named();
        for (i, (field, name)) in named.iter().enumerate() {
            if name.is_empty() || name.len() > 200 {
                report.violation(field, format!("{name:?}"), "a name of 1 to 200 bytes");
            }
            if let Some((other, _)) = named[..i].iter().find(|(_, earlier)| earlier == name) {
                report.violation(
                    field,
                    format!("{name:?}"),
                    format!("another column than {other}"),
                );
            }
        }
    }
}
