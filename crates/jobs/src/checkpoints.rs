//! The checkpoints that jobs read.

use spec::{CheckpointRef, Digest, JobSpec, Product, SpecError, TrainingRef, TrainingStep};
use store::{Checkpoint, CheckpointId, Need, StoreError, WhichCheckpoint};

use crate::SubmissionError;
use crate::references::{FoundSpec, References, deleted, newest, no_such, stored, training};

/// A checkpoint that a job refers to, and its training.
pub(crate) struct FoundCheckpoint {
    /// The reference, by digest.
    pub reference: CheckpointRef,
    /// The training's digest.
    pub digest: Digest,
    /// The checkpoint, if it exists already.
    pub existing: Option<CheckpointId>,
    /// The training, unless the checkpoint exists already.
    pub need: Option<Need>,
    pub training: JobSpec,
}

impl FoundCheckpoint {
    fn of(found: FoundSpec, reference: impl Fn(Digest) -> CheckpointRef) -> Self {
        Self {
            reference: reference(found.digest),
            digest: found.digest,
            existing: None,
            need: Some(found.need),
            training: found.spec,
        }
    }
}

impl References<'_> {
    pub async fn checkpoint(
        &self,
        reference: &CheckpointRef,
        field: &str,
    ) -> Result<FoundCheckpoint, SubmissionError> {
        match reference {
            CheckpointRef::Job(name) => {
                let found = self.named(name, &format!("{field}.job"))?;
                Ok(FoundCheckpoint::of(found, CheckpointRef::Digest))
            }
            CheckpointRef::Digest(digest) => {
                let found = self.trained(*digest, &format!("{field}.digest")).await?;
                Ok(FoundCheckpoint::of(found, CheckpointRef::Digest))
            }
            CheckpointRef::Best(of) => {
                let found = match of {
                    TrainingRef::Job(name) => self.named(name, &format!("{field}.best.job"))?,
                    TrainingRef::Digest(digest) => {
                        self.trained(*digest, &format!("{field}.best.digest")).await?
                    }
                };
                let field = format!("{field}.best");
                if training(&found.spec, &field)?.validation_fraction == 0.0 {
                    let value = "of a training without validation";
                    let allowed = "of one with a validation_fraction above 0";
                    return Err(SpecError::one(field, value, allowed).into());
                }
                let best = |digest| CheckpointRef::Best(TrainingRef::Digest(digest));
                Ok(FoundCheckpoint::of(found, best))
            }
            CheckpointRef::Checkpoint(id) => {
                let field = format!("{field}.checkpoint");
                match self.store.checkpoint(CheckpointId(*id)).await {
                    Ok(checkpoint) => self.existing(checkpoint, &field).await,
                    Err(StoreError::NotFound { .. }) => {
                        let newest = self.store.checkpoints(newest()).await?;
                        let ids = newest.iter().map(|checkpoint| checkpoint.id.0);
                        Err(no_such(&field, *id, "checkpoint", ids))
                    }
                    Err(error @ (StoreError::InTrash { .. } | StoreError::Purged { .. })) => {
                        Err(deleted(&field, *id, &error))
                    }
                    Err(error) => Err(error.into()),
                }
            }
            CheckpointRef::Alias(alias) => {
                let field = format!("{field}.alias");
                let Some(id) = self.store.checkpoint_of_alias(alias).await? else {
                    let aliases = self.store.aliases().await?;
                    let known: Vec<&str> =
                        aliases.iter().map(|(alias, _)| alias.as_str()).collect();
                    let allowed = match known.as_slice() {
                        [] => "an alias; no checkpoint has one yet".to_owned(),
                        known => format!("one of {}", known.join(", ")),
                    };
                    return Err(SpecError::one(field, alias, allowed).into());
                };
                match self.store.checkpoint(id).await {
                    Ok(checkpoint) => self.existing(checkpoint, &field).await,
                    Err(error @ (StoreError::InTrash { .. } | StoreError::Purged { .. })) => {
                        Err(deleted(&field, id.0, &error))
                    }
                    Err(error) => Err(error.into()),
                }
            }
            CheckpointRef::Step(TrainingStep { digest, step }) => {
                let field = format!("{field}.step");
                let which = WhichCheckpoint::Step(*step);
                match self.store.checkpoint_by_digest(*digest, which).await? {
                    Some(checkpoint) => self.existing(checkpoint, &field).await,
                    None => {
                        let value = format!("{digest} after step {step}");
                        let allowed = "a stored checkpoint, see the training's list";
                        Err(SpecError::one(field, value, allowed).into())
                    }
                }
            }
        }
    }

    /// A checkpoint that exists already. No job has to succeed first, and its training may even
    /// have failed. The final checkpoint may come from any training with the digest.
    async fn existing(
        &self,
        checkpoint: Checkpoint,
        field: &str,
    ) -> Result<FoundCheckpoint, SubmissionError> {
        let training = stored(&self.store.job(checkpoint.job).await?, field)?;
        let reference = if checkpoint.is_final {
            CheckpointRef::Digest(checkpoint.digest)
        } else {
            let Checkpoint { digest, step, .. } = checkpoint;
            CheckpointRef::Step(TrainingStep { digest, step })
        };
        let (digest, existing) = (checkpoint.digest, Some(checkpoint.id));
        Ok(FoundCheckpoint { reference, digest, existing, need: None, training })
    }

    async fn trained(&self, digest: Digest, field: &str) -> Result<FoundSpec, SubmissionError> {
        self.made(digest, Product::Checkpoints, field, &digest.to_string()).await
    }
}
