//! Several files in one dataset.

use arrow_array::cast::AsArray;
use arrow_array::types::Int64Type;
use recordings::{Files, Frames, ImportError, Rows};
use serde_json::json;
use spec::ImportSpec;

use super::{Imported, Recordings, convert, spec};

/// The rows of named files of text.
fn rows(
    files: Vec<(&'static str, String)>,
    spec: &ImportSpec,
) -> impl Iterator<Item = Result<Rows, ImportError>> {
    Files::new(files.into_iter().map(|(name, text)| {
        let mut frames = Vec::new();
        recordings::decode(bytes::Bytes::from(text), spec, &mut frames)?;
        Ok((Some(name.to_owned()), Frames::new(std::io::Cursor::new(frames), spec)))
    }))
}

fn refused(files: Vec<(&'static str, String)>, spec: &ImportSpec) -> String {
    convert(rows(files, spec), spec).map(|imported| imported.counts).unwrap_err().to_string()
}

#[test]
fn recordings_have_the_names_of_their_files() {
    let both =
        || vec![("mon", Recordings::of(&[50, 90]).csv()), ("tue", Recordings::of(&[45]).csv())];
    let spec = spec("csv", &json!({"split": {"kind": "windows", "stride": 40}}));
    let Imported { table, counts, .. } = convert(rows(both(), &spec), &spec).unwrap();
    assert_eq!((counts.rows, counts.recordings, counts.trajectories), (185, 3, 4));
    let names: Vec<_> = table.column(1).as_string::<i32>().iter().flatten().collect();
    assert_eq!(names, ["mon/arm 0", "mon/arm 1", "mon/arm 1", "tue/arm 0"]);
    // Rows are counted in their own file.
    assert_eq!(table.column(3).as_primitive::<Int64Type>().values(), &[0, 50, 90, 0]);

    // Without a column of names, each file is one recording.
    let mut unnamed = spec;
    unnamed.columns.recording = None;
    let files = vec![("a", Recordings::of(&[50]).csv()), ("b", Recordings::of(&[60]).csv())];
    let Imported { table, counts, .. } = convert(rows(files, &unnamed), &unnamed).unwrap();
    assert_eq!((counts.recordings, counts.dropped_samples), (2, 30));
    let names: Vec<_> = table.column(1).as_string::<i32>().iter().flatten().collect();
    assert_eq!(names, ["a", "b"]);
}

#[test]
fn a_file_begins_a_recording_whatever_the_names() {
    let named = |name: &str| Recordings::of(&[40]).csv().replace("arm 0", name);
    let spec = spec("csv", &json!({}));
    let files = vec![("a", named("b/c")), ("a/b", named("c"))];
    let Imported { table, counts, .. } = convert(rows(files, &spec), &spec).unwrap();
    assert_eq!((counts.recordings, counts.trajectories), (2, 2));
    let names: Vec<_> = table.column(1).as_string::<i32>().iter().flatten().collect();
    assert_eq!(names, ["a/b/c"; 2]);
}

#[test]
fn faults_and_warnings_name_the_file() {
    let spec = spec("csv", &json!({}));
    let good = || ("mon", Recordings::of(&[40]).csv());
    let other = Recordings::of(&[40]).csv().replace("tau_3", "tau_x");
    let error = refused(vec![good(), ("tue", other)], &spec);
    assert!(error.starts_with("file \"tue\": ") && error.contains("\"tau_3\""), "{error}");
    let mut wrong = Recordings::of(&[40]);
    wrong.channels[8][20] = 90.0;
    let error = refused(vec![good(), ("tue", wrong.csv())], &spec);
    assert!(error.starts_with("recording \"tue/arm 0\", line 22"), "{error}");

    let mut cut = Recordings::of(&[41]).csv();
    cut.truncate(cut.len() - 30);
    let files = vec![("sun", cut), good()];
    let Imported { counts, .. } = convert(rows(files, &spec), &spec).unwrap();
    let [warning] = counts.warnings.as_slice() else { panic!("{:?}", counts.warnings) };
    assert!(warning.starts_with("file \"sun\", line 42"), "{warning}");
}
