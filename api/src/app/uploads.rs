//! Uploads: files that are sent to become datasets.

use serde_json::{Map, Value};
use spec::{Digest, FileFormat, ImportSpec, JobSpec, NamedFile, SpecError};
use store::{Idempotency, Labels, Reuse};

use crate::app::App;
use crate::app::submission::Submitted;
use crate::error::ApiError;
use crate::upload::IncomingFiles;

impl App {
    /// Stores the files and submits their import.
    ///
    /// # Errors
    /// When the spec is refused, which is checked before a file is received. When a file does not
    /// arrive completely; nothing of it is kept then. Files that arrived before it are kept for
    /// another try.
    pub(crate) async fn import(
        &self,
        mut files: IncomingFiles,
        reuse: Reuse,
        idempotency_key: Option<String>,
        labels: Labels,
    ) -> Result<Submitted, ApiError> {
        let _place = self.places.upload()?;
        let (sent, format) = (self.sent(files.spec.clone()).await?, files.format);
        let read = move || import_spec(sent.value, format);
        let mut spec = self.checks.run(sent.bytes, read).await?;
        let claimed: Vec<Digest> = spec.sources().into_iter().map(|(_, file)| file).collect();
        let room = self.room().await?;
        let mut received: Vec<NamedFile> = Vec::new();
        loop {
            check_format(&files, spec.format)?;
            let mut writer = self.store.begin_upload().await?;
            while let Some(piece) = files.next().await? {
                writer.write(&piece).await?;
                room.hold(writer.size())?;
            }
            if writer.size() == 0 {
                return Err(SpecError::one("file", "empty", "a file with at least one row").into());
            }
            let file = writer.digest();
            check_claim(&spec, &claimed, &files.name, file)?;
            writer.finish(&files.name).await?;
            received.push(NamedFile { name: stem(&files.name), file });
            if received.len() > NamedFile::MOST {
                let (count, most) = (received.len(), NamedFile::MOST);
                let allowed = format!("1 to {most}");
                return Err(SpecError::one("files", count.to_string(), allowed).into());
            }
            if !files.next_file().await? {
                break;
            }
        }
        match (claimed.is_empty(), received.as_slice()) {
            (false, _) => {}
            (true, [only]) => spec.file = Some(only.file),
            (true, _) => spec.files = received,
        }
        // The names of the files were not checked with the rest.
        let spec = spec::parse_json(JobSpec::Import(spec).to_json())?;
        let idempotency = idempotency_key.map(|key| Idempotency {
            key,
            request: Digest::of_json(&serde_json::json!([spec.to_json(), reuse == Reuse::Never])),
        });
        self.submit_spec(&spec, reuse, idempotency, labels).await
    }
}

/// Refuses a file that is declared as another format than that of the import.
fn check_format(files: &IncomingFiles, format: FileFormat) -> Result<(), SpecError> {
    match files.format.filter(|declared| *declared != format) {
        None => Ok(()),
        Some(declared) => {
            let allowed = format!("{}, as {:?} is declared", declared.as_str(), files.name);
            Err(SpecError::one("format", format.as_str(), allowed))
        }
    }
}

/// Refuses a file that is not among those that the spec claims, if it claims any.
fn check_claim(
    spec: &ImportSpec,
    claimed: &[Digest],
    name: &str,
    file: Digest,
) -> Result<(), SpecError> {
    if claimed.is_empty() || claimed.contains(&file) {
        return Ok(());
    }
    match spec.file {
        Some(claimed) => {
            let allowed = format!("left out, or {file}, which this file has");
            Err(SpecError::one("file", claimed.to_string(), allowed))
        }
        None => {
            let allowed = format!("left out, or with {file}, which {name:?} has");
            Err(SpecError::one("files", format!("{} other files", claimed.len()), allowed))
        }
    }
}

/// A file's name without its extension.
fn stem(name: &str) -> String {
    let stem = std::path::Path::new(name).file_stem();
    stem.map_or_else(|| name.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// Reads an import spec. It may leave out `kind`, the files and, if the media type tells it,
/// `format`.
fn import_spec(sent: Value, declared: Option<FileFormat>) -> Result<ImportSpec, ApiError> {
    let Value::Object(mut fields) = sent else {
        return Err(SpecError::one("", "no object", "an import spec, a JSON object").into());
    };
    match fields.get("kind") {
        None => drop(fields.insert("kind".to_owned(), "import".into())),
        Some(kind) if kind == "import" => {}
        Some(kind) => return Err(other_kind(kind)),
    }
    if let Some(declared) = declared {
        fields.entry("format").or_insert_with(|| declared.as_str().into());
    }
    let claims_none = ["file", "files"].iter().all(|field| !fields.contains_key(*field));
    if claims_none {
        fields.insert("file".to_owned(), Digest::of(b"").to_string().into());
    }
    let spec = parse(fields)?;
    Ok(ImportSpec { file: spec.file.filter(|_| !claims_none), ..spec })
}

fn parse(fields: Map<String, Value>) -> Result<ImportSpec, ApiError> {
    match spec::parse_json(Value::Object(fields))? {
        JobSpec::Import(spec) => Ok(spec),
        other => Err(other_kind(&other.kind().as_str().into())),
    }
}

fn other_kind(kind: &Value) -> ApiError {
    SpecError::one("kind", kind.to_string(), "import, or left out").into()
}
