//! Labels: names, notes and tags that people give to jobs, runs, datasets and checkpoints.

use std::collections::BTreeSet;

use wire::{LabelChange, TextChange};

use crate::boxed;
use crate::database::{Scope, Transaction, sql};
use crate::{JobId, Store, StoreError};

/// A kind of thing that has labels and lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Thing {
    Job,
    Run,
    Dataset,
    Checkpoint,
}

/// The labels of one thing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Labels {
    /// Replaces the name that the thing was made with.
    pub name: Option<String>,
    pub note: Option<String>,
    pub tags: BTreeSet<String>,
}

/// The largest number of tags of one thing.
pub const MAX_TAGS: usize = 32;

/// Number of rows that are folded at once.
const FOLDED_AT_ONCE: i64 = 1000;

impl Thing {
    /// The name of its table. The table of its tags has the suffix `_tag`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Job => "job",
            Self::Run => "run",
            Self::Dataset => "dataset",
            Self::Checkpoint => "checkpoint",
        }
    }
}

impl Labels {
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    fn changed(mut self, change: &LabelChange) -> Self {
        for (label, change) in [(&mut self.name, &change.name), (&mut self.note, &change.note)] {
            match change {
                TextChange::Nothing => {}
                TextChange::Remove => *label = None,
                TextChange::Set(text) => *label = Some(text.clone()),
            }
        }
        if let Some(tags) = &change.tags {
            self.tags = tags.iter().cloned().collect();
        }
        self.tags.extend(change.add_tags.iter().cloned());
        self.tags.retain(|tag| !change.remove_tags.contains(tag));
        self
    }

    /// These labels, with the name and the note of `others` where they have none, and with the tags
    /// of both.
    fn completed(mut self, others: &Self) -> Self {
        self.name = self.name.or_else(|| others.name.clone());
        self.note = self.note.or_else(|| others.note.clone());
        self.tags.extend(others.tags.iter().cloned());
        self
    }
}

/// The text in the form in which words are compared: in lower case letter by letter, the same in
/// every database and locale.
pub(crate) fn folded(text: &str) -> String {
    let lower = text.chars().flat_map(char::to_lowercase);
    // A final sigma counts as an ordinary sigma, because the word may be part of a longer one.
    lower.map(|letter| if letter == 'ς' { 'σ' } else { letter }).collect()
}

/// The text that is searched for words. `made_with` is the name that a job was made with.
pub(crate) fn searched(made_with: Option<&str>, labels: &Labels) -> Option<String> {
    let name = labels.name.as_deref().or(made_with);
    if name.is_none() && labels.note.is_none() {
        return None;
    }
    let note = labels.note.as_deref().unwrap_or_default();
    Some(folded(&format!("{}\n{note}", name.unwrap_or_default())))
}

impl Store {
    /// Changes the labels of the thing with this id.
    ///
    /// # Errors
    /// When there is no such thing. [`StoreError::TooManyTags`] when it would have more than
    /// [`MAX_TAGS`]. Nothing has changed then.
    #[boxed]
    pub async fn change_labels(
        &self,
        thing: Thing,
        id: i64,
        change: &LabelChange,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "changing labels").await?;
        relabel(&mut tx, thing, id, |labels| labels.changed(change)).await?;
        tx.commit().await
    }

    /// Makes older jobs searchable, which were made before there was a search.
    pub(crate) async fn fold_names(&self) -> Result<(), StoreError> {
        const OPERATION: &str = "folding names";
        loop {
            let names = sql!(self.database(), OPERATION, unfolded_names(FOLDED_AT_ONCE))?;
            if names.is_empty() {
                return Ok(());
            }
            let mut tx = self.begin(Scope::Rows, OPERATION).await?;
            for (job, name) in names {
                let text = searched(Some(&name), &Labels::default()).unwrap_or_default();
                sql!(&mut tx, set_searched(job, &text))?;
            }
            tx.commit().await?;
        }
    }
}

/// Labels the jobs of a submission. A job that existed before keeps its name and its note. The
/// members of a pipeline get its tags too.
pub(crate) async fn label_submitted(
    tx: &mut Transaction,
    job: JobId,
    labels: &Labels,
) -> Result<(), StoreError> {
    if labels.is_empty() {
        return Ok(());
    }
    relabel(tx, Thing::Job, job.0, |found| found.completed(labels)).await?;
    let of_members = Labels { tags: labels.tags.clone(), ..Labels::default() };
    for member in sql!(tx, member_ids(job))? {
        relabel(tx, Thing::Job, member.0, |found| found.completed(&of_members)).await?;
    }
    Ok(())
}

async fn relabel(
    tx: &mut Transaction,
    thing: Thing,
    id: i64,
    change: impl FnOnce(Labels) -> Labels,
) -> Result<(), StoreError> {
    let missing = || StoreError::not_found(thing.as_str(), id.to_string());
    let (before, made_with) = sql!(tx, labels(thing, id))?.ok_or_else(missing)?;
    let after = change(before);
    if after.tags.len() > MAX_TAGS {
        return Err(StoreError::TooManyTags { what: thing.as_str(), id, tags: after.tags.len() });
    }
    let searched = searched(made_with.as_deref(), &after);
    sql!(tx, set_labels(thing, id, &after, searched.as_deref()))
}
