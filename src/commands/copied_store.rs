//! Copies a store, with its progress and a summary at its end.

use anyhow::{Context, bail};
use store::{Location, StoreContents, Transfer, TransferProgress};

use crate::progress::{self, Part, measure};

/// The verbs for a copy in progress and for a finished one.
#[derive(Clone, Copy)]
pub struct Verbs {
    doing: &'static str,
    done: &'static str,
}

pub const MOVING: Verbs = Verbs { doing: "moving", done: "moved" };
pub const SAVING: Verbs = Verbs { doing: "saving", done: "saved" };
pub const RESTORING: Verbs = Verbs { doing: "restoring", done: "restored" };

/// Makes the copy, shows its progress, and prints what was compared.
///
/// # Errors
/// When it fails or is interrupted. `to` is unfinished then.
pub async fn copy(
    transfer: Transfer,
    from: &Location,
    to: &Location,
    verbs: Verbs,
) -> anyhow::Result<()> {
    let contents = transfer.contents();
    eprintln!("{} {} from {from} to {to}", verbs.doing, describe(&contents));
    let progress = TransferProgress::default();
    let parts = || parts(&contents, &progress);
    let Some(copied) = progress::follow_parts(transfer.run(&progress), parts).await? else {
        bail!("interrupted; {to} is unfinished; repeat the command to continue");
    };
    copied.with_context(|| format!("{to} is unfinished; repeat the command when this is fixed"))?;
    println!("{}", summary(verbs.done, &contents, &progress));
    Ok(())
}

fn summary(done: &str, contents: &StoreContents, progress: &TransferProgress) -> String {
    let found = match progress.found() {
        0 => String::new(),
        found => format!(", {} of them copied before", measure::count(found)),
    };
    let digests = measure::count(contents.objects);
    format!(
        "{done} {}{found}; {digests} SHA-256 digests and all rows are the same",
        describe(contents)
    )
}

fn describe(contents: &StoreContents) -> String {
    let StoreContents { jobs, rows, objects, bytes } = *contents;
    let [jobs, rows, objects] = [jobs, rows, objects].map(measure::count);
    let megabytes = bytes as f64 / 1e6;
    format!("{jobs} jobs ({rows} rows) and {objects} files ({megabytes:.1} MB)")
}

fn parts(contents: &StoreContents, progress: &TransferProgress) -> Vec<Part> {
    let kilobytes = |bytes: u64| bytes.div_ceil(1000);
    let part = |name, unit, done, total| Part { name, unit, done, total };
    vec![
        part("files", "kB", kilobytes(progress.bytes()), kilobytes(contents.bytes)),
        part("rows", "rows", progress.rows(), contents.rows),
        part("compare", "rows", progress.compared(), contents.rows),
    ]
}

/// The command that serves the copy. It leaves out the URL of the database, because that has a
/// password.
pub fn serve_command(to: &Location) -> String {
    let database = if to.database.is_some() { " --database URL" } else { "" };
    let objects = to.objects.iter().map(|url| format!(" --objects {url}")).collect::<String>();
    format!("torqued serve --data {}{database}{objects}", to.folder.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTENTS: StoreContents =
        StoreContents { jobs: 2, rows: 12_345, objects: 7, bytes: 1_234_567 };

    #[test]
    fn no_password_is_repeated() {
        let to = Location {
            database: Some("postgres://lab:secret@db.lab/arms".parse().unwrap()),
            objects: Some("s3://lab/arm".parse().unwrap()),
            ..Location::in_folder("shared")
        };
        let command = "torqued serve --data shared --database URL --objects s3://lab/arm";
        assert_eq!(serve_command(&to), command);
        assert_eq!(to.to_string(), "database arms of PostgreSQL at db.lab:5432 with s3://lab/arm");
    }

    #[test]
    fn the_summary_counts_what_was_compared() {
        let expected = "moved 2 jobs (12 345 rows) and 7 files (1.2 MB); \
                        7 SHA-256 digests and all rows are the same";
        assert_eq!(summary("moved", &CONTENTS, &TransferProgress::default()), expected);
    }
}
