//! Flags that several commands share.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use serde::Serialize;
use store::{DatabaseUrl, Location, ObjectsUrl, Retention};
use worker::DeviceKind;

use crate::client::{Client, ClientError};
use crate::output::write_json;

/// Flags for the connection to a server.
#[derive(Debug, Args)]
pub struct ServerArguments {
    /// The server's address: HOST:PORT, http://, https:// or unix:PATH
    #[arg(long, env = "TORQUED_SERVER", value_name = "URL", default_value = DEFAULT_SERVER)]
    server: String,

    /// The server's token, if it requires one
    #[arg(long, env = "TORQUED_TOKEN", value_name = "TOKEN", hide_env_values = true)]
    token: Option<String>,
}

impl ServerArguments {
    pub fn client(&self) -> Result<Client, ClientError> {
        // As for a server, an empty token means no token.
        Client::new(&self.server, self.token.clone().filter(|token| !token.is_empty()))
    }
}

/// Flags for the connection to a server that a command can do without.
#[derive(Debug, Args)]
pub struct OptionalServerArguments {
    /// Ask this server instead of the program itself: HOST:PORT, http://, https:// or unix:PATH
    #[arg(long, env = "TORQUED_SERVER", value_name = "URL")]
    server: Option<String>,

    /// The server's token, if it requires one
    #[arg(long, env = "TORQUED_TOKEN", value_name = "TOKEN", hide_env_values = true)]
    token: Option<String>,
}

impl OptionalServerArguments {
    /// A client of the server, if one was named.
    pub fn client(&self) -> Result<Option<Client>, ClientError> {
        let Some(server) = self.server.clone() else { return Ok(None) };
        ServerArguments { server, token: self.token.clone() }.client().map(Some)
    }
}

/// Flags for the form of a command's output.
#[derive(Clone, Copy, Debug, Args)]
pub struct OutputArguments {
    /// Print the server's answer as JSON; a command that waits prints one line per answer
    #[arg(long)]
    pub json: bool,
}

/// Flags of a command that asks a server and prints its answer.
#[derive(Debug, Args)]
pub struct AskArguments {
    #[command(flatten)]
    pub output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

impl AskArguments {
    pub fn client(&self) -> Result<Client, ClientError> {
        self.server.client()
    }

    /// Prints an answer as JSON, or else as the text that `text` makes of it.
    pub fn print<T: Serialize>(
        &self,
        answer: &T,
        text: impl FnOnce(&T) -> String,
    ) -> anyhow::Result<ExitCode> {
        if self.output.json {
            write_json(answer)?;
        } else {
            println!("{}", text(answer));
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Flags for the labels of a job that is submitted.
#[derive(Clone, Debug, Args)]
pub struct LabelArguments {
    /// The job's name, which replaces the one in its spec
    #[arg(long, value_name = "NAME")]
    name: Option<String>,

    /// A note on the job, in Markdown
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,

    /// A tag for the job and, for a pipeline, for its jobs; may be given several times
    #[arg(long = "tag", value_name = "TAG")]
    tags: Vec<String>,
}

impl LabelArguments {
    /// The parameters `name`, `note` and `tag` of a submission.
    pub fn parameters(&self) -> Vec<(&str, &str)> {
        let named = [("name", &self.name), ("note", &self.note)];
        let named = named.into_iter().filter_map(|(key, text)| Some((key, text.as_deref()?)));
        named.chain(self.tags.iter().map(|tag| ("tag", tag.as_str()))).collect()
    }
}

/// The flag for the configuration file of the server whose store a command works on.
/// `configuration` reads the file.
#[derive(Clone, Debug, Args)]
pub struct ConfigArguments {
    /// The server's TOML file (`serve --config`), which says where the store is; flags and environment variables take
    /// precedence
    #[arg(long, env = "TORQUED_CONFIG", value_name = "FILE")]
    config: Option<PathBuf>,
}

/// Flags for the place of a store.
#[derive(Clone, Debug, Args)]
pub struct StoreArguments {
    /// Folder for database and files; created if missing
    #[arg(long, env = "TORQUED_DATA", value_name = "DIR", default_value = "./torqued-data")]
    pub data: PathBuf,

    /// PostgreSQL database to use instead of SQLite in the folder, as
    /// postgres://USER:PASSWORD@HOST:PORT/DATABASE; servers and workers on many machines may share
    /// it
    #[arg(long, env = "TORQUED_DATABASE", value_name = "URL", hide_env_values = true)]
    pub database: Option<DatabaseUrl>,

    /// Bucket of an S3-compatible store for shards, checkpoints and uploads, instead of the folder,
    /// as s3://BUCKET/PREFIX; environment variables give the store's address and its keys
    /// (docs/scale.md)
    #[arg(long, env = "TORQUED_OBJECTS", value_name = "URL")]
    pub objects: Option<ObjectsUrl>,
}

impl StoreArguments {
    pub fn location(&self) -> Location {
        Location {
            database: self.database.clone(),
            objects: self.objects.clone(),
            ..Location::in_folder(&self.data)
        }
    }
}

/// Flags for retention: the items that go into the trash by themselves, and the age of logs.
#[derive(Clone, Copy, Debug, Args)]
pub struct RetentionArguments {
    /// Days after which failed and cancelled jobs are moved into the trash, unless something
    /// depends on them, 1 to 3650 [default: they stay]
    #[arg(long, env = "TORQUED_KEEP_FAILED_JOBS_DAYS", value_name = "DAYS", value_parser = clap::value_parser!(u16).range(1..=3650))]
    pub keep_failed_jobs_days: Option<u16>,

    /// Newest checkpoints of each training that has ended that stay; the others go into the trash, except the final one, the
    /// best, those with a name, a note, a tag or an alias and those that a job read by their step, 1 to 100000 [default: all stay]
    #[arg(long, env = "TORQUED_KEEP_CHECKPOINTS", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub keep_checkpoints: Option<u32>,

    /// Days after which the logs of jobs that ended are deleted for good, 1 to 3650 [default: they stay]
    #[arg(long, env = "TORQUED_KEEP_LOGS_DAYS", value_name = "DAYS", value_parser = clap::value_parser!(u16).range(1..=3650))]
    pub keep_logs_days: Option<u16>,
}

impl RetentionArguments {
    pub fn retention(self) -> Retention {
        Retention {
            failed_jobs: self.keep_failed_jobs_days.map(days_long),
            checkpoints: self.keep_checkpoints,
            logs: self.keep_logs_days.map(days_long),
        }
    }
}

/// The age from which a file that nothing refers to is deleted. No file takes this long from its first
/// byte to its row. A file that is sent to be imported may take 6 h.
pub const ORPHANED_AFTER: Duration = Duration::from_secs(8 * 60 * 60);

pub fn days_long(days: u16) -> Duration {
    Duration::from_secs(u64::from(days) * 24 * 60 * 60)
}

/// Flags for the device that computes models.
#[derive(Debug, Args)]
pub struct DeviceArguments {
    /// Device to compute models on; `torqued devices` lists them
    #[arg(long, env = "TORQUED_DEVICE", value_name = "NAME", default_value_t)]
    pub device: DeviceKind,
}

/// Reads the name of a worker, which is part of addresses of the API.
///
/// # Errors
/// A text that says which names are allowed.
pub fn worker_name(name: &str) -> Result<String, String> {
    let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
    if (1..=100).contains(&name.len()) && name.bytes().all(is_plain) {
        Ok(name.to_owned())
    } else {
        Err("allowed: 1 to 100 letters, digits, dashes, underscores and dots".to_owned())
    }
}

/// Reads the name of a token.
///
/// A text that says which names are allowed.
pub fn token_name(name: &str) -> Result<String, String> {
    if api::is_token_name(name) {
        Ok(name.to_owned())
    } else {
        Err(format!("allowed: {}", api::TOKEN_NAMES))
    }
}

const DEFAULT_SERVER: &str = "http://127.0.0.1:7070";
