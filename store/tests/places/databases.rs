//! Databases that cannot be used: another encoding, and poolers that share sessions.

use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use sqlx::{Connection, PgConnection};
use store::{Access, Location, Store};
use tempfile::TempDir;
use testbed::Cluster;

async fn refusal(url: &str, access: Access) -> String {
    let folder = tempfile::tempdir().unwrap();
    let database = Some(url.parse().unwrap());
    let location = Location { database, ..Location::in_folder(folder.path()) };
    Store::open_at(&location, access).await.unwrap_err().to_string()
}

/// Caught: a name with a letter that the encoding lacks was answered 500, and its job had no name.
#[tokio::test(flavor = "multi_thread")]
async fn a_database_with_another_encoding_is_refused_at_the_start() {
    let cluster = Cluster::shared();
    for encoding in ["LATIN1", "SQL_ASCII"] {
        let name = format!("test_{}_{}", std::process::id(), encoding.to_lowercase());
        let create =
            format!("CREATE DATABASE {name} ENCODING '{encoding}' LOCALE 'C' TEMPLATE template0");
        cluster.psql("postgres", &create);
        for access in [Access::Server, Access::Worker] {
            let error = refusal(&cluster.url("postgres", &name), access).await;
            let expected = format!("its encoding is {encoding}, allowed: UTF8");
            assert!(error.contains(&expected) && error.contains("createdb --encoding=UTF8"));
        }
        cluster.psql("postgres", &format!("DROP DATABASE {name}"));
    }
}

/// PgBouncer in front of a cluster.
struct Pooler {
    process: Child,
    port: u16,
    _folder: TempDir,
}

impl Pooler {
    /// `None` where it is not installed, or refuses to run.
    async fn start(cluster: &Cluster, database: &str, mode: &str) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let url = cluster.url("postgres", database);
        let host = url.split_once("host=").unwrap().1;
        let settings = format!(
            "[databases]\n* = host={host} user=postgres\n[pgbouncer]\nlisten_addr = 127.0.0.1\n\
             listen_port = {port}\nauth_type = any\npool_mode = {mode}\nunix_socket_dir =\n\
             ignore_startup_parameters = extra_float_digits\n"
        );
        let file = folder.path().join("pgbouncer.ini");
        std::fs::write(&file, settings).unwrap();
        let mut command = Command::new("pgbouncer");
        // It refuses to run as root.
        let is_root =
            std::os::unix::fs::MetadataExt::uid(&std::fs::metadata("/proc/self").ok()?) == 0;
        if is_root {
            std::fs::set_permissions(
                folder.path(),
                std::os::unix::fs::PermissionsExt::from_mode(0o755),
            )
            .unwrap();
            command.args(["--user", "nobody"]);
        }
        let process =
            command.arg(&file).stdout(Stdio::null()).stderr(Stdio::null()).spawn().ok()?;
        let pooler = Self { process, port, _folder: folder };
        let began = Instant::now();
        while PgConnection::connect(&pooler.url(database)).await.is_err() {
            if began.elapsed() > Duration::from_secs(10) {
                return None;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        Some(pooler)
    }

    fn url(&self, database: &str) -> String {
        format!("postgres://postgres@127.0.0.1:{}/{database}", self.port)
    }
}

impl Drop for Pooler {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Caught: "prepared statement does not exist", some time after the start.
#[tokio::test(flavor = "multi_thread")]
async fn a_pooler_that_shares_sessions_is_refused_with_the_mode_that_it_needs() {
    let cluster = Cluster::shared();
    for (mode, is_refused) in [("transaction", true), ("statement", true), ("session", false)] {
        let database = cluster.database();
        let Some(pooler) = Pooler::start(&cluster, database.name(), mode).await else {
            eprintln!("SKIPPED: pgbouncer is not installed");
            return;
        };
        let url = pooler.url(database.name());
        if is_refused {
            let error = refusal(&url, Access::Server).await;
            assert!(error.contains("pool_mode = session"), "{mode}: {error}");
            continue;
        }
        let folder = tempfile::tempdir().unwrap();
        let location =
            Location { database: Some(url.parse().unwrap()), ..Location::in_folder(folder.path()) };
        Store::open_at(&location, Access::Server).await.unwrap().close().await;
    }
}
