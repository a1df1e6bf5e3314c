use store::{
    CheckpointId, ItemKind, JobId, LabelChange, Labels, Listing, MAX_TAGS, NewJob, Reuse,
    StoreError, Submission, TextChange,
};

use super::{Fixture, alone, checkpoints::commit, digest_of, pipeline, simulate, train};

pub fn naming(name: &str) -> LabelChange {
    LabelChange { name: TextChange::Set(name.to_owned()), ..LabelChange::default() }
}

pub fn tagging(tags: &[&str]) -> LabelChange {
    let add_tags = tags.iter().map(|tag| (*tag).to_owned()).collect();
    LabelChange { add_tags, ..LabelChange::default() }
}

pub fn labels(name: Option<&str>, tags: &[&str]) -> Labels {
    let tags = tags.iter().map(|tag| (*tag).to_owned()).collect();
    Labels { name: name.map(str::to_owned), note: None, tags }
}

/// Name, note, own tags and the job's tags of a thing.
type Shown = (Option<String>, Option<String>, Vec<String>, Vec<String>);

async fn shown(f: &Fixture, item: ItemKind, id: i64) -> Shown {
    match item {
        ItemKind::Job => {
            let job = f.store.job(JobId(id)).await.unwrap();
            (Some(job.name), job.note, job.tags, Vec::new())
        }
        ItemKind::Run => {
            let run = f.store.run(store::RunId(id)).await.unwrap();
            (Some(run.name), run.note, run.tags, run.job_tags)
        }
        ItemKind::Dataset => {
            let dataset = f.store.dataset(store::DatasetId(id)).await.unwrap();
            (Some(dataset.name), dataset.note, dataset.tags, dataset.job_tags)
        }
        ItemKind::Checkpoint => {
            let checkpoint = f.store.checkpoint(CheckpointId(id)).await.unwrap();
            (checkpoint.name, checkpoint.note, checkpoint.tags, checkpoint.job_tags)
        }
    }
}

/// Makes a training with a checkpoint and a simulation, and gives the ids of their things.
pub async fn one_of_each(f: &Fixture) -> [(ItemKind, i64); 4] {
    let training = f.submit_one(train(&simulate(1), vec![])).await;
    let checkpoint = commit(f, &f.must_claim().await, 100, false).await;
    let dataset = f.submit_one(simulate(1)).await;
    let run = f.store.run_of_job(training).await.unwrap().id;
    let dataset = f.store.job(dataset).await.unwrap().dataset.unwrap();
    [
        (ItemKind::Job, training.0),
        (ItemKind::Run, run.0),
        (ItemKind::Dataset, dataset.0),
        (ItemKind::Checkpoint, checkpoint.0),
    ]
}

pub async fn labels_are_given_changed_and_taken_away(f: Fixture) {
    for (item, id) in one_of_each(&f).await {
        let before = shown(&f, item, id).await;
        let given = LabelChange {
            note: TextChange::Set("# What\n\n- 50 % \"ä\" $1\n".to_owned()),
            tags: Some(vec!["b".to_owned(), "a/1".to_owned(), "B".to_owned(), "b".to_owned()]),
            ..naming("A näme")
        };
        f.store.change_labels(item, id, &given).await.unwrap();
        let after = shown(&f, item, id).await;
        assert_eq!(after.0.as_deref(), Some("A näme"), "{item:?}");
        assert_eq!(after.1.as_deref(), Some("# What\n\n- 50 % \"ä\" $1\n"));
        assert_eq!(after.2, ["B", "a/1", "b"]);

        let tags = LabelChange {
            remove_tags: vec!["b".to_owned(), "absent".to_owned()],
            ..tagging(&["c", "B"])
        };
        f.store.change_labels(item, id, &tags).await.unwrap();
        let changed = shown(&f, item, id).await;
        assert_eq!(changed.2, ["B", "a/1", "c"]);
        assert_eq!((changed.0, changed.1), (after.0, after.1), "the others stay");

        let gone = LabelChange {
            name: TextChange::Remove,
            note: TextChange::Remove,
            tags: Some(vec![]),
            ..LabelChange::default()
        };
        f.store.change_labels(item, id, &gone).await.unwrap();
        assert_eq!(shown(&f, item, id).await, before);
        let error = f.store.change_labels(item, 77, &naming("x")).await.unwrap_err();
        assert_eq!(error.to_string(), format!("there is no {} 77", item.as_str()));
    }
}

pub async fn a_run_and_a_dataset_have_the_name_and_show_the_tags_of_their_job(f: Fixture) {
    let [(_, job), run, dataset, checkpoint] = one_of_each(&f).await;
    f.store.change_labels(ItemKind::Job, job, &naming("the training")).await.unwrap();
    f.store.change_labels(ItemKind::Job, job, &tagging(&["x"])).await.unwrap();
    let (name, _, own, of_job) = shown(&f, run.0, run.1).await;
    assert_eq!((name.as_deref(), own, of_job), (Some("the training"), vec![], vec!["x".into()]));
    assert_eq!(shown(&f, dataset.0, dataset.1).await.0.as_deref(), Some("train-set"));
    assert_eq!(shown(&f, checkpoint.0, checkpoint.1).await.0, None);
    f.store.change_labels(run.0, run.1, &naming("its own")).await.unwrap();
    assert_eq!(shown(&f, run.0, run.1).await.0.as_deref(), Some("its own"));
    assert_eq!(shown(&f, ItemKind::Job, job).await.0.as_deref(), Some("the training"));
}

fn aliases(add: &[&str], remove: &[&str]) -> LabelChange {
    let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    LabelChange { add_aliases: names(add), remove_aliases: names(remove), ..LabelChange::default() }
}

pub async fn an_alias_stands_for_one_checkpoint_and_moves(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let [first, second] =
        [commit(&f, &task, 100, false).await, commit(&f, &task, 200, false).await];
    let change = async |id: CheckpointId, add: &[&str], remove: &[&str]| {
        f.store.change_labels(ItemKind::Checkpoint, id.0, &aliases(add, remove)).await
    };
    let of = async |id: CheckpointId| f.store.checkpoint(id).await.unwrap().aliases;
    change(first, &["champion", "b", "champion"], &[]).await.unwrap();
    assert_eq!(of(first).await, ["b", "champion"]);
    change(second, &["champion"], &["b"]).await.unwrap();
    assert_eq!(
        (of(first).await, of(second).await),
        (vec!["b".to_owned()], vec!["champion".to_owned()])
    );
    assert_eq!(f.store.checkpoint_of_alias("champion").await.unwrap(), Some(second));
    assert_eq!(f.store.checkpoint_of_alias("Champion").await.unwrap(), None);
    let all = f.store.aliases().await.unwrap();
    assert_eq!(all, [("b".to_owned(), first), ("champion".to_owned(), second)]);
    let tagged = Listing { tags: vec!["champion".to_owned()], ..Listing::default() };
    let found = f.store.list_checkpoints(&tagged).await.unwrap().items;
    assert_eq!(found.iter().map(|checkpoint| checkpoint.id).collect::<Vec<_>>(), [second]);

    // A checkpoint with an alias outlives newer ones.
    commit(&f, &task, 300, false).await;
    f.store.prune_checkpoints(task.fence, 0).await.unwrap();
    let left = f.store.checkpoints_of_job(task.job).await.unwrap();
    assert_eq!(left.iter().map(|checkpoint| checkpoint.id).collect::<Vec<_>>(), [first, second]);

    let many: Vec<String> = (0..MAX_TAGS).map(|i| format!("a{i}")).collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    let error = change(second, &many, &[]).await.unwrap_err();
    assert!(matches!(error, StoreError::TooManyTags { tags: 33, .. }), "{error}");
    assert_eq!(of(second).await, ["champion"], "nothing has changed");
    change(second, &[], &["champion", "absent"]).await.unwrap();
    assert_eq!(f.store.checkpoint_of_alias("champion").await.unwrap(), None);
}

pub async fn a_thing_has_so_many_tags_and_no_more(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let many: Vec<String> = (0..MAX_TAGS).map(|i| format!("t{i:02}")).collect();
    let all = LabelChange { tags: Some(many.clone()), ..LabelChange::default() };
    f.store.change_labels(ItemKind::Job, job.0, &all).await.unwrap();
    let error = f.store.change_labels(ItemKind::Job, job.0, &tagging(&["more"])).await.unwrap_err();
    assert!(matches!(error, StoreError::TooManyTags { tags: 33, .. }), "{error}");
    assert_eq!(f.store.job(job).await.unwrap().tags, many);
    // A tag may be added that exists already, or that replaces another.
    f.store.change_labels(ItemKind::Job, job.0, &tagging(&["t00"])).await.unwrap();
    let change = LabelChange { remove_tags: vec!["t00".to_owned()], ..tagging(&["more"]) };
    f.store.change_labels(ItemKind::Job, job.0, &change).await.unwrap();
}

pub async fn a_submission_brings_labels_that_no_digest_knows(f: Fixture) {
    let with = |labels: Labels| Submission { labels, ..alone(simulate(1)) };
    let first = f.submit(with(labels(Some("mine"), &["a"]))).await;
    let job = f.store.job(first.job).await.unwrap();
    assert_eq!((job.name.as_str(), &job.tags[..]), ("mine", &["a".to_owned()][..]));
    assert_eq!(job.digest, digest_of(&simulate(1)));
    let note = Some("a note".to_owned());
    let second = f.submit(with(Labels { note, ..labels(Some("yours"), &["b"]) })).await;
    assert_eq!((second.job, second.reused), (first.job, true));
    let job = f.store.job(first.job).await.unwrap();
    assert_eq!((job.name.as_str(), job.tags.join(" ").as_str()), ("mine", "a b"));
    assert_eq!(job.note.as_deref(), Some("a note"));
}

pub async fn the_tags_of_a_pipeline_are_those_of_its_members(f: Fixture) {
    let shared =
        f.submit(Submission { labels: labels(None, &["old"]), ..alone(simulate(1)) }).await;
    let labelled = Submission { labels: labels(Some("sweep"), &["x"]), ..pipeline(1) };
    let submitted = f.submit(labelled).await;
    let members = f.members(submitted.job).await;
    assert_eq!(members[0], shared.job);
    let mut found = Vec::new();
    for job in [&[submitted.job][..], &members[..]].concat() {
        let job = f.store.job(job).await.unwrap();
        found.push((job.name, job.tags.join(" ")));
    }
    let expected = [("sweep", "x"), ("train-set", "old x"), ("train", "x"), ("evaluate", "x")];
    assert_eq!(found, expected.map(|(name, tags)| (name.to_owned(), tags.to_owned())));

    let many: Vec<String> = (0..MAX_TAGS).map(|i| format!("t{i:02}")).collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    let refused = Submission {
        labels: labels(None, &many),
        reuse: Reuse::SameDigest,
        ..super::pipeline_of(vec![simulate(1), NewJob { name: "other".into(), ..simulate(2) }])
    };
    let error = f.store.submit(refused).await.unwrap_err();
    assert!(matches!(error, StoreError::TooManyTags { .. }), "{error}");
    let all = f.store.list_jobs(&Listing::default()).await.unwrap().items;
    assert_eq!(all.len(), 4, "nothing is submitted");
}

pub async fn a_pruned_checkpoint_takes_its_labels_along(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let pruned = commit(&f, &task, 100, false).await;
    f.store.change_labels(ItemKind::Checkpoint, pruned.0, &tagging(&["kept?"])).await.unwrap();
    commit(&f, &task, 200, false).await;
    f.store.prune_checkpoints(task.fence, 1).await.unwrap();
    let tagged = Listing { tags: vec!["kept?".to_owned()], ..Listing::default() };
    assert!(f.store.list_checkpoints(&tagged).await.unwrap().items.is_empty());
    // A checkpoint of the same step keeps its labels.
    let kept = commit(&f, &task, 300, false).await;
    f.store.change_labels(ItemKind::Checkpoint, kept.0, &naming("good")).await.unwrap();
    assert_eq!(commit(&f, &task, 300, true).await, kept);
    assert_eq!(f.store.checkpoint(kept).await.unwrap().name.as_deref(), Some("good"));
}
