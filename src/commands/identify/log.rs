//! Logs of an arm as robots write them. They are read as an import reads them.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail, ensure};
use clap::Args;
use identification::Log;
use recordings::DecoderProgram;
use serde_json::{Map, Value, json};
use spec::{
    FileFormat, ImportSpec, JobSpec, LowPassHz, NoLowPass, Resampling, RobotDescription, Split,
};
use worker::RehearsedFile;

use super::hints::hint;
use crate::bags::recorded_file;
use crate::commands::import::format_of;
use crate::commands::worker::decoder;
use crate::exit::message;
use crate::progress::measure::counted;

/// Flags for the columns of logs.
#[derive(Clone, Debug, Args)]
pub struct LogArguments {
    /// The column of times: its name, or its number from 1 on [default: t; MCAP: stamp]
    #[arg(long, value_name = "COLUMN")]
    time: Option<String>,

    /// The unit of times
    #[arg(long, value_name = "UNIT", value_parser = ["s", "ms", "us", "ns"], default_value = "s")]
    time_unit: String,

    /// The columns of positions, from the base outwards: names, numbers such as `2-7`, one column of lists, or elements of lists such as `state[0:6]` [default: q1,q2,..; MCAP: position]
    #[arg(long, value_name = "COLUMNS")]
    q: Option<String>,

    /// The unit of positions
    #[arg(long, value_name = "UNIT", value_parser = ["rad", "deg"], default_value = "rad")]
    angle: String,

    /// The columns of joint torques in N·m, with the gravity that the motors carry [default: u1,u2,..; MCAP: effort]
    #[arg(long, value_name = "COLUMNS")]
    u: Option<String>,

    /// Torque per unit of the columns `--u`, one number per joint, such as N·m per ampere
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    gains: Option<Vec<f64>>,

    /// The character between two columns of text; `\t` is a tab
    #[arg(long, value_name = "CHARACTER", default_value = ",", value_parser = separator)]
    separator: char,

    /// Numbers of a text have a comma before their decimals
    #[arg(long)]
    decimal_comma: bool,

    /// Make positions continuous that the log wraps at ±π or at 2π
    #[arg(long)]
    unwrap: bool,

    /// Instead of these flags: what the columns hold, as the mapping of an import says it. It can also name units, the
    /// topic of an MCAP file, and recordings within a file
    #[arg(
        long,
        value_name = "MAPPING.json",
        conflicts_with_all = [
            "time", "time_unit", "q", "angle", "u", "gains", "separator", "decimal_comma", "unwrap"
        ]
    )]
    mapping: Option<PathBuf>,
}

/// The largest log, bytes.
const MAX_BYTES: u64 = 2 << 30;

/// The longest first line of a text, bytes.
const MAX_LINE_BYTES: u64 = 1 << 20;

/// Recordings of a log, and what was left out of it.
pub struct LogFile {
    pub logs: Vec<Log>,
    pub notes: Vec<String>,
}

/// Reads logs of one arm.
pub struct LogReader<'a> {
    arguments: &'a LogArguments,
    mapping: Option<Map<String, Value>>,
    robot: &'a RobotDescription,
    decoder: DecoderProgram,
}

impl LogArguments {
    /// A reader of logs of this arm.
    pub fn reader<'a>(&'a self, robot: &'a RobotDescription) -> anyhow::Result<LogReader<'a>> {
        let read = |path: &PathBuf| -> anyhow::Result<Map<String, Value>> {
            let place = || path.display().to_string();
            let text = std::fs::read(path).with_context(place)?;
            serde_json::from_slice(&text)
                .with_context(|| format!("{} is no mapping, a JSON object", place()))
        };
        let mapping = self.mapping.as_ref().map(read).transpose()?;
        let reader = LogReader { arguments: self, mapping, robot, decoder: decoder()? };
        if let Some(gains) = &self.gains {
            let joints = robot.joints.len();
            ensure!(
                gains.len() == joints && gains.iter().all(|gain| gain.is_finite() && *gain != 0.0),
                "--gains is {gains:?}, allowed: {joints} numbers that are not 0, one per joint"
            );
        }
        Ok(reader)
    }
}

impl LogReader<'_> {
    /// Torque per unit of the columns of torques, if it is given.
    pub fn gains(&self) -> Option<Vec<f64>> {
        let of_mapping = || {
            let mapping = self.mapping.as_ref()?;
            serde_json::from_value(mapping.get("columns")?.get("gains")?.clone()).ok()
        };
        self.arguments.gains.clone().or_else(of_mapping)
    }

    /// Reads a log.
    pub fn read(&self, path: &Path) -> anyhow::Result<LogFile> {
        let path = &recorded_file(path)?;
        let place = || path.display().to_string();
        let content = File::open(path).with_context(place)?;
        let bytes = content.metadata().with_context(place)?.len();
        ensure!(bytes <= MAX_BYTES, "{} has {bytes} bytes, allowed: {MAX_BYTES}", place());
        let format = format_of(path).unwrap_or(FileFormat::Csv);
        let fields = match &self.mapping {
            Some(mapping) => mapping.clone(),
            None => self.of_flags(path, format).with_context(place)?,
        };
        let spec = self.spec(fields, format).with_context(place)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let file = RehearsedFile { recording: None, name, content };
        let (mut logs, warnings) = worker::read_logs(&self.decoder, file, &spec)
            .map_err(|error| self.with_hint(error.into()))
            .with_context(place)?;
        for log in &mut logs {
            log.name = match log.name.as_str() {
                "" => place(),
                recording => format!("{}, recording {recording}", place()),
            };
        }
        let notes = warnings.iter().map(|warning| format!("{}: {warning}", place())).collect();
        Ok(LogFile { logs, notes })
    }

    /// An error with the flags for the fields that it names.
    fn with_hint(&self, error: anyhow::Error) -> anyhow::Error {
        let text = message(&error);
        match hint(&text) {
            Some(hint) if self.mapping.is_none() => anyhow!("{text}\n{hint}"),
            _ => error,
        }
    }

    /// The spec of an import whose rows are kept as they are.
    fn spec(
        &self,
        mut fields: Map<String, Value>,
        format: FileFormat,
    ) -> anyhow::Result<ImportSpec> {
        fields.insert("kind".to_owned(), "import".into());
        fields.insert("file".to_owned(), "0".repeat(64).into());
        fields.insert("robot".to_owned(), json!({"model": self.robot}));
        fields.entry("format").or_insert_with(|| format.as_str().into());
        // The limits of a description are often rated values. These find degrees, and angles that
        // wrap.
        fields.entry("ranges").or_insert_with(
            || json!({"u_nm": [-1e6, 1e6], "q_rad": [-20.0, 20.0], "qd_rad_s": [-20.0, 20.0]}),
        );
        let JobSpec::Import(spec) = spec::parse_json(fields.into())? else {
            bail!("the mapping is that of another kind of job");
        };
        // Without times, rows are `1 / rate_hz` of the mapping apart.
        let has_times = spec.columns.time.is_some();
        Ok(ImportSpec {
            resampling: if has_times { Resampling::Linear } else { Resampling::None },
            low_pass_hz: has_times.then_some(LowPassHz::Word(NoLowPass::None)),
            samples: 2,
            split: Split::Windows { stride: 1_000_000 },
            ..spec
        })
    }

    /// The fields of an import that the flags state.
    fn of_flags(&self, path: &Path, format: FileFormat) -> anyhow::Result<Map<String, Value>> {
        let LogArguments { time, time_unit, q, angle, u, gains, .. } = self.arguments;
        let LogArguments { separator, decimal_comma, unwrap, .. } = self.arguments;
        let joints = self.robot.joints.len();
        let each = |letter: char| -> Vec<String> {
            (1..=joints).map(|joint| format!("{letter}{joint}")).collect()
        };
        let (times, of_q, of_u) = match format {
            FileFormat::Mcap => ("stamp", vec!["position".to_owned()], vec!["effort".to_owned()]),
            _ => ("t", each('q'), each('u')),
        };
        let header = match format {
            FileFormat::Csv => self.header(path)?,
            _ => Header::Unknown,
        };
        let columns = |flag: &str, given: &Option<String>, default: Vec<String>, allowed: usize| {
            // The decoder refuses a file that is no text.
            if format == FileFormat::Csv && matches!(header, Header::Unknown) {
                return Ok(default);
            }
            let given = given.clone().unwrap_or_else(|| default.join(","));
            let columns =
                listed(&given, &header).with_context(|| format!("{flag} is {given:?}"))?;
            let may_be_lists = format != FileFormat::Csv && columns.len() == 1;
            ensure!(
                columns.len() == allowed || may_be_lists,
                "{flag} names {} columns, allowed: {allowed}{}",
                columns.len(),
                if flag == "--time" { "" } else { ", one per joint" }
            );
            Ok(columns)
        };
        let time = columns("--time", time, vec![times.to_owned()], 1)?;
        let mut fields = json!({
            "columns": {
                "time": time[0],
                "q": columns("--q", q, of_q, joints)?,
                "u": columns("--u", u, of_u, joints)?,
                "gains": gains,
            },
            "units": {"time": time_unit, "angle": angle},
            "unwrap": unwrap,
        });
        if format == FileFormat::Csv {
            let header = !matches!(header, Header::Numbered(_));
            fields["csv"] =
                json!({"header": header, "separator": separator, "decimal_comma": decimal_comma});
        }
        match fields {
            Value::Object(fields) => Ok(fields),
            _ => bail!("the flags name no columns"),
        }
    }

    /// The columns that the first line of a text names.
    fn header(&self, path: &Path) -> anyhow::Result<Header> {
        let mut first = Vec::new();
        BufReader::new(File::open(path)?).take(MAX_LINE_BYTES).read_until(b'\n', &mut first)?;
        // The decoder says what other bytes are.
        let Ok(first) = String::from_utf8(first) else { return Ok(Header::Unknown) };
        let fields = self.fields(first.trim_start_matches('\u{feff}'))?;
        ensure!(!fields.is_empty(), "it is empty, allowed: rows of numbers");
        let is_number = |field: &String| {
            let number = match self.arguments.decimal_comma {
                true => field.replace(',', ".").parse::<f64>(),
                false => field.parse(),
            };
            number.is_ok()
        };
        Ok(match fields.iter().all(is_number) {
            true => Header::Numbered(fields.len()),
            false => Header::Names(fields),
        })
    }

    /// The fields of a line.
    fn fields(&self, line: &str) -> anyhow::Result<Vec<String>> {
        let separator = self.arguments.separator;
        if separator == ' ' {
            return Ok(line.split_whitespace().map(str::to_owned).collect());
        }
        let delimiter = u8::try_from(separator).ok().filter(u8::is_ascii);
        let delimiter = delimiter.with_context(|| {
            format!("--separator is {separator:?}, allowed: one ASCII character")
        })?;
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(delimiter)
            .has_headers(false)
            .from_reader(line.as_bytes());
        let fields = reader.records().next().transpose()?.unwrap_or_default();
        Ok(fields.iter().map(|field| field.trim().to_owned()).collect())
    }
}

/// A character, or the name of one that a shell hardly lets through.
fn separator(text: &str) -> Result<char, String> {
    if text == "\\t" {
        return Ok('\t');
    }
    text.parse().map_err(|_| "allowed: one character, or \\t for a tab".to_owned())
}

/// The columns of a log, as far as they are known before it is read.
enum Header {
    /// The first line of a text names its columns.
    Names(Vec<String>),
    /// The first line of a text has so many numbers.
    Numbered(usize),
    /// A file of another format says itself what it has.
    Unknown,
}

/// The names of the columns that a text lists: names, numbers from 1 on, and ranges of numbers. A
/// text without a header has numbers for names.
fn listed(text: &str, header: &Header) -> anyhow::Result<Vec<String>> {
    const MOST: usize = 10_000;

    let mut found = Vec::new();
    for item in text.split(',').map(str::trim) {
        let (first, last) = item.split_once('-').unwrap_or((item, item));
        let numbers = match (first.parse::<usize>(), last.parse::<usize>()) {
            (Ok(first), Ok(last)) if (1..=last).contains(&first) && last <= MOST => {
                Some(first..=last)
            }
            _ => None,
        };
        match (header, numbers) {
            (Header::Names(names), _) if names.iter().any(|name| name == item) => {
                found.push(item.to_owned());
            }
            (Header::Names(names), Some(numbers)) if *numbers.end() <= names.len() => {
                found.extend(numbers.map(|number| names[number - 1].clone()));
            }
            (Header::Names(names), Some(numbers)) => {
                bail!(
                    "there is no column {}, the log has {}: {}",
                    numbers.end(),
                    counted(names.len(), "column"),
                    names.join(", ")
                );
            }
            (Header::Names(names), None) => {
                bail!(
                    "there is no column {item:?}, only {}{}",
                    names.join(", "),
                    other_separator(names)
                );
            }
            (Header::Numbered(columns), Some(numbers)) if numbers.end() > columns => {
                bail!(
                    "there is no column {}, the log has {}",
                    numbers.end(),
                    counted(*columns, "column")
                );
            }
            (Header::Numbered(_), Some(numbers)) => {
                found.extend(numbers.map(|number| number.to_string()));
            }
            (Header::Numbered(_), None) => {
                bail!("the log has no header, so columns have numbers from 1 on, such as 2-7");
            }
            (Header::Unknown, _) => found.push(item.to_owned()),
        }
    }
    Ok(found)
}

/// A hint if the only column of a text looks like several.
fn other_separator(names: &[String]) -> String {
    let [only] = names else { return String::new() };
    let separators = [(';', "';'"), ('\t', "'\\t'"), ('|', "'|'"), (' ', "' '")];
    let other = separators.into_iter().find(|(separator, _)| only.contains(*separator));
    other.map_or_else(String::new, |(_, flag)| {
        format!("\nhint: if columns have another separator, say --separator {flag}")
    })
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use spec::{AngleUnit, ImportColumns, ImportUnits, RobotModel, TimeUnit};

    use super::*;

    #[derive(Debug, Parser)]
    struct Command {
        #[command(flatten)]
        log: LogArguments,
    }

    /// The import that reads a log of an arm of two joints.
    fn spec_of(flags: &[&str], name: &str, text: &str) -> anyhow::Result<ImportSpec> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join(name);
        std::fs::write(&path, text)?;
        let Command { log } = Command::parse_from(["identify"].iter().chain(flags));
        let mut robot = RobotModel::panda().description().clone();
        robot.joints.truncate(2);
        robot.initial_state.center_rad.truncate(2);
        let reader = log.reader(&robot)?;
        let format = format_of(&path).unwrap_or(FileFormat::Csv);
        reader.spec(reader.of_flags(&path, format)?, format)
    }

    fn refusal(flags: &[&str], text: &str) -> String {
        let error = spec_of(flags, "log.txt", text).expect_err("it is refused");
        crate::exit::message(&error)
    }

    #[test]
    fn a_text_has_a_header_or_numbered_columns() {
        let numbers = ["--time", "1", "--q", "2-3", "--u", "4,5"];
        let named = spec_of(&[], "log.txt", "t,q1,q2,u1,u2\n0,1,2,3,4\n").unwrap();
        let by_number = spec_of(&numbers, "log.txt", "t,q1,q2,u1,u2\n0,1,2,3,4\n").unwrap();
        assert_eq!(named.columns, by_number.columns);
        assert!(named.csv.header);
        let numbered = spec_of(&numbers, "log.txt", "0,1,2,3,4\n0.01,1,2,3,4\n").unwrap();
        let ImportColumns { time, q, u, .. } = numbered.columns;
        assert_eq!(
            (time.as_deref(), q, u),
            (Some("1"), vec!["2".into(), "3".into()], vec!["4".into(), "5".into()])
        );
        assert!(!numbered.csv.header);
    }

    #[test]
    fn the_layout_of_a_text_is_declared() {
        let flags = ["--separator", ";", "--decimal-comma", "--gains", "10,-2", "--unwrap"];
        let spec = spec_of(&flags, "log.txt", "t;q1;q2;u1;u2\n0,1;0,5;2;3;4\n").unwrap();
        assert_eq!((spec.csv.separator, spec.csv.decimal_comma, spec.unwrap), (';', true, true));
        assert_eq!(spec.columns.gains, Some(vec![10.0, -2.0]));
        let units = ["--separator", "\\t", "--time-unit", "ms", "--angle", "deg"];
        let spec = spec_of(&units, "log.txt", "t\tq1\tq2\tu1\tu2\n").unwrap();
        assert_eq!(spec.csv.separator, '\t');
        assert_eq!(spec.units, ImportUnits { time: TimeUnit::Ms, angle: AngleUnit::Deg });
        assert!(Command::try_parse_from(["identify", "--separator", "ab"]).is_err());
        let spaced = spec_of(&["--separator", " "], "log.txt", "t  q1 q2\tu1 u2\n").unwrap();
        assert_eq!(spaced.columns.u, ["u1", "u2"]);
    }

    #[test]
    fn other_formats_have_names_only() {
        let lists = spec_of(&["--q", "observation.state", "--u", "action"], "log.parquet", "");
        assert_eq!(lists.unwrap().columns.q, ["observation.state"]);
        let elements =
            spec_of(&["--q", "state[0:2]", "--u", "i[3],i[1]"], "log.parquet", "").unwrap();
        assert_eq!((elements.columns.q[0].as_str(), elements.columns.u.len()), ("state[0:2]", 2));
        let messages = spec_of(&[], "log.mcap", "").unwrap();
        assert_eq!(messages.columns.u, ["effort"]);
        assert_eq!(messages.columns.time.as_deref(), Some("stamp"));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let head = "t,q1,q2,u1,u2\n0,1,2,3,4\n";
        assert!(refusal(&[], "").contains("it is empty, allowed: rows of numbers"));
        let unnamed = refusal(&["--q", "a,b"], head);
        assert!(unnamed.ends_with("there is no column \"a\", only t, q1, q2, u1, u2"), "{unnamed}");
        let three = refusal(&["--q", "2-4"], head);
        assert!(three.ends_with("--q names 3 columns, allowed: 2, one per joint"), "{three}");
        assert!(refusal(&["--gains", "1"], head).contains("allowed: 2 numbers that are not 0"));
        assert!(refusal(&[], "0,1,2,3,4\n").contains("the log has no header"));
        let beyond = refusal(&["--u", "5-6"], head);
        assert!(
            beyond.ends_with("there is no column 6, the log has 5 columns: t, q1, q2, u1, u2"),
            "{beyond}"
        );
        let numbers = ["--time", "1", "--q", "2-3", "--u", "5-6"];
        let beyond = refusal(&numbers, "0,1,2,3,4\n");
        assert!(beyond.ends_with("there is no column 6, the log has 5 columns"), "{beyond}");
    }

    #[test]
    fn a_text_with_another_separator_says_so() {
        for (separator, flag) in [(";", "--separator ';'"), ("\t", "--separator '\\t'")] {
            let other = refusal(&[], &"t,q1,q2,u1,u2\n".replace(',', separator));
            assert!(other.ends_with(flag), "{other}");
        }
    }

    #[test]
    fn the_decoder_is_left_to_say_what_a_file_without_text_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(&path, b"\x1f\x8b\x08\xff").unwrap();
        let Command { log } = Command::parse_from(["identify"]);
        let robot = RobotModel::panda().description().clone();
        let fields = log.reader(&robot).unwrap().of_flags(&path, FileFormat::Csv).unwrap();
        assert_eq!(fields["csv"]["header"], true);
    }
}
