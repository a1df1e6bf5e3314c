//! Files of runs: those of torqued's own runs, including checkpoints, and those that clients sent.

use std::collections::BTreeMap;

use store::TrackedRun;

use super::RunName;
use crate::app::App;
use crate::app::files::Download;
use crate::mlflow::MlflowError;
use crate::mlflow::entities::FileInfo;
use crate::mlflow::limits::ARTIFACT_NAME;
use crate::upload::IncomingBytes;

/// A file or folder of a run, as in its URI: `EXPERIMENT/RUN/artifacts/NAME`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArtifactPlace {
    pub run: RunName,
    /// The name, with slashes between folders. Empty for all files of the run.
    pub name: String,
}

impl ArtifactPlace {
    /// Reads a path after `mlflow-artifacts:/`. The experiment is ignored, because runs have unique
    /// names.
    pub fn parse(path: &str) -> Result<Self, MlflowError> {
        let mut parts = path.trim_matches('/').splitn(4, '/');
        let (Some(_), Some(run), Some("artifacts")) = (parts.next(), parts.next(), parts.next())
        else {
            let message =
                format!("there are no artifacts at {path:?}, only at EXPERIMENT/RUN/artifacts");
            return Err(MlflowError::not_found(message));
        };
        let name = artifact_name(parts.next().unwrap_or_default())?;
        Ok(Self { run: RunName::parse(run), name })
    }
}

/// A relative path that does not leave its folder.
pub fn artifact_name(name: &str) -> Result<String, MlflowError> {
    let is_part = |part: &str| !part.is_empty() && part != "." && part != "..";
    let is_plain = !name.contains(|character: char| character.is_control() || character == '\\');
    let is_name = name.is_empty() || (is_plain && name.split('/').all(is_part));
    if is_name && name.len() <= ARTIFACT_NAME {
        return Ok(name.to_owned());
    }
    let allowed = format!(
        "a relative path of {ARTIFACT_NAME} bytes at most, without `.`, `..`, backslashes and control characters"
    );
    Err(MlflowError::invalid("path", name, &allowed))
}

impl App {
    /// The files and folders directly in a folder of a run, sorted by name.
    pub(crate) async fn list_artifacts(
        &self,
        place: &ArtifactPlace,
    ) -> Result<Vec<FileInfo>, MlflowError> {
        Ok(in_folder(&self.artifact_sizes(&place.run).await?, &place.name))
    }

    pub(crate) async fn mlflow_artifact(
        &self,
        place: &ArtifactPlace,
    ) -> Result<Download, MlflowError> {
        let ArtifactPlace { run, name } = place;
        let saved_as = name.rsplit('/').next().unwrap_or_default().to_owned();
        let file = format!("{name} of run {run}");
        match run {
            RunName::Tracked(identifier) => {
                let run = self.store.tracked_run(identifier).await?;
                let artifact = self.store.tracked_artifact(&run, name).await?;
                Ok(Download::new(saved_as, OCTETS, &artifact.object, file))
            }
            RunName::Own(id) => {
                let run = self.store.run(*id).await?;
                if let Some(rest) = name.strip_prefix(CHECKPOINTS) {
                    return self.checkpoint_of(&run, rest, saved_as, file).await;
                }
                let artifact = self.store.artifact(run.id, name).await?;
                Ok(Download::new(saved_as, &artifact.media_type, &artifact.object, file))
            }
        }
    }

    /// Stores a file from a client. It replaces the run's file with the same name.
    pub(crate) async fn receive_artifact(
        &self,
        place: &ArtifactPlace,
        mut bytes: IncomingBytes,
    ) -> Result<(), MlflowError> {
        let _place = self.places.upload()?;
        let run = self.run_to_fill(place).await?;
        let room = self.room().await?;
        let mut writer = self.store.begin_tracked_artifact(&run).await?;
        while let Some(piece) = bytes.next().await? {
            writer.write(&piece).await?;
            room.hold(writer.size())?;
        }
        Ok(writer.finish_as_artifact(&run.identifier, &place.name).await?)
    }

    /// The run, if a file with this name fits among its files.
    async fn run_to_fill(&self, place: &ArtifactPlace) -> Result<TrackedRun, MlflowError> {
        let run = self.store.tracked_run(place.run.writable()?).await?;
        if place.name.is_empty() {
            return Err(MlflowError::missing("the name of the artifact"));
        }
        let is_above = |above: &str, below: &str| {
            below.strip_prefix(above).is_some_and(|rest| rest.starts_with('/'))
        };
        for artifact in self.store.tracked_artifacts(run.id).await? {
            if is_above(&artifact.name, &place.name) || is_above(&place.name, &artifact.name) {
                let allowed =
                    format!("one that is not a folder of {:?}, and not below it", artifact.name);
                return Err(MlflowError::invalid("path", &place.name, &allowed));
            }
        }
        Ok(run)
    }

    /// Deletes a file, or a folder with everything in it.
    pub(crate) async fn delete_artifacts(&self, place: &ArtifactPlace) -> Result<(), MlflowError> {
        let identifier = place.run.writable()?;
        let sizes = self.artifact_sizes(&place.run).await?;
        let is_meant = |name: &&String| {
            let rest = name.strip_prefix(&place.name);
            place.name.is_empty()
                || rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        let names: Vec<String> = sizes.keys().filter(is_meant).cloned().collect();
        Ok(self.store.delete_tracked_artifacts(identifier, &names).await?)
    }

    /// All files of a run by name, with their sizes.
    async fn artifact_sizes(&self, run: &RunName) -> Result<BTreeMap<String, u64>, MlflowError> {
        let mut sizes = BTreeMap::new();
        match run {
            RunName::Tracked(identifier) => {
                let run = self.store.tracked_run(identifier).await?;
                for artifact in self.store.tracked_artifacts(run.id).await? {
                    sizes.insert(artifact.name, artifact.object.size);
                }
            }
            RunName::Own(id) => {
                let run = self.store.run(*id).await?;
                for artifact in self.store.artifacts(&[run.id]).await? {
                    sizes.insert(artifact.name, artifact.object.size);
                }
                for checkpoint in self.store.checkpoints_of_job(run.job).await? {
                    for file in checkpoint.files {
                        let name = checkpoint_name(checkpoint.step, &file.name);
                        sizes.insert(name, file.object.size);
                    }
                }
            }
        }
        Ok(sizes)
    }

    /// The checkpoint of a file in the checkpoints' folder.
    async fn checkpoint_of(
        &self,
        run: &store::Run,
        rest: &str,
        saved_as: String,
        file: String,
    ) -> Result<Download, MlflowError> {
        let wanted = format!("{CHECKPOINTS}{rest}");
        for checkpoint in self.store.checkpoints_of_job(run.job).await? {
            for found in &checkpoint.files {
                if checkpoint_name(checkpoint.step, &found.name) == wanted {
                    return Ok(Download::new(saved_as, OCTETS, &found.object, file));
                }
            }
        }
        Err(MlflowError::not_found(format!("there is no artifact {file}")))
    }
}

const OCTETS: &str = "application/octet-stream";

/// The folder of a run's checkpoints.
const CHECKPOINTS: &str = "checkpoints/";

fn checkpoint_name(step: u64, file: &str) -> String {
    format!("{CHECKPOINTS}step-{step:08}/{file}")
}

fn in_folder(sizes: &BTreeMap<String, u64>, folder: &str) -> Vec<FileInfo> {
    let prefix = if folder.is_empty() { String::new() } else { format!("{folder}/") };
    let mut files: BTreeMap<String, FileInfo> = BTreeMap::new();
    for (name, size) in sizes {
        let Some(rest) = name.strip_prefix(&prefix) else { continue };
        let first = rest.split('/').next().unwrap_or_default();
        let path = format!("{prefix}{first}");
        let is_dir = first.len() < rest.len();
        let file_size = (!is_dir).then_some(*size);
        files.insert(path.clone(), FileInfo { path, is_dir, file_size });
    }
    files.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_shows_what_is_right_in_it() {
        let names = ["a.txt", "plots/loss.svg", "plots/old/loss.svg", "plots2/x"];
        let sizes = names.into_iter().map(|name| (name.to_owned(), 3)).collect();
        let shown = |folder: &str| {
            let files = in_folder(&sizes, folder);
            files.into_iter().map(|file| (file.path, file.is_dir)).collect::<Vec<_>>()
        };
        let named = |files: &[(&str, bool)]| -> Vec<(String, bool)> {
            files.iter().map(|(path, is_dir)| ((*path).to_owned(), *is_dir)).collect()
        };
        assert_eq!(shown(""), named(&[("a.txt", false), ("plots", true), ("plots2", true)]));
        assert_eq!(shown("plots"), named(&[("plots/loss.svg", false), ("plots/old", true)]));
        assert!(shown("a.txt").is_empty() && shown("nothing").is_empty());
    }

    #[test]
    fn a_name_that_leads_elsewhere_is_refused() {
        for name in ["a", "a/b.txt", "ä b/c", ""] {
            assert_eq!(artifact_name(name).unwrap(), name);
        }
        let long = "x".repeat(ARTIFACT_NAME + 1);
        for name in ["..", "a/../b", "a//b", "/a", "a/", "./a", "a\\b", "a\0b", &long] {
            assert!(artifact_name(name).is_err(), "{name:?}");
        }
        assert!(ArtifactPlace::parse("1/torqued-2/artifacts/../x").is_err());
        let place = ArtifactPlace::parse("/1/torqued-2/artifacts/a/b/").unwrap();
        assert_eq!((place.run.to_string().as_str(), place.name.as_str()), ("torqued-2", "a/b"));
    }
}
