//! Labels: names, notes and tags that people give to jobs, runs, datasets and checkpoints.

use std::collections::BTreeSet;

use wire::{ItemKind, LabelChange, TextChange};

use crate::database::query::sql;
use crate::database::{Reading, Scope, Transaction};
use crate::{CheckpointId, JobId, Store, StoreError, boxed};

/// The labels of one item.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Labels {
    /// Replaces the name that the item was made with.
    pub name: Option<String>,
    /// A note in Markdown.
    pub note: Option<String>,
    /// Words that lists are filtered by.
    pub tags: BTreeSet<String>,
}

/// The largest number of tags of one item, together with the aliases of a checkpoint.
pub const MAX_TAGS: usize = 32;

/// Number of rows that are folded at once.
const FOLDED_AT_ONCE: i64 = 1000;

impl Labels {
    /// Whether there is no name, no note and no tag.
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
    /// Changes the labels of the item with this id. An alias that another checkpoint has moves to this one.
    ///
    /// # Errors
    /// When there is no such item. [`StoreError::TooManyTags`] when it would have more than
    /// [`MAX_TAGS`]. Nothing has changed then.
    #[boxed]
    pub async fn change_labels(
        &self,
        item: ItemKind,
        id: i64,
        change: &LabelChange,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "changing labels").await?;
        let labels = relabel(&mut tx, item, id, |labels| labels.changed(change)).await?;
        if item == ItemKind::Checkpoint {
            tx.change_aliases(CheckpointId(id), change).await?;
            let aliases = tx.count_aliases(CheckpointId(id)).await?;
            refuse_too_many(item, id, labels.tags.len() + aliases)?;
        }
        tx.commit().await
    }

    /// Makes older jobs searchable, which were made before there was a search.
    pub(crate) async fn fold_names(&self) -> Result<(), StoreError> {
        const OPERATION: &str = "folding names";
        loop {
            let names = self.read(OPERATION).unfolded_names(FOLDED_AT_ONCE).await?;
            if names.is_empty() {
                return Ok(());
            }
            let mut tx = self.begin(Scope::Rows, OPERATION).await?;
            for (job, name) in names {
                let text = searched(Some(&name), &Labels::default()).unwrap_or_default();
                tx.set_searched(job, &text).await?;
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
    relabel(tx, ItemKind::Job, job.0, |found| found.completed(labels)).await?;
    let of_members = Labels { tags: labels.tags.clone(), ..Labels::default() };
    for member in tx.member_ids(job).await? {
        relabel(tx, ItemKind::Job, member.0, |found| found.completed(&of_members)).await?;
    }
    Ok(())
}

async fn relabel(
    tx: &mut Transaction,
    item: ItemKind,
    id: i64,
    change: impl FnOnce(Labels) -> Labels,
) -> Result<Labels, StoreError> {
    let missing = || StoreError::not_found(item.as_str(), id.to_string());
    let (before, made_with) = tx.labels(item, id).await?.ok_or_else(missing)?;
    let after = change(before);
    refuse_too_many(item, id, after.tags.len())?;
    let searched = searched(made_with.as_deref(), &after);
    tx.set_labels(item, id, &after, searched.as_deref()).await?;
    Ok(after)
}

fn refuse_too_many(item: ItemKind, id: i64, tags: usize) -> Result<(), StoreError> {
    let what = item.as_str();
    match tags {
        0..=MAX_TAGS => Ok(()),
        _ => Err(StoreError::TooManyTags { what, id, tags, allowed: MAX_TAGS }),
    }
}

impl Reading<'_> {
    /// Some jobs whose names are not searchable yet.
    pub async fn unfolded_names(&mut self, limit: i64) -> Result<Vec<(JobId, String)>, StoreError> {
        sql("SELECT id, name FROM job WHERE searched IS NULL ORDER BY id LIMIT $1")
            .bind(limit)
            .all(self)
            .await
    }
}

impl Transaction {
    pub async fn set_searched(&mut self, job: JobId, text: &str) -> Result<(), StoreError> {
        sql("UPDATE job SET searched = $1 WHERE id = $2 AND searched IS NULL")
            .bind(text)
            .bind(job)
            .run(self)
            .await
    }

    /// The labels of an item and the name that a job was made with. The row is locked until the
    /// transaction ends.
    pub async fn labels(
        &mut self,
        item: ItemKind,
        id: i64,
    ) -> Result<Option<(Labels, Option<String>)>, StoreError> {
        let table = item.as_str();
        let made_with = if item == ItemKind::Job { "name" } else { "CAST(NULL AS TEXT)" };
        let mut query = sql(format!(
            "SELECT given_name, note, {made_with} AS made_with FROM {table} WHERE id = "
        ));
        query.push_bind(id).push("{locked}");
        let Some(row) = query.optional_row(self).await? else {
            return Ok(None);
        };
        let select = format!("SELECT tag FROM {table}_tag WHERE {table} = ");
        let mut query = sql(select);
        query.push_bind(id);
        let tags: Vec<String> = query.all(self).await?;
        let labels = Labels {
            name: row.get("given_name")?,
            note: row.get("note")?,
            tags: tags.into_iter().collect(),
        };
        Ok(Some((labels, row.get("made_with")?)))
    }

    pub async fn set_labels(
        &mut self,
        item: ItemKind,
        id: i64,
        labels: &Labels,
        searched: Option<&str>,
    ) -> Result<(), StoreError> {
        let table = item.as_str();
        let mut update = sql(format!("UPDATE {table} SET given_name = "));
        update.push_bind(labels.name.clone()).push(", note = ").push_bind(labels.note.clone());
        update.push(", searched = ").push_bind(searched.map(str::to_owned));
        update.push(" WHERE id = ").push_bind(id);
        update.run(self).await?;
        let delete = format!("DELETE FROM {table}_tag WHERE {table} = ");
        let mut delete = sql(delete);
        delete.push_bind(id);
        delete.run(self).await?;
        let insert =
            format!("INSERT INTO {table}_tag ({table}, tag) SELECT labelled.id, new.value FROM ");
        let mut insert = sql(insert);
        insert.push_texts(&labels.tags);
        insert.push(format!(" AS new, {table} AS labelled WHERE labelled.id = ")).push_bind(id);
        insert.run(self).await
    }

    /// Removes aliases of a checkpoint, and gives it others.
    pub async fn change_aliases(
        &mut self,
        checkpoint: CheckpointId,
        change: &LabelChange,
    ) -> Result<(), StoreError> {
        for alias in &change.remove_aliases {
            sql("DELETE FROM checkpoint_alias WHERE checkpoint = $1 AND alias = $2")
                .bind(checkpoint)
                .bind(alias)
                .changed(self)
                .await?;
        }
        for alias in &change.add_aliases {
            sql("INSERT INTO checkpoint_alias (alias, checkpoint) VALUES ($1, $2) \
                 ON CONFLICT (alias) DO UPDATE SET checkpoint = excluded.checkpoint")
            .bind(alias)
            .bind(checkpoint)
            .run(self)
            .await?;
        }
        Ok(())
    }

    pub async fn count_aliases(&mut self, checkpoint: CheckpointId) -> Result<usize, StoreError> {
        let count: i64 = sql("SELECT COUNT(*) FROM checkpoint_alias WHERE checkpoint = $1")
            .bind(checkpoint)
            .one(self)
            .await?;
        Ok(usize::try_from(count).unwrap_or(usize::MAX))
    }

    /// The members of a pipeline, each once. Another job has none.
    pub async fn member_ids(&mut self, pipeline: JobId) -> Result<Vec<JobId>, StoreError> {
        sql("SELECT DISTINCT job FROM pipeline_member WHERE pipeline = $1 ORDER BY job")
            .bind(pipeline)
            .all(self)
            .await
    }
}
