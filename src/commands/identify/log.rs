//! Logs of an arm as robots write them: a table of text with times, positions and torques.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use clap::Args;
use identification::Recording;
use series::LowPass;

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

/// The highest rate of the samples, Hz. A faster log is filtered before samples are left out.
const MAX_RATE_HZ: f64 = 250.0;

/// The edge of that filter, as a share of the samples' rate.
const EDGE: f64 = 0.4;

/// A log that was read, and what was left out of it.
pub struct Log {
    /// The rows at their own times.
    rows: Vec<Row>,
    pub path: PathBuf,
    pub notes: Vec<String>,
}

struct Row {
    time_s: f64,
    q: Vec<f64>,
    u: Vec<f64>,
}

/// The place of each column in a line.
struct Columns {
    time: usize,
    q: Vec<usize>,
    u: Vec<usize>,
}

impl LogArguments {
    /// Reads a log of an arm of so many joints.
    pub fn read(&self, path: &Path, joints: usize) -> anyhow::Result<Log> {
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
        let mut rows: Vec<Row> = Vec::new();
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
            rows.push(Row { time_s, q: values(&columns.q)?, u });
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
        Ok(Log { rows, path: path.to_owned(), notes })
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

impl Log {
    /// Samples per second for recordings: the log's own, at most [`MAX_RATE_HZ`].
    pub fn rate_hz(&self) -> f64 {
        self.own_rate_hz().min(MAX_RATE_HZ)
    }

    /// One over the median time between rows.
    fn own_rate_hz(&self) -> f64 {
        let mut periods: Vec<f64> =
            self.rows.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
        periods.sort_by(f64::total_cmp);
        1.0 / periods[periods.len() / 2]
    }

    /// The log at even times. A log with a higher rate than `rate_hz` passes a low-pass without
    /// delay before, so that nothing from above half of the rate is folded into it.
    pub fn recording(&self, rate_hz: f64) -> Recording {
        let own_rate_hz = self.own_rate_hz();
        match LowPass::new(EDGE * rate_hz, own_rate_hz) {
            Some(filter) if own_rate_hz > rate_hz => {
                let dense = self.at_even_times(own_rate_hz);
                let rows = (0_u32..)
                    .zip(filter.apply_to_columns(&dense.q))
                    .zip(filter.apply_to_columns(&dense.u))
                    .map(|((sample, q), u)| Row { time_s: f64::from(sample) / own_rate_hz, q, u })
                    .collect();
                let path = self.path.clone();
                Log { rows, path, notes: Vec::new() }.at_even_times(rate_hz)
            }
            _ => self.at_even_times(rate_hz),
        }
    }

    /// The log at even times. Values between two rows are interpolated.
    fn at_even_times(&self, rate_hz: f64) -> Recording {
        let (first, last) = (self.rows[0].time_s, self.rows[self.rows.len() - 1].time_s);
        let name = self.path.display().to_string();
        let mut recording = Recording { name, rate_hz, q: Vec::new(), u: Vec::new() };
        let mut at = 0;
        let times = (0_u32..).map(|sample| first + f64::from(sample) / rate_hz);
        for time_s in times.take_while(|time_s| *time_s < last) {
            while at + 2 < self.rows.len() && self.rows[at + 1].time_s <= time_s {
                at += 1;
            }
            let (before, after) = (&self.rows[at], &self.rows[at + 1]);
            let share = (time_s - before.time_s) / (after.time_s - before.time_s);
            let between = |before: &[f64], after: &[f64]| {
                before
                    .iter()
                    .zip(after)
                    .map(|(before, after)| before + share * (after - before))
                    .collect()
            };
            recording.q.push(between(&before.q, &after.q));
            recording.u.push(between(&before.u, &after.u));
        }
        recording
    }
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

    fn read(flags: &[&str], text: &str) -> anyhow::Result<Log> {
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
        for log in [named, numbered] {
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
        assert_eq!((log.rows[0].q[0], log.rows[0].u.as_slice()), (0.5, &[30.0, -8.0][..]));
    }

    #[test]
    fn a_cut_last_line_and_repeated_times_are_left_out_and_named() {
        let text = "t,q1,q2,u1,u2\n0,1,2,3,4\n0,1,2,3,4\n0.01,1,2,3,4\n0.02,1,2\n";
        let log = read(&[], text).unwrap();
        assert_eq!(log.rows.len(), 2);
        assert!(
            log.notes[0].ends_with("the last line, 5, is cut off and left out"),
            "{:?}",
            log.notes
        );
        assert!(log.notes[1].ends_with("1 lines repeat the time above them and are left out"));
    }

    #[test]
    fn values_between_rows_are_interpolated() {
        let log = read(&[], "t,q1,q2,u1,u2\n0,0,0,0,0\n0.01,1,2,3,4\n0.02,2,4,6,8\n").unwrap();
        let recording = log.recording(200.0);
        assert_eq!(recording.q.len(), 4);
        assert!((recording.q[1][1] - 1.0).abs() < 1e-12 && (recording.u[3][0] - 4.5).abs() < 1e-12);
    }

    #[test]
    fn a_faster_log_is_filtered_before_samples_are_left_out() {
        // 1 Hz, and 240 Hz, which would become 10 Hz at 250 samples per second.
        let mut text = "t,q1,q2,u1,u2\n".to_owned();
        for sample in 0..2000 {
            let t = f64::from(sample) * 1e-3;
            let wave = |hz: f64| (std::f64::consts::TAU * hz * t).sin();
            text += &format!("{t},{},0,{},0\n", wave(1.0), wave(240.0));
        }
        let log = read(&[], &text).unwrap();
        assert!((log.rate_hz() - 250.0).abs() < 1e-6);
        let recording = log.recording(250.0);
        for (k, (q, u)) in recording.q.iter().zip(&recording.u).enumerate().skip(50).take(400) {
            let expected = (std::f64::consts::TAU * k as f64 / 250.0).sin();
            assert!((q[0] - expected).abs() < 1e-3, "{k}: {} {expected}", q[0]);
            assert!(u[0].abs() < 0.02, "{k}: {}", u[0]);
        }
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
