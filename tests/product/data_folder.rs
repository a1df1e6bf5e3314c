//! An unusable data folder: one clear line, a non-zero exit, and no damage.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection, SqliteConnection};

use crate::product::{Product, run_to_end, small_pipeline, torqued};

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

/// Caught: a server took the folder of a project over and deleted the meshes in it.
#[test]
fn a_folder_with_files_of_others_is_refused_until_somebody_confirms_it() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("objects/meshes/link1.stl");
    std::fs::create_dir_all(mesh.parent().unwrap()).unwrap();
    std::fs::write(&mesh, "solid").unwrap();
    let long_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(3 * 86_400);
    std::fs::File::options().write(true).open(&mesh).unwrap().set_modified(long_ago).unwrap();
    let line = refusal(folder.path());
    for part in ["objects/meshes", "--claim-place"] {
        assert!(line.contains(part), "{part}: {line}");
    }
    let made: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(made.len(), 1, "{made:?}");
    Product::start_with(folder.path(), &["--workers", "0", "--claim-place"]).end_by("TERM");
    Product::start_with(folder.path(), &["--workers", "0"]).end_by("TERM");
    assert_eq!(std::fs::read_to_string(mesh).unwrap(), "solid");
}

/// Caught: after the disk with the files was gone, `/healthz` said "ok" and new files were written
/// under the mount point.
#[tokio::test]
async fn a_server_whose_files_vanish_is_degraded_and_one_without_them_does_not_start() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    product.when_worker_is_there().await;
    let job = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    product.succeeded(job).await;
    let (objects, away) = (data.path().join("objects"), data.path().join("away"));
    std::fs::rename(&objects, &away).unwrap();
    std::fs::create_dir(&objects).unwrap();
    let health = product.get("/healthz").await;
    assert_eq!(health["status"], "degraded", "{health:#}");
    assert!(health["reasons"][0].as_str().unwrap().contains("has no store.json"), "{health:#}");
    let doctor = |more: &[&str]| {
        let (code, output, _) =
            run_to_end(torqued(&["doctor", "--data"]).arg(data.path()).args(more));
        assert_eq!(code, Some(1), "{output}");
        output
    };
    assert!(doctor(&["--server", &product.url]).contains("has no store.json"));
    let mut spec = small_pipeline()["jobs"]["test-grid"].clone();
    spec["seed"] = 7.into();
    let waiting = product.submit(&spec).await;
    tokio::time::sleep(std::time::Duration::from_secs(4)).await;
    assert_eq!(product.get(&format!("/v1/jobs/{waiting}")).await["state"], "queued");
    product.end_by("TERM");
    let line = refusal(data.path());
    assert!(line.contains("has no store.json") && line.contains("mount the disk"), "{line}");
    assert!(doctor(&["--server", "http://127.0.0.1:1"]).contains("WRONG  files"));
    assert_eq!(std::fs::read_dir(&objects).unwrap().count(), 0, "written under the mount point");

    std::fs::remove_dir(&objects).unwrap();
    std::fs::rename(&away, &objects).unwrap();
    let product = Product::start(data.path());
    product.succeeded(waiting).await;
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
