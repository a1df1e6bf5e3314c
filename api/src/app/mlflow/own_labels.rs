//! Labels of torqued's own runs, in the form that MLflow's clients set and read: the run's name,
//! its note, and tags. The tag `stage=lab` is MLflow's tag `stage` with the value `lab`. The tag
//! `baseline` has an empty value there.

use std::collections::BTreeSet;

use store::RunId;
use wire::{ItemKind, LabelChange, TextChange};

use crate::app::App;
use crate::app::labels::{TAG, is_tag};
use crate::mlflow::entities::Pair;
use crate::mlflow::{ErrorCode, MlflowError, is_key};

pub const NAME: &str = "mlflow.runName";
pub const NOTE: &str = "mlflow.note.content";

/// All tags of a run and of its job, separated by spaces. Setting it sets those of the run.
pub const TAGS: &str = "torqued.tags";

/// Prefixes of the tags that clients and torqued write themselves.
const RESERVED: [&str; 2] = ["mlflow.", "torqued."];

impl App {
    pub(super) async fn label_own_run(
        &self,
        run: RunId,
        name: Option<String>,
        tags: &[(String, String)],
    ) -> Result<(), MlflowError> {
        let found = self.store.run(run).await?;
        let name = name.map(|name| (NAME.to_owned(), name));
        let tags: Vec<(String, String)> = tags.iter().cloned().chain(name).collect();
        let change = change(&found.tags, &tags)?;
        if change != LabelChange::default() {
            self.label(ItemKind::Run, run.0, &change).await?;
        }
        Ok(())
    }

    pub(super) async fn delete_own_tag(&self, run: RunId, key: &str) -> Result<(), MlflowError> {
        let found = self.store.run(run).await?;
        let change = match key {
            NAME => LabelChange { name: TextChange::Remove, ..LabelChange::default() },
            NOTE => LabelChange { note: TextChange::Remove, ..LabelChange::default() },
            TAGS => LabelChange { tags: Some(Vec::new()), ..LabelChange::default() },
            key => {
                refuse_reserved(key)?;
                let remove_tags = with_key(&found.tags, key);
                if remove_tags.is_empty() {
                    let message = format!("run torqued-{} has no tag {key:?} of its own", run.0);
                    return Err(MlflowError::not_found(message));
                }
                LabelChange { remove_tags, ..LabelChange::default() }
            }
        };
        Ok(self.label(ItemKind::Run, run.0, &change).await?)
    }
}

/// The change of labels that these tags of a client are, `own` being the run's tags.
fn change(own: &[String], set: &[(String, String)]) -> Result<LabelChange, MlflowError> {
    let mut change = LabelChange::default();
    let mut after: BTreeSet<String> = own.iter().cloned().collect();
    for (key, value) in set {
        match key.as_str() {
            NAME => change.name = text(value),
            NOTE => change.note = text(value),
            TAGS => {
                after = value.split_whitespace().map(str::to_owned).collect();
                if let Some(tag) = after.iter().find(|tag| !is_tag(tag)) {
                    let allowed = format!("tags with spaces between them, each {TAG}");
                    return Err(MlflowError::invalid(TAGS, tag, &allowed));
                }
            }
            key => {
                refuse_reserved(key)?;
                let tag = match value.as_str() {
                    "" => key.to_owned(),
                    value => format!("{key}={value}"),
                };
                if !is_tag(&tag) {
                    let allowed = format!("together {TAG}, on a run that is torqued's own");
                    return Err(MlflowError::invalid("KEY=VALUE of a tag", &tag, &allowed));
                }
                after.retain(|other| split(other).0 != key);
                after.insert(tag);
            }
        }
    }
    let before: BTreeSet<String> = own.iter().cloned().collect();
    change.add_tags = after.difference(&before).cloned().collect();
    change.remove_tags = before.difference(&after).cloned().collect();
    Ok(change)
}

/// The tags that clients see one by one: the run's, then those of its job. A key that MLflow does not allow, or that came
/// before, is left to [`TAGS`].
pub fn shown<'a>(own: &'a [String], of_job: &'a [String]) -> Vec<Pair> {
    let mut seen = BTreeSet::new();
    let pairs = own.iter().chain(of_job).map(|tag| split(tag));
    let pairs = pairs.filter(|(key, _)| is_key(key) && !is_reserved(key));
    let mut pairs: Vec<Pair> = pairs
        .filter(|(key, _)| seen.insert(*key))
        .map(|(key, value)| Pair { key: key.to_owned(), value: value.to_owned() })
        .collect();
    pairs.sort_by(|a, b| a.key.cmp(&b.key));
    pairs
}

fn split(tag: &str) -> (&str, &str) {
    tag.split_once('=').unwrap_or((tag, ""))
}

fn with_key(tags: &[String], key: &str) -> Vec<String> {
    tags.iter().filter(|tag| split(tag).0 == key).cloned().collect()
}

/// An empty text is none.
fn text(value: &str) -> TextChange {
    if value.is_empty() { TextChange::Remove } else { TextChange::Set(value.to_owned()) }
}

fn is_reserved(key: &str) -> bool {
    RESERVED.iter().any(|prefix| key.starts_with(prefix))
}

fn refuse_reserved(key: &str) -> Result<(), MlflowError> {
    if !is_reserved(key) {
        return Ok(());
    }
    let message = format!(
        "the tag {key} of torqued's own runs cannot be changed; {NAME}, {NOTE}, {TAGS} and tags that do not begin with {} can",
        RESERVED.join(" or ")
    );
    Err(MlflowError::refused(ErrorCode::PermissionDenied, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(own: &[&str], set: &[(&str, &str)]) -> Result<LabelChange, MlflowError> {
        let own: Vec<String> = own.iter().map(|tag| (*tag).to_owned()).collect();
        let set: Vec<(String, String)> =
            set.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        change(&own, &set)
    }

    #[test]
    fn a_tag_takes_the_place_of_the_one_with_its_key() {
        let change = changed(&["stage=lab", "baseline"], &[("stage", "field"), ("baseline", "")]);
        let change = change.unwrap();
        assert_eq!(
            (change.add_tags, change.remove_tags),
            (vec!["stage=field".into()], vec!["stage=lab".into()])
        );
        let change = changed(&["a", "b"], &[(TAGS, "b c"), ("d", "1")]).unwrap();
        assert_eq!(change.add_tags, ["c", "d=1"]);
        assert_eq!(change.remove_tags, ["a"]);
        assert_eq!(changed(&["a=1"], &[("a", "1")]).unwrap(), LabelChange::default());
    }

    #[test]
    fn a_tag_that_torqued_cannot_have_is_refused_with_what_it_can() {
        let message = changed(&[], &[("stage", "two words")]).unwrap_err().to_string();
        assert!(message.contains("\"stage=two words\", allowed: together 1 to 64"), "{message}");
        let message = changed(&[], &[(TAGS, "a ä")]).unwrap_err().to_string();
        assert!(message.contains("torqued.tags is \"ä\""), "{message}");
        let message = changed(&[], &[("mlflow.user", "ann")]).unwrap_err().to_string();
        assert!(message.contains("mlflow.user of torqued's own runs"), "{message}");
    }

    #[test]
    fn the_runs_own_tag_is_shown_before_its_jobs_and_each_key_once() {
        let own = ["lr=1".to_owned(), "lr=2".to_owned(), "v1+2".to_owned()];
        let of_job = ["lr=3".to_owned(), "sweep/3".to_owned(), "torqued.job=9".to_owned()];
        let shown: Vec<(String, String)> =
            shown(&own, &of_job).into_iter().map(|pair| (pair.key, pair.value)).collect();
        assert_eq!(shown, [("lr".into(), "1".into()), ("sweep/3".into(), String::new())]);
    }
}
