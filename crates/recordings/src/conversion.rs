//! Converts the rows of a file into the tables of a dataset.
//!
//! Memory does not grow with the file. It holds a batch of rows, the samples of one trajectory, and
//! the trajectories that were not handed on yet.

use spec::{ImportSpec, Split};
use wire::ImportCounts;

use crate::error::{ImportError, RowError};
use crate::frozen::Frozen;
use crate::jumps::Jumps;
use crate::lengths::Lengths;
use crate::measured::{Keeper, Measured};
use crate::recording::{LikelyUnit, Recording, rounded};
use crate::rows::{Rows, TimeColumn};
use crate::samples::Sampling;
use crate::tables::{ImportedTrajectories, Origin, TableSchemas, Tables};
use crate::windows::Window;

/// The largest number of trajectories of a dataset.
const MAX_TRAJECTORIES: u64 = 10_000_000;

/// Converts rows into trajectories. The result depends only on the rows and the spec.
pub struct Conversion<I> {
    spec: ImportSpec,
    source: I,
    sampling: Sampling,
    rows: Rows,
    /// Index of the next row of `rows`.
    next: usize,
    recording: Option<Recording>,
    /// The name of the file that `rows` are of, and whether they are its first.
    file: Option<String>,
    begins_file: bool,
    jumps: Jumps,
    frozen: Frozen,
    window: Window,
    tables: Tables,
    counts: ImportCounts,
    folded: Option<Folded>,
    /// The first recording that is faster than any robot records, and the unit that its times probably have.
    likely_unit: Option<(Option<String>, LikelyUnit)>,
    lengths: Lengths,
    /// Keeps what was measured, if the arm is known.
    keeper: Option<Keeper>,
    /// The last lines of CSV files that were cut off, with the names of their files.
    cut_lines: Vec<(Option<String>, u64)>,
}

/// The first recording of which samples were left out without a low-pass, and the number of others.
struct Folded {
    recording: Option<String>,
    rate_hz: f64,
    others: u64,
}

impl<I, E> Conversion<I>
where
    I: Iterator<Item = Result<Rows, E>>,
    E: From<ImportError>,
{
    /// A conversion of the rows of `source` into tables with these `schemas`.
    pub fn new(source: I, spec: &ImportSpec, schemas: TableSchemas) -> Self {
        let spec = ImportSpec { columns: spec.joint_columns(), ..spec.clone() };
        let sampling = Sampling::new(&spec);
        let tables = Tables::new(schemas, sampling.channel_count());
        Self {
            source,
            sampling,
            rows: Rows::default(),
            next: 0,
            recording: None,
            file: None,
            begins_file: false,
            jumps: Jumps::new(&spec),
            frozen: Frozen::new(&spec),
            window: Window::new(&spec),
            tables,
            counts: ImportCounts::default(),
            folded: None,
            likely_unit: None,
            lengths: Lengths::default(),
            keeper: spec.robot.is_some().then(|| Keeper::new(spec.joints())),
            cut_lines: Vec::new(),
            spec,
        }
    }

    /// Keeps everything as it was measured, however many rows that are.
    #[must_use]
    pub fn keeping_all(self) -> Self {
        Self { keeper: Some(Keeper::of_all(self.spec.joints())), ..self }
    }

    /// The next trajectories, perhaps none yet; `None` at the end.
    ///
    /// # Errors
    /// When the file is damaged, or has values that the spec does not allow.
    pub fn next_trajectories(&mut self) -> Result<Option<ImportedTrajectories>, E> {
        let converted = self.convert();
        // A jump is found some rows later, and the first wrong row is the one to report.
        converted.map_err(|error| match self.earlier_jump() {
            Some(jump) => ImportError::from(jump).into(),
            None => error,
        })
    }

    fn earlier_jump(&mut self) -> Option<RowError> {
        let recording = self.recording.as_ref()?.name.clone();
        self.jumps.finish().err().map(|error| RowError { recording, ..error })
    }

    fn convert(&mut self) -> Result<Option<ImportedTrajectories>, E> {
        while !self.tables.is_full() && (self.cut()? || self.accept_row()?) {}
        if !self.tables.is_full() && !self.read_rows()? {
            self.end_recording()?;
            let rest = self.tables.take().map_err(unarranged)?;
            return Ok((rest.table.num_rows() > 0).then_some(rest));
        }
        Ok(Some(self.tables.take().map_err(unarranged)?))
    }

    /// The counts of the whole file, after [`Self::next_trajectories`] has reached its end.
    ///
    /// # Errors
    /// When the file gave no trajectory.
    pub fn finish(self) -> Result<ImportCounts, ImportError> {
        let trajectories = self.tables.count();
        let mut warnings = self.warnings();
        warnings.extend(self.frozen.warnings());
        let counts = ImportCounts { trajectories, warnings, ..self.counts };
        if counts.trajectories > 0 {
            return Ok(counts);
        }
        let ImportCounts { rows, recordings, dropped_samples, repeated_rows, .. } = counts;
        let repeated = match repeated_rows {
            0 => String::new(),
            1 => " (1 row repeats the time of the row before)".to_owned(),
            rows => format!(" ({rows} rows repeat the time of the row before)"),
        };
        let rows = match rows {
            1 => "its only row is".to_owned(),
            rows => format!("its {rows} rows are"),
        };
        let longest = self.lengths.most_samples;
        let remedy = match &self.likely_unit {
            Some((_, unit)) => format!("; {unit}"),
            None if longest >= 2 => {
                format!("; \"samples\": {longest} takes the longest recording")
            }
            None => String::new(),
        };
        Err(ImportError::file(format!(
            "it gives no trajectory: {rows} {} with {} together{repeated}, and a trajectory needs \
             {}{remedy}",
            counted(recordings, "recording"),
            counted(dropped_samples, "sample"),
            self.spec.samples
        )))
    }

    /// The lengths and rates of the recordings so far.
    pub const fn lengths(&self) -> &Lengths {
        &self.lengths
    }

    /// The rows that were kept as they were measured: pieces from everywhere, for a check of their
    /// torques, or [everything](Self::keeping_all). There is nothing if the spec names no robot, and nothing the
    /// second time.
    pub fn take_measured(&mut self) -> Vec<Measured> {
        self.keeper.take().map(Keeper::recordings).unwrap_or_default()
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for (file, line) in &self.cut_lines {
            let place = file.as_ref().map(|file| format!("file {file:?}, ")).unwrap_or_default();
            warnings.push(format!("{place}line {line}, the last one, is cut off and was left out"));
        }
        match self.counts.repeated_rows {
            0 => {}
            1 => warnings
                .push("one row repeats the time of the row before and was left out".to_owned()),
            rows => warnings
                .push(format!("{rows} rows repeat the time of the row before and were left out")),
        }
        if let Some((recording, unit)) = &self.likely_unit {
            let recording = recording
                .as_ref()
                .map_or_else(|| "the recording".to_owned(), |name| format!("recording {name:?}"));
            warnings.push(format!("{recording} is faster than any robot records; {unit}"));
        }
        warnings.extend(self.folded.as_ref().map(|folded| folded.warning(&self.spec)));
        warnings
    }

    /// Number of trajectories so far.
    pub const fn trajectories(&self) -> u64 {
        self.tables.count()
    }

    fn read_rows(&mut self) -> Result<bool, E> {
        let Some(rows) = self.source.next().transpose()? else { return Ok(false) };
        self.cut_lines.extend(rows.cut_line.map(|line| (rows.file.clone(), line)));
        if rows.file != self.file {
            (self.file, self.begins_file) = (rows.file.clone(), true);
        }
        self.rows = rows;
        self.next = 0;
        Ok(true)
    }

    /// Moves a sample of the recording into its window. Returns false if there is none.
    fn cut(&mut self) -> Result<bool, ImportError> {
        let Some(recording) = &mut self.recording else { return Ok(false) };
        let Some(sample) = recording.advance() else { return Ok(false) };
        // A recording that becomes one trajectory must also end with it.
        if self.window.push(sample) && self.spec.split != Split::Whole {
            let name = recording.name.clone();
            self.keep_trajectory(name.as_deref())?;
        }
        Ok(true)
    }

    fn keep_trajectory(&mut self, recording: Option<&str>) -> Result<(), ImportError> {
        if self.tables.count() == MAX_TRAJECTORIES {
            let reason = format!("it would give more than {MAX_TRAJECTORIES} trajectories");
            return Err(ImportError::file(reason));
        }
        let samples = self.window.trajectory();
        if let Some(first) = samples.front() {
            let origin = Origin {
                recording: recording.unwrap_or_default(),
                first_time_s: self.sampling.file_time_s(first),
                first_row: first.row,
            };
            self.tables.push(samples, &origin).map_err(unarranged)?;
        }
        Ok(())
    }

    /// Passes the next row to its recording. Returns false if all rows read so far are done.
    fn accept_row(&mut self) -> Result<bool, ImportError> {
        if self.next == self.rows.count {
            return Ok(false);
        }
        let index = self.next;
        let name = self.rows.recording.as_ref().map(|names| &names[index]);
        let begins_file = std::mem::take(&mut self.begins_file);
        let recording = self.recording.as_ref().filter(|_| !begins_file);
        let goes_on = recording.is_some_and(|recording| recording.name.as_ref() == name);
        if !goes_on {
            let (name, place) = (name.cloned(), self.rows.place(index));
            self.end_recording()?;
            if let Some(keeper) = &mut self.keeper {
                keeper.begin(name.as_deref());
            }
            let unit = match self.rows.time {
                None | Some(TimeColumn::Dated(..)) => None,
                Some(TimeColumn::Integer(_) | TimeColumn::Decimal(_)) => Some(self.spec.units.time),
            };
            self.recording = Some(Recording::new(name, place, unit, &self.spec));
        }
        if let Some(recording) = &mut self.recording {
            let name = &recording.name;
            let named = |error| RowError { recording: name.clone(), ..error };
            let sample = self.sampling.sample(&self.rows, index, recording.rows).map_err(named)?;
            if recording.repeats(&sample) {
                self.counts.repeated_rows += 1;
            } else {
                recording.check(&sample, &self.spec)?;
                self.jumps.accept(&sample).map_err(named)?;
                self.frozen.accept(&sample, name.as_deref()).map_err(named)?;
                if let Some(keeper) = &mut self.keeper {
                    keeper.keep(&sample);
                }
                let name = name.clone();
                recording.accept(sample).map_err(|error| RowError { recording: name, ..error })?;
            }
        }
        self.next += 1;
        self.counts.rows += 1;
        Ok(true)
    }

    fn end_recording(&mut self) -> Result<(), ImportError> {
        let Some(recording) = &mut self.recording else { return Ok(()) };
        let name = recording.name.clone();
        let named = |error| RowError { recording: name.clone(), ..error };
        self.jumps.finish().map_err(named)?;
        self.frozen.finish(name.as_deref());
        recording.check_rate(&self.spec)?;
        recording.finish().map_err(named)?;
        while self.cut()? {}
        let Some(recording) = self.recording.take() else { return Ok(()) };
        self.counts.filtered_recordings += u64::from(recording.is_filtered());
        if let Some(rate_hz) = recording.folded_rate_hz(&self.spec) {
            match &mut self.folded {
                Some(folded) => folded.others += 1,
                None => self.folded = Some(Folded { recording: name, rate_hz, others: 0 }),
            }
        }
        if let Some(unit) = recording.likely_unit() {
            self.likely_unit.get_or_insert((recording.name.clone(), unit));
        }
        self.lengths.add(recording.length());
        if self.spec.split == Split::Whole {
            self.check_length(&recording)?;
            self.keep_trajectory(recording.name.as_deref())?;
        }
        self.counts.recordings += 1;
        self.counts.dropped_samples += self.window.dropped();
        self.counts.dropped_recordings += u64::from(self.window.trajectories() == 0);
        self.window.clear();
        Ok(())
    }

    fn check_length(&self, recording: &Recording) -> Result<(), RowError> {
        let (samples, expected) = (recording.samples, u64::from(self.spec.samples));
        if samples == expected {
            return Ok(());
        }
        let mut allowed = format!("samples = {expected}");
        if (2..=u64::from(ImportSpec::MOST_SAMPLES)).contains(&samples) {
            allowed += &format!("; \"samples\": {samples} takes it whole");
        }
        if samples > expected {
            let (split, count) = (Split::in_a_row(self.spec.samples), samples / expected);
            allowed += &format!("; {split} cuts it into {}", counted(count, "window"));
        }
        if let Some(unit) = recording.likely_unit() {
            allowed = format!("samples = {expected}; {unit}");
        }
        Err(RowError {
            recording: recording.name.clone(),
            place: recording.first,
            column: None,
            found: format!("the recording that begins here has {samples} samples"),
            allowed,
        })
    }
}

impl Folded {
    fn warning(&self, spec: &ImportSpec) -> String {
        let recording = match &self.recording {
            Some(name) => format!("recording {name:?}"),
            None => "the recording".to_owned(),
        };
        let others = match self.others {
            0 => String::new(),
            others => format!(", as from {others} others"),
        };
        format!(
            "{recording} has {} Hz, and samples were left out of it without a low-pass{others}: motion and \
             noise above {} Hz are folded into the dataset; set low_pass_hz",
            rounded(self.rate_hz),
            spec.rate_hz / 2.0,
        )
    }
}

#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
fn unarranged(error: arrow_schema::ArrowError) -> ImportError {
    ImportError::file(error.to_string())
}

/// A count with its noun: `1 recording`, `3 recordings`.
fn counted(count: u64, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}
