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
    check_refused(good().replace(',', ";"), &spec, &["separated by commas"]);
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
