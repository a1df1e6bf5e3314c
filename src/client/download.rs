//! Downloads a file into a folder. An existing part is continued, and the digest is compared.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use reqwest::header::{IF_RANGE, RANGE};
use reqwest::{Method, StatusCode};
use tokio::fs::{self, File};
use tokio::io::AsyncWriteExt;
use wire::StoredFile;

use super::upload::sha256;
use super::{Client, ClientError};

/// How long to wait for a server that does not answer or sends nothing. It may be restarting.
const PATIENCE: Duration = Duration::from_secs(30);

/// Pause before the next request, after one broke off.
const PAUSE: Duration = Duration::from_millis(400);

/// Time limit of a download. It is longer than for other answers.
const TIMEOUT: Duration = Duration::from_secs(24 * 60 * 60);

/// The result of a download.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fetched {
    /// The folder already had the file with this digest.
    Kept,
    Received,
}

impl Client {
    /// Downloads `file` into `folder`. A part that an earlier download left, `NAME.part`, is
    /// continued. `progress` gets the number of bytes so far.
    ///
    /// # Errors
    /// When the server refuses or is silent for too long, the bytes have another digest, or the
    /// folder has a file with this name and other bytes.
    pub async fn fetch(
        &self,
        file: &StoredFile,
        folder: &Path,
        progress: impl Fn(u64),
    ) -> Result<Fetched, ClientError> {
        let path = folder.join(plain(&file.name)?);
        if fs::try_exists(&path).await.map_err(unreadable(&path))? {
            let found = sha256(&path).await.map_err(unreadable(&path))?;
            if found != file.sha256 {
                return Err(ClientError::Differs { path, expected: file.sha256, found });
            }
            progress(file.size);
            return Ok(Fetched::Kept);
        }
        let part = folder.join(format!("{}.part", file.name));
        self.complete(file, &part, progress).await?;
        let found = sha256(&part).await.map_err(unreadable(&part))?;
        if found != file.sha256 {
            fs::remove_file(&part).await.map_err(unwritable(&part))?;
            let name = file.name.clone();
            return Err(ClientError::Checksum { name, expected: file.sha256, found });
        }
        fs::rename(&part, &path).await.map_err(unwritable(&path))?;
        Ok(Fetched::Received)
    }

    /// Requests the missing bytes of `part` until it is complete.
    async fn complete(
        &self,
        file: &StoredFile,
        part: &Path,
        progress: impl Fn(u64),
    ) -> Result<(), ClientError> {
        let opened = File::options().create(true).append(true).open(part).await;
        let mut output = opened.map_err(unwritable(part))?;
        let mut have = output.metadata().await.map_err(unreadable(part))?.len();
        if have > file.size {
            output.set_len(0).await.map_err(unwritable(part))?;
            have = 0;
        }
        let mut last_bytes = Instant::now();
        while have < file.size {
            let before = have;
            let ended = self.receive(file, part, &mut output, &mut have, &progress).await;
            if have > before {
                last_bytes = Instant::now();
            }
            match ended {
                Err(error) if !error.is_unreachable() => return Err(error),
                _ if last_bytes.elapsed() < PATIENCE => {}
                Err(error) => return Err(error),
                Ok(()) => return Err(self.silent(PATIENCE)),
            }
            if have < file.size {
                tokio::time::sleep(PAUSE).await;
            }
        }
        output.sync_all().await.map_err(unwritable(part))
    }

    /// Appends the bytes of one request to `output`. `have` counts all bytes, also if the request
    /// breaks off.
    async fn receive(
        &self,
        file: &StoredFile,
        part: &Path,
        output: &mut File,
        have: &mut u64,
        progress: impl Fn(u64),
    ) -> Result<(), ClientError> {
        let mut request = self.request(Method::GET, &file.url).timeout(TIMEOUT);
        if *have > 0 {
            request = request
                .header(RANGE, format!("bytes={have}-"))
                .header(IF_RANGE, format!("\"{}\"", file.sha256));
        }
        let mut response = self.answer_within(PATIENCE, request).await?;
        if response.status() != StatusCode::PARTIAL_CONTENT {
            output.set_len(0).await.map_err(unwritable(part))?;
            *have = 0;
        }
        loop {
            let chunk = match tokio::time::timeout(PATIENCE, response.chunk()).await {
                Ok(chunk) => chunk.map_err(self.unreachable())?,
                Err(_) => return Err(self.silent(PATIENCE)),
            };
            let Some(chunk) = chunk else { break };
            output.write_all(&chunk).await.map_err(unwritable(part))?;
            *have += chunk.len() as u64;
            progress(*have);
        }
        output.flush().await.map_err(unwritable(part))
    }
}

/// The name, if it does not lead out of the folder.
fn plain(name: &str) -> Result<&str, ClientError> {
    let is_plain = Path::new(name).file_name().is_some_and(|plain| plain == name);
    if is_plain { Ok(name) } else { Err(ClientError::Name { name: name.to_owned() }) }
}

fn unreadable(path: &Path) -> impl Fn(io::Error) -> ClientError {
    let path: PathBuf = path.to_owned();
    move |reason| ClientError::File { path: path.clone(), reason }
}

fn unwritable(path: &Path) -> impl Fn(io::Error) -> ClientError {
    let path: PathBuf = path.to_owned();
    move |reason| ClientError::Write { path: path.clone(), reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_leads_out_of_the_folder() {
        for name in ["", ".", "..", "/etc/passwd", "../x", "a/b", "a/"] {
            assert!(plain(name).is_err(), "{name:?}");
        }
        assert_eq!(plain("trajectories-00000.parquet").unwrap(), "trajectories-00000.parquet");
    }
}
