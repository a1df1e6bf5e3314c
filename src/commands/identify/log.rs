//! Logs of an arm as robots write them: a table of text with times, positions and torques.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use anyhow::{Context, bail, ensure};
use clap::Args;
use identification::{Log, LogRow};

/// Flags for the columns of logs.
#[derive(Clone, Debug, Args)]
pub struct LogArguments {
    /// The column of times in s: its name, or its number from 1 on
    #[arg(long, value_name = "COLUMN", default_value = "t")]
    time: String,

    /// The columns of positions in rad, from the base outwards: names or numbers such as `2-7` [default: q1,q2,..]
    #[arg(long, value_name = "COLUMNS")]
    q: Option<String>,

    /// The columns of joint torques in N·m, with the gravity that the motors carry [default: u1,u2,..]
    #[arg(long, value_name = "COLUMNS")]
    u: Option<String>,

    /// Torque per unit of the columns `--u`, one number per joint, such as N·m per ampere
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    pub gains: Option<Vec<f64>>,

    /// What stands between two columns
    #[arg(long, value_name = "CHARACTER", default_value = ",")]
    separator: char,

    /// Numbers have a comma before their decimals
    #[arg(long)]
    decimal_comma: bool,
}

/// The largest log, bytes.
const MAX_BYTES: u64 = 2 << 30;

/// The longest time between two rows, s. Across a longer one, nothing is known of the motion.
const MAX_GAP_S: f64 = 0.1;

/// A log that was read, and what was left out of it.
pub struct LogFile {
    pub log: Log,
    pub notes: Vec<String>,
}

/// The place of each column in a line.
struct Columns {
    time: usize,
    q: Vec<usize>,
    u: Vec<usize>,
}

impl LogArguments {
    /// Reads a log of an arm of so many joints.
    pub fn read(&self, path: &Path, joints: usize) -> anyhow::Result<LogFile> {
        let place = || path.display().to_string();
        let gains = match &self.gains {
            None => vec![1.0; joints],
            Some(gains) => gains.clone(),
        };
        ensure!(
            gains.len() == joints && gains.iter().all(|gain| gain.is_finite() && *gain != 0.0),
            "--gains is {gains:?}, allowed: {joints} numbers that are not 0, one per joint"
        );
        let separator = u8::try_from(self.separator).ok().filter(u8::is_ascii);
        let Some(separator) = separator else {
            bail!("--separator is {:?}, allowed: one ASCII character", self.separator);
        };
        let mut file = File::open(path).with_context(place)?;
        let bytes = file.metadata().with_context(place)?.len();
        ensure!(bytes <= MAX_BYTES, "{} has {bytes} bytes, allowed: {MAX_BYTES}", place());

        let mut first = String::new();
        BufReader::new(&file).read_line(&mut first).with_context(place)?;
        file.rewind().with_context(place)?;
        let mut first = csv::ReaderBuilder::new()
            .delimiter(separator)
            .has_headers(false)
            .from_reader(first.as_bytes());
        let first = match first.records().next() {
            Some(record) => record.with_context(place)?,
            None => bail!("{} is empty, allowed: rows of numbers", place()),
        };
        let has_header = first.iter().any(|field| self.number(field).is_none());
        let header = has_header.then_some(&first);
        let columns = self.columns(header, joints).with_context(place)?;

        let mut reader = csv::ReaderBuilder::new()
            .delimiter(separator)
            .has_headers(has_header)
            .flexible(true)
            .from_reader(BufReader::new(file));
        let mut rows: Vec<LogRow> = Vec::new();
        let (mut repeated, mut notes, mut short) = (0_u64, Vec::new(), None);
        for record in reader.records() {
            let record = record.with_context(place)?;
            let line = record.position().map_or(0, csv::Position::line);
            if let Some(line) = short {
                bail!(
                    "{}, line {line} has fewer columns than the first line, allowed: that of the last line",
                    place()
                );
            }
            if record.len() < first.len() {
                short = Some(line);
                continue;
            }
            let value = |column: usize| {
                let field = record.get(column).unwrap_or_default();
                self.number(field).with_context(|| {
                    format!(
                        "{}, line {line}, column {}: {field:?} is no number",
                        place(),
                        column + 1
                    )
                })
            };
            let values = |columns: &[usize]| -> anyhow::Result<Vec<f64>> {
                columns.iter().map(|&column| value(column)).collect()
            };
            let time_s = value(columns.time)?;
            let before = rows.last().map_or(f64::NEG_INFINITY, |row| row.time_s);
            if time_s == before {
                repeated += 1;
                continue;
            }
            ensure!(
                time_s > before,
                "{}, line {line}: the time {time_s} s is before that of the line above, {before} s",
                place()
            );
            ensure!(
                time_s - before <= MAX_GAP_S || rows.is_empty(),
                "{}, line {line}: {:.3} s have passed since the line above, allowed: {MAX_GAP_S} s; cut the log there",
                place(),
                time_s - before
            );
            let u = values(&columns.u)?;
            let u = u.iter().zip(&gains).map(|(u, gain)| u * gain).collect();
            rows.push(LogRow { time_s, q: values(&columns.q)?, u });
        }
        ensure!(rows.len() > 1, "{} has {} rows, allowed: at least 2", place(), rows.len());
        if let Some(line) = short {
            notes.push(format!("{}: the last line, {line}, is cut off and left out", place()));
        }
        if repeated > 0 {
            notes.push(format!(
                "{}: {repeated} lines repeat the time above them and are left out",
                place()
            ));
        }
        Ok(LogFile { log: Log { name: place(), rows }, notes })
    }

    fn number(&self, field: &str) -> Option<f64> {
        let field = field.trim();
        let number =
            if self.decimal_comma { field.replace(',', ".").parse() } else { field.parse::<f64>() };
        number.ok().filter(|number| number.is_finite())
    }

    fn columns(
        &self,
        header: Option<&csv::StringRecord>,
        joints: usize,
    ) -> anyhow::Result<Columns> {
        let default = |letter: char| {
            let names: Vec<String> = (1..=joints).map(|joint| format!("{letter}{joint}")).collect();
            names.join(",")
        };
        let of_joints = |flag: &str, given: Option<&String>, letter: char| {
            let text = given.cloned().unwrap_or_else(|| default(letter));
            let columns = listed(&text, header).with_context(|| format!("{flag} is {text:?}"))?;
            ensure!(
                columns.len() == joints,
                "{flag} names {} columns, allowed: {joints}, one per joint",
                columns.len()
            );
            Ok(columns)
        };
        let time =
            listed(&self.time, header).with_context(|| format!("--time is {:?}", self.time))?;
        ensure!(time.len() == 1, "--time names {} columns, allowed: one", time.len());
        Ok(Columns {
            time: time[0],
            q: of_joints("--q", self.q.as_ref(), 'q')?,
            u: of_joints("--u", self.u.as_ref(), 'u')?,
        })
    }
}

/// The places of columns that a text lists: names, numbers from 1 on, and ranges of numbers.
fn listed(text: &str, header: Option<&csv::StringRecord>) -> anyhow::Result<Vec<usize>> {
    const MOST: usize = 10_000;

    let mut places = Vec::new();
    for item in text.split(',').map(str::trim) {
        let by_name = header.and_then(|header| header.iter().position(|name| name.trim() == item));
        let (first, last) = item.split_once('-').unwrap_or((item, item));
        match (by_name, first.parse::<usize>(), last.parse::<usize>()) {
            (Some(place), ..) => places.push(place),
            (None, Ok(first), Ok(last)) if (1..=last).contains(&first) && last <= MOST => {
                places.extend(first - 1..last);
            }
            _ => match header {
                None => {
                    bail!("the log has no header, so columns have numbers from 1 on, such as 2-7")
                }
                Some(header) => {
                    let names: Vec<&str> = header.iter().map(str::trim).collect();
                    bail!("there is no column {item:?}, only {}", names.join(", "))
                }
            },
        }
    }
    Ok(places)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Command {
        #[command(flatten)]
        log: LogArguments,
    }

    fn read(flags: &[&str], text: &str) -> anyhow::Result<LogFile> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("log.csv");
        std::fs::write(&path, text)?;
        let words = ["identify"].iter().chain(flags);
        let Command { log } = Command::parse_from(words);
        log.read(&path, 2)
    }

    fn refusal(flags: &[&str], text: &str) -> String {
        let error = read(flags, text).err().map(|error| crate::exit::message(&error));
        let error = error.expect("it is refused");
        error.split_once("log.csv").map_or(error.clone(), |(_, rest)| rest.to_owned())
    }

    #[test]
    fn a_log_has_a_header_or_numbered_columns() {
        let named = read(&[], "t,q1,q2,u1,u2\n0,1,2,3,4\n0.01,1,2,3,4\n").unwrap();
        let numbered =
            read(&["--time", "1", "--q", "2-3", "--u", "4,5"], "0,1,2,3,4\n0.01,1,2,3,4\n")
                .unwrap();
        for LogFile { log, .. } in [named, numbered] {
            assert_eq!(
                (log.rows[1].q.as_slice(), log.rows[1].u.as_slice()),
                (&[1.0, 2.0][..], &[3.0, 4.0][..])
            );
            assert!((log.rate_hz() - 100.0).abs() < 1e-9);
        }
    }

    #[test]
    fn semicolons_decimal_commas_and_gains_are_declared() {
        let flags = ["--separator", ";", "--decimal-comma", "--gains", "10,-2"];
        let log = read(&flags, "t;q1;q2;u1;u2\n0;0,5;2;3;4\n0,01;1;2;3;4\n").unwrap();
        let row = &log.log.rows[0];
        assert_eq!((row.q[0], row.u.as_slice()), (0.5, &[30.0, -8.0][..]));
    }

    #[test]
    fn a_cut_last_line_and_repeated_times_are_left_out_and_named() {
        let text = "t,q1,q2,u1,u2\n0,1,2,3,4\n0,1,2,3,4\n0.01,1,2,3,4\n0.02,1,2\n";
        let log = read(&[], text).unwrap();
        assert_eq!(log.log.rows.len(), 2);
        assert!(
            log.notes[0].ends_with("the last line, 5, is cut off and left out"),
            "{:?}",
            log.notes
        );
        assert!(log.notes[1].ends_with("1 lines repeat the time above them and are left out"));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line_and_column() {
        let head = "t,q1,q2,u1,u2\n0,1,2,3,4\n";
        assert_eq!(
            refusal(&[], &format!("{head}0.01,x,2,3,4\n")),
            ", line 3, column 2: \"x\" is no number"
        );
        assert_eq!(
            refusal(&[], &format!("{head}-1,1,2,3,4\n")),
            ", line 3: the time -1 s is before that of the line above, 0 s"
        );
        assert!(
            refusal(&[], &format!("{head}5,1,2,3,4\n"))
                .starts_with(", line 3: 5.000 s have passed")
        );
        assert!(
            refusal(&[], &format!("{head}0.01,1\n0.02,1,2,3,4\n"))
                .starts_with(", line 3 has fewer columns")
        );
        assert_eq!(refusal(&[], ""), " is empty, allowed: rows of numbers");
        let unnamed = refusal(&["--q", "a,b"], head);
        assert!(unnamed.ends_with("there is no column \"a\", only t, q1, q2, u1, u2"), "{unnamed}");
        assert!(
            refusal(&["--q", "2-4"], head)
                .ends_with("--q names 3 columns, allowed: 2, one per joint")
        );
        assert!(refusal(&["--gains", "1"], head).contains("allowed: 2 numbers that are not 0"));
        assert!(refusal(&[], "0,1,2,3,4\n").contains("the log has no header"));
    }
}
