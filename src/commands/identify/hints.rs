//! Names the flags of the command in place of the fields of a mapping, which errors name.

/// Fields of a mapping, and the flag that sets each.
const FLAGS: [(&str, &str); 9] = [
    ("\"unwrap\"", "--unwrap"),
    ("csv.decimal_comma", "--decimal-comma"),
    ("csv.separator", "--separator"),
    ("units.time", "--time-unit"),
    ("units.angle", "--angle"),
    ("columns.time", "--time"),
    ("columns.q", "--q"),
    ("columns.u", "--u"),
    ("columns.gains", "--gains"),
];

/// Fields of a mapping that have no flag.
const FIELDS: [&str; 10] = [
    "ranges.q_rad",
    "ranges.qd_rad_s",
    "ranges.u_nm",
    "max_gap_s",
    "csv.header",
    "columns.recording",
    "rate_hz",
    "\"format\"",
    "mcap.joints",
    "mcap.topic",
];

/// A line for an error that names fields of a mapping, where flags declare the columns.
pub fn hint(error: &str) -> Option<String> {
    let mut parts: Vec<String> = FLAGS
        .into_iter()
        .filter(|(field, _)| error.contains(field))
        .map(|(field, flag)| format!("{field} is {flag}"))
        .collect();
    // A wrong unit explains a gap.
    let is_explained = |field: &str| field == "max_gap_s" && error.contains("units.time");
    let fields: Vec<&str> =
        FIELDS.into_iter().filter(|field| error.contains(field) && !is_explained(field)).collect();
    match fields.as_slice() {
        [] => {}
        [field] => parts.push(format!("{field} is a field of a mapping, see --mapping")),
        fields => {
            parts.push(format!("{} are fields of a mapping, see --mapping", fields.join(" and ")));
        }
    }
    (!parts.is_empty()).then(|| format!("hint: {}", parts.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_of_a_mapping_is_named_with_its_flag_or_the_mapping() {
        let degrees = hint("allowed: -20 to 20 rad (ranges.q_rad); say so in units.angle").unwrap();
        assert_eq!(
            degrees,
            "hint: units.angle is --angle; ranges.q_rad is a field of a mapping, see --mapping"
        );
        let wraps = hint("(ranges.qd_rad_s); \"unwrap\": true makes it continuous").unwrap();
        assert_eq!(
            wraps,
            "hint: \"unwrap\" is --unwrap; ranges.qd_rad_s is a field of a mapping, see --mapping"
        );
        let gap = "at most max_gap_s = 0.1; with units.time \"ms\" rows are 0.002 s apart";
        assert_eq!(hint(gap).unwrap(), "hint: units.time is --time-unit");
        assert_eq!(hint("line 502, column \"u3\": nothing"), None);
    }
}
