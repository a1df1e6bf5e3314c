//! Faulty CSV files.

use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;
use serde_json::json;

use super::{Recordings, check_refused, import, spec};

fn good() -> String {
    Recordings::of(&[40]).csv()
}

/// The file with one value replaced, in this row and column.
fn with(row: usize, column: usize, value: &str) -> String {
    let mut lines: Vec<String> = good().lines().map(str::to_owned).collect();
    let mut fields: Vec<&str> = lines[row + 1].split(',').collect();
    fields[column] = value;
    lines[row + 1] = fields.join(",");
    lines.join("\n")
}

#[test]
fn files_of_other_programs_are_read() {
    let spec = spec("csv", &json!({}));
    let expected = import(good(), &spec).unwrap().counts;
    let windows = good().replace('\n', "\r\n");
    let excel = format!("\u{feff}{}", good());
    let quoted = good().replace("arm 0", "\"arm 0\"");
    let unfinished = good().trim_end().to_owned();
    let spaced = good().replace(',', " , ");
    for file in [windows, excel, quoted, unfinished, spaced] {
        assert_eq!(import(file, &spec).unwrap().counts, expected);
    }
}

#[test]
fn a_missing_column_is_named_beside_those_there_are() {
    let file = good().replacen("tau_2", "torque2", 1);
    let spec = spec("csv", &json!({}));
    check_refused(file, &spec, &["\"tau_2\" (columns.u[1])", "\"torque2\"", "\"pos_7\""]);
    let twice = good().replacen("tau_2", "tau_1", 1);
    check_refused(twice, &spec, &["more than one column \"tau_1\""]);
    check_refused(good().replace(',', ";"), &spec, &["separated by commas", "csv.separator"]);
}

#[test]
fn a_file_without_trajectories_counts_what_it_has() {
    let spec = spec("csv", &json!({"split": {"kind": "windows", "stride": 40}}));
    let lines: Vec<String> = good().lines().map(str::to_owned).collect();
    let one = "its only row is 1 recording with 1 sample together, and a trajectory needs";
    check_refused(lines[..2].join("\n"), &spec, &[one]);
    let two = "its 2 rows are 1 recording with 2 samples together";
    check_refused(lines[..3].join("\n"), &spec, &[two]);
}

#[test]
fn a_file_without_a_header_is_told_so() {
    let spec = spec("csv", &json!({}));
    let rows = good().split_once('\n').unwrap().1.to_owned();
    check_refused(rows.clone(), &spec, &["has no header", "add a first line"]);
    // Numbers are possible names.
    let names =
        |name: &str| spec.columns.named().iter().position(|(_, other)| *other == name).unwrap();
    let mut numbered = spec.clone();
    let number = |name: &mut String| *name = names(name).to_string();
    numbered.columns.u.iter_mut().chain(&mut numbered.columns.q).for_each(number);
    numbered.columns.time = Some("0".to_owned());
    numbered.columns.recording = Some("1".to_owned());
    let header: Vec<String> =
        ["1", "0"].map(str::to_owned).into_iter().chain((2..16).map(|k| k.to_string())).collect();
    import(format!("{}\n{rows}", header.join(",")), &numbered).unwrap();
}

/// A spec for [`Recordings`] whose columns have numbers.
fn numbered(layout: &serde_json::Value) -> spec::ImportSpec {
    let numbers = |from: usize| (from..from + 7).map(|k| k.to_string()).collect::<Vec<_>>();
    let columns = json!({"recording": "1", "time": "2", "u": numbers(3), "q": numbers(10)});
    spec("csv", &json!({"columns": columns, "csv": layout}))
}

#[test]
fn columns_without_a_header_have_numbers_and_separators_are_declared() {
    let expected = import(good(), &spec("csv", &json!({}))).unwrap();
    let rows = good().split_once('\n').unwrap().1.replace("arm 0", "0");
    let spaced = rows.replace(',', " \t ").replace('\n', " \r\n  ");
    let german = rows.replace(',', ";").replace('.', ",");
    let spaces = format!("  {}", rows.replace(',', "   "));
    for (file, layout) in [
        (rows.clone(), json!({"header": false})),
        (rows.replace(',', "\t"), json!({"header": false, "separator": "\t"})),
        (german, json!({"header": false, "separator": ";", "decimal_comma": true})),
        (spaces, json!({"header": false, "separator": " "})),
        (spaced, json!({"header": false, "separator": " "})),
    ] {
        let found = import(file, &numbered(&layout)).unwrap();
        assert_eq!(found.samples, expected.samples, "{layout}");
    }
    let mut far = numbered(&json!({"header": false}));
    far.columns.u[0] = "17".to_owned();
    check_refused(rows.clone(), &far, &["no column \"17\" (columns.u[0])", "\"16\""]);
    let commas = rows.replace(',', ";").replace('.', ",");
    let layout = json!({"header": false, "separator": ";"});
    check_refused(commas, &numbered(&layout), &["line 1, column \"4\"", "csv.decimal_comma"]);
    check_refused("", &numbered(&json!({"header": false})), &["it is empty"]);
}

/// A logger that was stopped leaves a part of a line.
#[test]
fn a_last_line_that_is_cut_off_is_left_out_and_named() {
    let split = json!({"split": {"kind": "windows", "stride": 39}, "samples": 39});
    let spec = spec("csv", &split);
    let whole = good();
    let last = whole.trim_end().rfind('\n').unwrap() + 1;
    let without = import(&whole[..last], &spec).unwrap();
    let column_end = whole.trim_end().rfind(',').unwrap() + 1;
    for cut in
        [&whole[..column_end - 4], &whole[..column_end], &format!("{}-", &whole[..column_end])]
    {
        let found = import(cut, &spec).unwrap();
        assert_eq!(found.samples, without.samples, "{cut:?}");
        assert_eq!((found.counts.rows, found.counts.trajectories), (39, 1));
        let expected = "line 41, the last one, is cut off and was left out";
        assert_eq!(found.counts.warnings, [expected]);
    }
    // Where lines follow, or the value is whole, nothing was cut off.
    check_refused(with(7, 4, "1\n"), &spec, &["line 9 has 5 values, allowed: 16"]);
    check_refused(with(39, 15, "soon,"), &spec, &["line 41 has 17 values"]);
    check_refused(with(39, 4, "soon"), &spec, &["line 41, column \"tau_3\""]);
}

/// Some loggers write a row again if there is no newer measurement.
#[test]
fn rows_that_repeat_a_time_are_counted_and_left_out() {
    let expected = import(good(), &spec("csv", &json!({}))).unwrap();
    let mut lines: Vec<String> = good().lines().map(str::to_owned).collect();
    for row in [30, 30, 7] {
        lines.insert(row, lines[row].clone());
    }
    let found = import(lines.join("\n"), &spec("csv", &json!({}))).unwrap();
    assert_eq!(found.samples, expected.samples);
    assert_eq!((found.counts.rows, found.counts.repeated_rows), (43, 3));
    assert_eq!(
        found.counts.warnings,
        ["3 rows repeat the time of the row before and were left out"]
    );
    let mut stuck = Recordings::of(&[40]);
    stuck.times.fill(1.0);
    check_refused(stuck.csv(), &spec("csv", &json!({})), &["has 1 samples"]);
}

#[test]
fn currents_become_torques_with_a_gain_for_each_joint() {
    let mut spec = spec("csv", &json!({}));
    let plain = import(good(), &spec).unwrap();
    spec.columns.gains = Some(vec![10.0, -2.0, 1.0, 1.0, 1.0, 1.0, 0.5]);
    let found = import(good(), &spec).unwrap();
    let values = |imported: &super::Imported, column: &str| {
        let column = imported.samples.column_by_name(column).unwrap().clone();
        column.as_primitive::<arrow_array::types::Float32Type>().values().to_vec()
    };
    for (column, gain) in [("u1", 10.0), ("u2", -2.0), ("u3", 1.0), ("u7", 0.5), ("q2", 1.0)] {
        let expected: Vec<f32> = values(&plain, column).iter().map(|u| gain * u).collect();
        let error = values(&found, column).into_iter().zip(expected).map(|(a, b)| (a - b).abs());
        assert!(error.fold(0.0, f32::max) < 1e-5, "{column}");
    }
    spec.columns.gains = Some(vec![1000.0; 7]);
    check_refused(good(), &spec, &["N·m, allowed: -200 to 200"]);
}

#[test]
fn spaces_around_a_name_of_the_mapping_are_no_part_of_it() {
    let mut spaced = spec("csv", &json!({}));
    for name in spaced.columns.u.iter_mut().chain(&mut spaced.columns.q) {
        *name = format!(" {name}");
    }
    import(good(), &spaced).unwrap();
    import(good().replacen(',', ", ", 15), &spaced).unwrap();
}

#[test]
fn a_value_that_is_no_number_is_named_with_its_place() {
    let spec = spec("csv", &json!({}));
    let place = ["line 9, column \"tau_3\"", "recording"];
    check_refused(with(7, 4, "1,5"), &spec, &["line 9 has 17 values, allowed: 16"]);
    check_refused(with(7, 4, "1.5 Nm"), &spec, &[place[0], "1.5 Nm", "a number"]);
    check_refused(with(7, 4, ""), &spec, &[place[0], "nothing"]);
    check_refused(with(7, 4, "NaN"), &spec, &[place[0], place[1], "finite"]);
    check_refused(with(7, 4, "inf"), &spec, &[place[0], "finite"]);
    check_refused(with(7, 4, "1e9"), &spec, &[place[0], "1000000000 N·m", "-200 to 200"]);
    check_refused(with(7, 1, "soon"), &spec, &["line 9, column \"t\"", "soon"]);
    check_refused(with(7, 1, "NaN"), &spec, &["line 9, column \"t\"", "finite"]);
    check_refused(with(7, 0, ""), &spec, &["line 9, column \"arm\"", "nothing"]);
    check_refused(with(7, 0, &"x".repeat(201)), &spec, &["line 9, column \"arm\"", "201 bytes"]);
}

/// The line number that an editor shows, for all line ends, with empty lines and with values of
/// several lines.
#[test]
fn a_row_is_named_by_its_line_in_an_editor() {
    let spec = spec("csv", &json!({}));
    let bad = with(7, 4, "soon");
    let variants = [
        (bad.clone(), 9),
        (bad.replace('\n', "\r\n"), 9),
        (bad.replacen('\n', "\n\n\n", 2), 13),
        (bad.replacen('\n', "\n\n\n", 2).replace('\n', "\r\n"), 13),
        (bad.replace("arm 0", "\"arm\n0\""), 16),
        (bad.replace("arm 0", "\"arm\n0\"").replace('\n', "\r\n"), 16),
    ];
    for (file, line) in variants {
        check_refused(file.clone(), &spec, &[&format!("line {line}, column \"tau_3\"")]);
        let uneven = file.replacen("soon", "1,5", 1);
        check_refused(uneven, &spec, &[&format!("line {line} has 17 values")]);
    }
    // More rows than are read at once.
    let good = Recordings::of(&[3000]).csv();
    let lines = good.lines().collect::<Vec<_>>();
    let late = format!("{}\r\narm 0,soon{}", lines[..2500].join("\r\n"), ",0".repeat(14));
    check_refused(late, &spec, &["line 2501, column \"t\""]);
}

#[test]
fn what_is_no_csv_is_refused() {
    let spec = spec("csv", &json!({}));
    check_refused("", &spec, &["empty"]);
    check_refused("\n\n", &spec, &["empty"]);
    check_refused(good().lines().next().unwrap(), &spec, &["0 rows"]);
    check_refused(vec![0xff; 1000], &spec, &["UTF-8"]);
    let mut latin1 = b"\xfc,".to_vec();
    latin1.extend(good().into_bytes());
    check_refused(latin1, &spec, &["first line are not UTF-8", "`iconv -f latin1 -t utf8`"]);
    let mut bytes = good().into_bytes();
    let place = bytes.len() - 3;
    bytes[place] = 0xff;
    check_refused(bytes, &spec, &["line 41, column \"pos_7\"", "UTF-8"]);
}

/// Otherwise the rest of the file, which may be gigabytes, would be one value in memory.
#[test]
fn a_quote_that_is_never_closed_ends_at_the_longest_line() {
    let spec = spec("csv", &json!({}));
    let open = with(7, 0, "\"arm 0") + &"1.5,2.5\n".repeat(40_000);
    check_refused(open, &spec, &["after line 8", "65536 bytes", "quote"]);
    check_refused("x".repeat(300_000), &spec, &["65536 bytes"]);
}

#[test]
fn whole_times_keep_all_their_digits() {
    let mut lines = vec![good().lines().next().unwrap().to_owned()];
    let values = ["0.5"; 14].join(",");
    for k in 0..40_i64 {
        let nanoseconds = 1_700_000_000_000_000_001 + k * 16_666_667;
        lines.push(format!("arm 0,{nanoseconds},{values}"));
    }
    let units = json!({"units": {"time": "ns"}});
    let imported = import(lines.join("\n"), &spec("csv", &units)).unwrap();
    let first = imported.table.column(2).as_primitive::<Float64Type>().value(0);
    assert!((first - 1.7e9).abs() < 1e-3, "{first}");
}
