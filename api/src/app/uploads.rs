//! Uploads: files that are sent to become datasets.

use serde_json::{Map, Value};
use spec::{Digest, FileFormat, ImportSpec, JobSpec, SpecError};
use store::{Idempotency, Labels, Reuse};

use crate::app::App;
use crate::app::submission::Submitted;
use crate::error::ApiError;
use crate::upload::IncomingFile;

impl App {
    /// Stores the file and submits its import.
    ///
    /// # Errors
    /// When the spec is refused, which is checked before the file is received. When the file does
    /// not arrive completely; nothing of it is kept then.
    pub(crate) async fn import(
        &self,
        mut file: IncomingFile,
        reuse: Reuse,
        idempotency_key: Option<String>,
    ) -> Result<Submitted, ApiError> {
        let _place = self.places.upload()?;
        let (sent, format) = (self.sent(file.spec.clone()).await?, file.format);
        let read = move || import_spec(sent.value, format);
        let (mut spec, claimed) = self.checks.run(sent.bytes, read).await?;
        let room = self.room().await?;
        let mut writer = self.store.begin_upload().await?;
        while let Some(piece) = file.next().await? {
            writer.write(&piece).await?;
            room.hold(writer.size())?;
        }
        if writer.size() == 0 {
            return Err(SpecError::one("file", "empty", "a file with at least one row").into());
        }
        spec.file = writer.digest();
        if let Some(claimed) = claimed.filter(|claimed| *claimed != spec.file) {
            let allowed = format!("left out, or {}, which this file has", spec.file);
            return Err(SpecError::one("file", claimed.to_string(), allowed).into());
        }
        writer.finish(&file.name).await?;
        let spec = JobSpec::Import(spec);
        let idempotency = idempotency_key.map(|key| Idempotency {
            key,
            request: Digest::of_json(&serde_json::json!([spec.to_json(), reuse == Reuse::Never])),
        });
        self.submit_spec(&spec, reuse, idempotency, Labels::default()).await
    }
}

/// Reads an import spec. It may leave out `kind`, `file` and, if the media type tells it, `format`.
/// Returns the digest that it states for the file, which is not in the returned spec.
fn import_spec(
    sent: Value,
    declared: Option<FileFormat>,
) -> Result<(ImportSpec, Option<Digest>), ApiError> {
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
    let claims_file = fields.contains_key("file");
    fields.entry("file").or_insert_with(|| Digest::of(b"").to_string().into());
    let spec = parse(fields)?;
    if let Some(declared) = declared.filter(|declared| *declared != spec.format) {
        let allowed = format!("{}, as the file is declared", declared.as_str());
        return Err(SpecError::one("format", spec.format.as_str(), allowed).into());
    }
    let claimed = claims_file.then_some(spec.file);
    Ok((spec, claimed))
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
