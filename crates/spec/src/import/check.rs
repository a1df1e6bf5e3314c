//! Checks the values of an import.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::spec::{ImportColumns, ImportRanges, ImportSpec, Resampling, Split};
use crate::MAX_POSITION_NOISE_RAD;
use crate::check::{Check, Violations};

impl Check for ImportSpec {
    fn check(&self, violations: &mut Violations) {
        if let Some(robot) = &self.robot {
            violations.part("robot", robot);
        }
        self.check_columns(violations);
        self.check_ranges(violations);
        let noise = 0.0..=MAX_POSITION_NOISE_RAD;
        violations.within("position_noise_rad", self.position_noise_rad, noise);
        violations.within("rate_hz", self.rate_hz, 1.0..=1000.0);
        violations.within("max_gap_s", self.max_gap_s, 0.001..=1.0);
        violations.within("samples", self.samples, 2..=10_000);
        if let Split::Windows { stride } = self.split {
            violations.within("split.stride", stride, 1..=1_000_000);
        }
        if self.resampling == Resampling::Linear && self.columns.time.is_none() {
            violations.add("columns.time", "missing", "a column, which resampling needs");
        }
        violations.part("execution", &self.execution);
    }
}

impl ImportSpec {
    fn check_columns(&self, violations: &mut Violations) {
        let joints = self.joints();
        let ImportColumns { u, q, qd, .. } = &self.columns;
        let before = violations.count();
        for (quantity, names) in [("u", Some(u)), ("q", Some(q)), ("qd", qd.as_ref())] {
            if let Some(names) = names.filter(|names| names.len() != joints) {
                let plural = if names.len() == 1 { "" } else { "s" };
                let found = format!("{} column{plural}", names.len());
                let mut allowed = format!("{joints} columns, one for each joint of the robot");
                if self.robot.is_none() {
                    allowed.push_str(
                        ", a Panda because none is named: name another one with \
                         \"robot\": {\"model\": {...}}",
                    );
                }
                if names.len() == 1 {
                    allowed.push_str(
                        "; a column of lists cannot be imported yet: write each element as a \
                         column of its own",
                    );
                }
                violations.add(&format!("columns.{quantity}"), found, allowed);
            }
        }
        if violations.count() == before {
            violations.part("columns", &self.columns);
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
