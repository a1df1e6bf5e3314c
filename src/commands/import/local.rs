//! Opens the files of an import to read them on this machine, without the server.

use std::fs::File;

use anyhow::{Context, bail};
use recordings::DecoderProgram;
use serde_json::{Value, json};
use spec::{Digest, ImportSpec, JobSpec, RobotReference};
use worker::RehearsedFile;

use crate::client::{Client, RecordedFile};
use crate::commands::worker::decoder;

/// Files that are read as their import would.
pub(super) struct LocalImport {
    pub decoder: DecoderProgram,
    pub files: Vec<RehearsedFile>,
    pub spec: ImportSpec,
}

impl LocalImport {
    /// Opens `files`. Only robots that `spec` names need the server.
    pub async fn open(
        client: &Client,
        files: &[RecordedFile],
        mut spec: Value,
    ) -> anyhow::Result<Self> {
        for named in spec::named_robots(&mut spec)? {
            let RobotReference::Id(id) = named.robot else {
                bail!(
                    "{} is a digest, allowed where files are read on this machine: {{\"robot\": ID}}",
                    named.field
                );
            };
            *named.place = client.get(&format!("/v1/robots/{id}/description.json")).await?;
        }
        spec["kind"] = json!("import");
        // No digest is needed where nothing is stored; those of several files have to differ.
        let digests: Vec<Digest> =
            (0..files.len()).map(|i| Digest::of(i.to_string().as_bytes())).collect();
        RecordedFile::state(files, &digests, &mut spec);
        let JobSpec::Import(spec) = spec::parse(spec.to_string().as_bytes())? else {
            bail!("the spec is not that of an import");
        };
        let open = |RecordedFile { path, name }: &RecordedFile| -> anyhow::Result<RehearsedFile> {
            Ok(RehearsedFile {
                recording: name.clone(),
                name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                content: File::open(path)
                    .with_context(|| format!("cannot read {}", path.display()))?,
            })
        };
        let files = files.iter().map(open).collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Self { decoder: decoder()?, files, spec })
    }
}
