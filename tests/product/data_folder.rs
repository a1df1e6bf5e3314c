//! An unusable data folder: one clear line, a non-zero exit, and no damage.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection, SqliteConnection};

use crate::product::{Product, run_to_end, torqued};

/// Serves `data`, which must fail. Gives the single line of its output.
fn refusal(data: &Path) -> String {
    let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--log", "error", "--data"]);
    let (code, output, errors) = run_to_end(command.arg(data));
    assert!(code.is_some_and(|code| code != 0), "exit code {code:?}");
    assert_eq!(output, "");
    assert_eq!(errors.lines().count(), 1, "more than one line: {errors}");
    errors
}

#[tokio::test]
async fn a_folder_in_use_is_refused_and_its_server_is_not_disturbed() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let line = refusal(data.path());
    assert!(line.contains("in use") && line.contains(&product.pid().to_string()), "{line}");
    product.get("/healthz").await;
}

#[test]
fn a_folder_that_cannot_be_made_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "not a folder").unwrap();
    let line = refusal(&file.join("data"));
    assert!(line.contains("file/data"), "{line}");
}

/// Permissions do not bind root. There, a folder of the kernel that accepts no files replaces it.
#[test]
fn an_unwritable_folder_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o555)).unwrap();
    let binds = std::fs::write(folder.path().join("probe"), "").is_err();
    let data = if binds { folder.path() } else { Path::new("/proc/self") };
    let line = refusal(data);
    assert!(line.contains(&*data.to_string_lossy()), "{line}");
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
}

#[tokio::test]
async fn a_database_of_a_newer_version_is_refused_and_not_touched() {
    let data = tempfile::tempdir().unwrap();
    Product::start_with(data.path(), &["--workers", "0"]).end_by("TERM");
    let database = database(data.path());
    let options = SqliteConnectOptions::new().filename(&database);
    let mut connection = SqliteConnection::connect_with(&options).await.unwrap();
    let newer = "INSERT INTO _sqlx_migrations
                 (version, description, success, checksum, execution_time)
                 VALUES (9999, 'from the future', TRUE, x'00', 0)";
    sqlx::query(newer).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();

    let before = std::fs::read(&database).unwrap();
    let line = refusal(data.path());
    assert!(line.contains("newer"), "{line}");
    assert_eq!(std::fs::read(&database).unwrap(), before);
}

/// The database file in a data folder.
fn database(data: &Path) -> PathBuf {
    let files = std::fs::read_dir(data).unwrap().map(|entry| entry.unwrap().path());
    let is_database = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extension == "db" || extension == "sqlite")
    };
    files.into_iter().find(is_database).unwrap()
}

#[test]
fn a_port_that_was_asked_for_and_is_taken_is_refused() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let data = tempfile::tempdir().unwrap();
    let mut command = torqued(&["serve", "--log", "error", "--listen", &address, "--data"]);
    let (code, _, errors) = run_to_end(command.arg(data.path()));
    assert_eq!(code, Some(1));
    assert!(errors.contains(&address), "{errors}");
}

#[test]
fn listening_beyond_this_machine_without_a_token_is_refused() {
    let data = tempfile::tempdir().unwrap();
    let mut command = torqued(&["serve", "--log", "error", "--listen", "0.0.0.0:0", "--data"]);
    let (code, _, errors) = run_to_end(command.arg(data.path()));
    assert_eq!(code, Some(1));
    assert!(errors.contains("needs a token"), "{errors}");
}
