//! Checks the values of an import.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::spec::{
    CsvLayout, FileFormat, ImportColumns, ImportRanges, ImportSpec, LowPassHz, McapMessages,
    NamedFile, Split,
};
use crate::check::{Check, Violations};
use crate::{MAX_POSITION_NOISE_RAD, MAX_SAMPLING_RATE_HZ};

impl Check for ImportSpec {
    fn check(&self, violations: &mut Violations) {
        self.check_files(violations);
        if let Some(robot) = &self.robot {
            violations.part("robot", robot);
        }
        self.check_columns(violations);
        self.check_csv(violations);
        self.check_mcap(violations);
        self.check_ranges(violations);
        let noise = 0.0..=MAX_POSITION_NOISE_RAD;
        violations.within("position_noise_rad", self.position_noise_rad, noise);
        violations.within("rate_hz", self.rate_hz, 1.0..=MAX_SAMPLING_RATE_HZ);
        self.check_low_pass(violations);
        violations.within("max_gap_s", self.max_gap_s, 0.001..=1.0);
        self.check_samples(violations);
        if let Split::Windows { stride } = self.split {
            violations.within("split.stride", stride, 1..=1_000_000);
        }
        if self.resampling.makes_samples() && self.columns.time.is_none() {
            violations.add("columns.time", "missing", "a column, which resampling needs");
        }
        violations.part("execution", &self.execution);
    }
}

impl ImportSpec {
    fn check_files(&self, violations: &mut Violations) {
        match (&self.file, self.files.len()) {
            (None, 0) => violations.add("file", "missing", "the SHA-256 of a file, or files"),
            (Some(_), 1..) => violations.add("files", "given beside file", "one of the two"),
            (Some(_), 0) => {}
            (None, count) => violations.length("files", count, 1..=NamedFile::MOST),
        }
        for (i, NamedFile { name, .. }) in self.files.iter().enumerate() {
            if !(1..=NamedFile::NAME_BYTES).contains(&name.len())
                || name.chars().any(char::is_control)
            {
                let allowed =
                    format!("1 to {} bytes without control characters", NamedFile::NAME_BYTES);
                violations.add(&format!("files[{i}].name"), format!("{name:?}"), allowed);
            }
        }
        let (names, files): (Vec<&str>, Vec<String>) =
            self.files.iter().map(|named| (named.name.as_str(), named.file.to_string())).unzip();
        violations.no_duplicates("files.name", &names);
        violations.no_duplicates("files.file", &files);
    }

    fn check_columns(&self, violations: &mut Violations) {
        let joints = self.joints();
        let ImportColumns { u, q, qd, .. } = &self.columns;
        let before = violations.count();
        let has_lists = self.format != FileFormat::Csv;
        for (quantity, names) in [("u", Some(u)), ("q", Some(q)), ("qd", qd.as_ref())] {
            let fit = |count: usize| count == joints || (has_lists && count == 1);
            if let Some(names) = names.filter(|names| !fit(names.len())) {
                let plural = if names.len() == 1 { "" } else { "s" };
                let found = format!("{} column{plural}", names.len());
                let mut allowed = format!("{joints} columns, one for each joint of the robot");
                if self.robot.is_none() {
                    allowed.push_str(
                        ", a Panda because none is named: name another one with \
                         \"robot\": {\"model\": {...}}",
                    );
                }
                if has_lists {
                    allowed.push_str("; or one column of lists");
                }
                violations.add(&format!("columns.{quantity}"), found, allowed);
            }
        }
        self.check_gains(violations);
        if violations.count() == before {
            violations.part("columns", &self.columns);
        }
    }

    fn check_gains(&self, violations: &mut Violations) {
        let Some(gains) = &self.columns.gains else { return };
        violations.one_per_joint("columns.gains", gains, self.joints());
        violations.all_within("columns.gains", gains, &(-1e6..=1e6));
        for (i, _) in gains.iter().enumerate().filter(|(_, gain)| **gain == 0.0) {
            violations.add(&format!("columns.gains[{i}]"), 0, "a number that is not 0");
        }
    }

    fn check_csv(&self, violations: &mut Violations) {
        let CsvLayout { separator, decimal_comma, .. } = self.csv;
        if self.csv != CsvLayout::default() && self.format != FileFormat::Csv {
            let allowed = "only with the format csv";
            violations.add("csv", format!("given with {}", self.format.as_str()), allowed);
        }
        let is_of_numbers = separator.is_ascii_alphanumeric() || ".+-\"\r\n".contains(separator);
        if !separator.is_ascii() || is_of_numbers {
            let allowed =
                "one ASCII character that is no part of a number, such as \";\", \"\\t\" or \" \"";
            violations.add("csv.separator", format!("{separator:?}"), allowed);
        }
        if decimal_comma && separator == ',' {
            let allowed = "another csv.separator than a comma where numbers have decimal commas";
            violations.add("csv.decimal_comma", true, allowed);
        }
    }

    fn check_mcap(&self, violations: &mut Violations) {
        if self.mcap != McapMessages::default() && self.format != FileFormat::Mcap {
            let allowed = "only with the format mcap";
            violations.add("mcap", format!("given with {}", self.format.as_str()), allowed);
        }
        let joints = self.joints();
        if let Some(names) = self.mcap.joints.as_ref().filter(|names| names.len() != joints) {
            let allowed = format!("{joints} names, one for each joint of the robot");
            violations.add("mcap.joints", format!("{} names", names.len()), allowed);
        }
    }

    fn check_samples(&self, violations: &mut Violations) {
        const MOST: u32 = ImportSpec::MOST_SAMPLES;

        violations.within("samples", self.samples.min(MOST), 2..=MOST);
        if self.samples > MOST {
            let allowed = format!(
                "2 to {MOST}; {} cuts a longer recording into trajectories of {MOST} samples",
                Split::in_a_row(MOST)
            );
            violations.add("samples", self.samples, allowed);
        }
    }

    fn check_low_pass(&self, violations: &mut Violations) {
        let Some(edge) = self.low_pass_hz.and_then(LowPassHz::edge) else { return };
        violations.within("low_pass_hz", edge, 0.05..=500.0);
        let rate = self.rate_hz;
        if edge < rate / 20.0 || edge >= rate / 2.0 {
            let allowed =
                format!("{} to below {}, a 20th and a half of rate_hz", rate / 20.0, rate / 2.0);
            violations.add("low_pass_hz", edge, allowed);
        }
        if !self.resampling.makes_samples() {
            let allowed = "left out, or resampling \"linear\" or \"mean\", which leave samples out";
            violations.add("low_pass_hz", edge, allowed);
        }
    }

    fn check_ranges(&self, violations: &mut Violations) {
        let ImportRanges { u_nm, q_rad, qd_rad_s } = self.ranges;
        for (quantity, range) in [("u_nm", u_nm), ("q_rad", q_rad), ("qd_rad_s", qd_rad_s)] {
            let field = format!("ranges.{quantity}");
            match range {
                Some(range) => violations.interval(&field, range, &(-1e6..=1e6)),
                None if self.robot.is_some() => {}
                None => violations.add(&field, "null", "[min, max] where no robot is given"),
            }
        }
    }
}

impl Check for ImportColumns {
    fn check(&self, violations: &mut Violations) {
        let named = self.named();
        let mut first: HashMap<&str, &str> = HashMap::new();
        for (field, name) in &named {
            if name.trim().is_empty() || name.len() > 200 {
                violations.add(field, format!("{name:?}"), "a name of 1 to 200 bytes");
            }
            match first.entry(name.trim()) {
                Entry::Vacant(entry) => drop(entry.insert(field)),
                Entry::Occupied(other) => {
                    let allowed = format!("another column than {}", other.get());
                    violations.add(field, format!("{name:?}"), allowed);
                }
            }
        }
    }
}
