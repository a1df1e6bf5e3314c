//! MLflow's own server with its default settings, on SQLite.

use std::net::TcpListener;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};

use super::client::Client;
use crate::{machine, peers};

/// A start includes the creation of tables.
const STARTS_WITHIN: Duration = Duration::from_secs(180);

pub struct MlflowServer {
    process: Child,
    pub url: String,
}

/// MLflow's name and version.
pub fn version() -> anyhow::Result<String> {
    let python = peers::mlflow()?;
    let script = "import mlflow; print('MLflow', mlflow.__version__)";
    Ok(machine::first_line_of(&python.to_string_lossy(), &["-c", script]))
}

/// The database in the folder of a server.
pub fn database(folder: &Path) -> PathBuf {
    folder.join("mlflow.db")
}

impl MlflowServer {
    pub fn start(folder: &Path) -> anyhow::Result<Self> {
        let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
        let log = std::fs::File::create(folder.join("mlflow.log"))?;
        let process = Command::new(peers::mlflow()?)
            .args(["-m", "mlflow", "server", "--host", "127.0.0.1", "--port", &port.to_string()])
            .arg("--backend-store-uri")
            .arg(format!("sqlite:///{}", database(folder).display()))
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(log.try_clone()?)
            .stderr(log)
            // The server starts more processes, which end with the group.
            .process_group(0)
            .spawn()
            .context("cannot run MLflow's server")?;
        let server = Self { process, url: format!("http://127.0.0.1:{port}") };
        let client = Client::new(&server.url);
        let began = Instant::now();
        while client.get("/health").is_err() {
            ensure!(began.elapsed() < STARTS_WITHIN, "MLflow's server does not answer");
            sleep(Duration::from_millis(200));
        }
        Ok(server)
    }
}

impl Drop for MlflowServer {
    fn drop(&mut self) {
        // The database is not needed any more.
        let group = format!("-{}", self.process.id());
        let _ = Command::new("kill").args(["-KILL", "--", &group]).status();
        let _ = self.process.wait();
    }
}
