//! Deletion and restoration.

use std::collections::BTreeSet;
use std::time::Duration;

use bytes::Bytes;
use serde_json::json;
use spec::Digest;
use store::{
    CheckpointFile, ClaimedTask, DeletionOrder, Item, ItemKind, JobFilter, JobId, JobState, Need,
    NewArtifact, NewCheckpoint, Page, Relation, Respect, Ripe, Store, StoreError, TrashPlace,
    WhichCheckpoint, object_path,
};

use super::labels::naming;
use super::{Fixture, LONG, alone, evaluate, pipeline, simulate, train};

pub(super) const ASKED: DeletionOrder<'_> =
    DeletionOrder { respect: Respect::All, keep: LONG, reason: None };

pub(super) const FORCED: DeletionOrder<'_> =
    DeletionOrder { respect: Respect::Open, keep: LONG, reason: None };

/// Everything, whatever its date.
pub(super) const ANY: Ripe = Ripe::After(Duration::ZERO);

/// Completes all tasks. Each leaves the results of its kind.
pub(super) async fn work(f: &Fixture) {
    while let Some(task) = f.claim().await {
        match task.kind.as_str() {
            "simulate" => {
                let shard = f.publish_shard(&task).await;
                f.store.commit_shard(task.fence, &shard, None).await.unwrap();
            }
            "train" => {
                checkpoint(f, &task, 5, false).await;
                checkpoint(f, &task, 10, true).await;
                f.store.complete(task.fence, None).await.unwrap();
            }
            _ => {
                if task.run.is_some() {
                    let (name, bytes) = ("report.json", Bytes::from_static(b"{}"));
                    let new = NewArtifact { name, media_type: "application/json", bytes };
                    f.store.put_artifact(task.fence, new).await.unwrap();
                }
                f.store.complete(task.fence, Some(&json!({"n": 1}))).await.unwrap();
            }
        }
    }
}

pub(super) async fn checkpoint(f: &Fixture, task: &ClaimedTask, step: u64, is_final: bool) {
    let path = object_path::checkpoint(task.job, step, task.fence.epoch, "model.safetensors");
    let object = f.store.put_object(&path, Bytes::from(format!("step {step}"))).await.unwrap();
    let files = vec![CheckpointFile { name: "model.safetensors".to_owned(), object }];
    let metrics = [("loss".to_owned(), 0.5)].into();
    let new = NewCheckpoint { step, is_final, is_best: is_final, metrics, files };
    f.store.commit_checkpoint(task.fence, &new).await.unwrap();
}

/// A pipeline that has succeeded, and its members.
pub(super) async fn finished(f: &Fixture, seed: u64) -> (JobId, [JobId; 3]) {
    let id = f.submit(pipeline(seed)).await.job;
    work(f).await;
    assert_eq!(f.state(id).await, JobState::Succeeded);
    (id, f.members(id).await.try_into().unwrap())
}

pub(super) async fn dataset_of(f: &Fixture, job: JobId) -> Item {
    f.store.job(job).await.unwrap().dataset.unwrap().into()
}

async fn run_of(f: &Fixture, job: JobId) -> Item {
    f.store.job(job).await.unwrap().run.unwrap().into()
}

async fn final_checkpoint(f: &Fixture, job: JobId) -> Item {
    f.store.checkpoints_of_job(job).await.unwrap().last().unwrap().id.into()
}

/// Whether something can be read.
pub(super) async fn is_there(store: &Store, item: Item) -> bool {
    let found = match item.kind {
        ItemKind::Job => store.job(JobId(item.id)).await.map(|_| ()),
        ItemKind::Run => store.run(store::RunId(item.id)).await.map(|_| ()),
        ItemKind::Dataset => store.dataset(store::DatasetId(item.id)).await.map(|_| ()),
        ItemKind::Checkpoint => store.checkpoint(store::CheckpointId(item.id)).await.map(|_| ()),
    };
    match found {
        Ok(()) => true,
        Err(StoreError::InTrash { .. } | StoreError::Purged { .. }) => false,
        Err(error) => panic!("{item}: {error}"),
    }
}

/// The things in the lists.
pub(super) async fn listed(store: &Store) -> BTreeSet<Item> {
    let page = Page { before: None, limit: 500 };
    let jobs = store.jobs(JobFilter::default(), page).await.unwrap();
    let runs = store.runs(None, page).await.unwrap();
    let datasets = store.datasets(None, page).await.unwrap();
    let checkpoints = store.checkpoints(page).await.unwrap();
    let jobs = jobs.iter().map(|row| row.id.into());
    let runs = runs.iter().map(|row| row.id.into());
    let datasets = datasets.iter().map(|row| row.id.into());
    jobs.chain(runs).chain(datasets).chain(checkpoints.iter().map(|row| row.id.into())).collect()
}

/// Checks that every object of a row exists with its bytes, and gives the number of objects.
pub(super) async fn assert_whole(store: &Store) -> usize {
    let (mut place, mut count) = (store::ObjectPlace::default(), 0);
    loop {
        let page = store.next_objects(&mut place).await.unwrap();
        if page.is_empty() {
            return count;
        }
        for object in page {
            store.check_object(&object).await.unwrap();
            count += 1;
        }
    }
}

pub async fn what_was_deleted_is_gone_until_it_is_restored(f: Fixture) {
    let (id, [simulated, trained, evaluated]) = finished(&f, 1).await;
    let before = listed(&f.store).await;
    let items = [
        id.into(),
        evaluated.into(),
        dataset_of(&f, simulated).await,
        run_of(&f, trained).await,
        final_checkpoint(&f, trained).await,
    ];
    for item in items {
        let deleted = f.store.delete(item, &FORCED).await.unwrap();
        assert_eq!(deleted.purge_at.milliseconds() - deleted.deleted_at.milliseconds(), 600_000);
        for gone in deleted.along.iter().chain([&item]) {
            assert!(!is_there(&f.store, *gone).await, "{gone}");
            assert!(!listed(&f.store).await.contains(gone), "{gone}");
        }
        let again = f.store.delete(item, &FORCED).await.unwrap_err();
        assert!(matches!(again, StoreError::InTrash { .. }), "{again}");
        let mut back = f.store.restore(item).await.unwrap();
        back.sort_unstable();
        let mut along = deleted.along;
        along.sort_unstable();
        assert_eq!(back, along);
        assert_eq!(listed(&f.store).await, before, "{item}");
        let again = f.store.restore(item).await.unwrap_err();
        assert!(matches!(again, StoreError::NotDeleted { .. }), "{again}");
    }
    let missing = Item::new(ItemKind::Dataset, 999);
    for refused in [
        f.store.delete(missing, &FORCED).await.unwrap_err(),
        f.store.restore(missing).await.unwrap_err(),
        f.store.dependents(missing).await.unwrap_err(),
    ] {
        assert!(matches!(refused, StoreError::NotFound { what: "dataset", .. }), "{refused}");
    }
}

pub async fn a_job_that_has_not_ended_keeps_what_it_reads_and_writes(f: Fixture) {
    let simulated = f.submit_one(simulate(1)).await;
    let own = dataset_of(&f, simulated).await;
    for item in [simulated.into(), own] {
        let refused = f.store.delete(item, &FORCED).await.unwrap_err();
        assert!(matches!(refused, StoreError::NotEnded { .. }), "{refused}");
    }
    work(&f).await;
    let data = simulate(1);
    let open = f.submit_one(train(&data, vec![Need::Existing(simulated)])).await;
    for item in [simulated.into(), own] {
        let refused = f.store.delete(item, &FORCED).await.unwrap_err();
        let StoreError::Needed { by, .. } = &refused else { panic!("{refused}") };
        assert_eq!(by.iter().map(|dependent| dependent.job).collect::<Vec<_>>(), [open]);
        assert!(refused.to_string().contains(&format!("train job {open} (queued) reads it")));
        assert!(is_there(&f.store, item).await);
    }
    f.store.cancel(open).await.unwrap();
    f.store.delete(own, &FORCED).await.unwrap();
}

pub async fn jobs_that_have_ended_keep_what_they_read_unless_that_is_passed_over(f: Fixture) {
    let (id, [simulated, trained, evaluated]) = finished(&f, 1).await;
    let relations = async |item: Item| {
        let (_, found) = f.store.dependents(item).await.unwrap();
        found.iter().map(|dependent| (dependent.job, dependent.relation)).collect::<Vec<_>>()
    };
    let data = dataset_of(&f, simulated).await;
    let readers = [(trained, Relation::Reads), (evaluated, Relation::Reads)];
    assert_eq!(relations(data).await, readers);
    let weights = final_checkpoint(&f, trained).await;
    assert_eq!(relations(weights).await, [(evaluated, Relation::Reads)]);
    assert_eq!(relations(evaluated.into()).await, [(id, Relation::Holds)]);
    assert_eq!(relations(id.into()).await, []);
    let refused = f.store.delete(data, &ASKED).await.unwrap_err();
    assert!(matches!(refused, StoreError::Needed { .. }), "{refused}");
    f.store.delete(data, &FORCED).await.unwrap();
    // Jobs that read it are unchanged.
    assert_eq!(f.states(&[trained, evaluated]).await, [JobState::Succeeded; 2]);
    assert!(is_there(&f.store, weights).await);
    // A deleted result of a checkpoint no longer keeps the checkpoint.
    f.store.delete(evaluated.into(), &FORCED).await.unwrap();
    f.store.delete(weights, &ASKED).await.unwrap();
}

pub async fn a_job_goes_with_all_that_it_left_and_comes_back_with_it(f: Fixture) {
    let (_, [_, trained, _]) = finished(&f, 1).await;
    let steps = f.store.checkpoints_of_job(trained).await.unwrap();
    let (early, last): (Item, Item) = (steps[0].id.into(), steps[1].id.into());
    let run = run_of(&f, trained).await;
    f.store.delete(early, &FORCED).await.unwrap();
    let (along, _) = f.store.dependents(trained.into()).await.unwrap();
    assert_eq!(BTreeSet::from_iter(along), BTreeSet::from([run, last]));
    tokio::time::sleep(Duration::from_millis(3)).await;
    let deleted = f.store.delete(trained.into(), &FORCED).await.unwrap();
    assert_eq!(BTreeSet::from_iter(deleted.along), BTreeSet::from([run, last]));
    for owned in [run, last] {
        let refused = f.store.restore(owned).await.unwrap_err();
        assert!(matches!(refused, StoreError::OwnerDeleted { .. }), "{refused}");
    }
    let back = f.store.restore(trained.into()).await.unwrap();
    assert_eq!(BTreeSet::from_iter(back), BTreeSet::from([run, last]));
    // It had been deleted separately.
    assert!(!is_there(&f.store, early).await);
    f.store.restore(early).await.unwrap();
    let deleted = f.store.delete(run, &FORCED).await.unwrap();
    assert_eq!(BTreeSet::from_iter(deleted.along), BTreeSet::from([early, last]));
    assert!(is_there(&f.store, trained.into()).await);
}

pub async fn a_pipeline_goes_with_the_jobs_that_were_made_for_it_alone(f: Fixture) {
    // One of them was also asked for alone.
    let asked = f.submit_one(simulate(1)).await;
    work(&f).await;
    let (id, [simulated, trained, evaluated]) = finished(&f, 1).await;
    assert_eq!(simulated, asked);
    let deleted = f.store.delete(id.into(), &ASKED).await.unwrap();
    let jobs = |items: &[Item]| -> BTreeSet<i64> {
        items.iter().filter(|item| item.kind == ItemKind::Job).map(|item| item.id).collect()
    };
    assert_eq!(jobs(&deleted.along), BTreeSet::from([trained.0, evaluated.0]));
    assert!(is_there(&f.store, asked.into()).await);
    let back = f.store.restore(id.into()).await.unwrap();
    assert_eq!(jobs(&back), BTreeSet::from([trained.0, evaluated.0]));
    // Another pipeline keeps the jobs that both have.
    let more = evaluate(&simulate(1), &simulate(9), vec![Need::New(0)]);
    let both = super::pipeline_of(vec![train(&simulate(1), vec![Need::Existing(asked)]), more]);
    let other = f.submit(both).await.job;
    work(&f).await;
    let deleted = f.store.delete(id.into(), &FORCED).await.unwrap();
    assert_eq!(jobs(&deleted.along), BTreeSet::from([evaluated.0]));
    assert_eq!(f.members(other).await[0], trained);
}

pub async fn a_job_that_lost_its_results_stands_in_for_no_other(f: Fixture) {
    let (id, [simulated, trained, evaluated]) = finished(&f, 1).await;
    let data = simulate(1);
    let training = train(&data, vec![Need::Existing(simulated)]);
    let (digest, spec) = (training.digest, training.clone());
    let losses = [run_of(&f, trained).await, final_checkpoint(&f, trained).await, trained.into()];
    let succeeded = [JobState::Succeeded];
    for item in losses {
        assert_eq!(f.submit_one(spec.clone()).await, trained);
        f.store.delete(item, &FORCED).await.unwrap();
        let usable = f.store.usable_job_by_digest(digest, &succeeded).await.unwrap();
        assert!(usable.is_none(), "{item}");
        // The digest still leads to it.
        let any = f.store.job_by_digest(digest, &succeeded).await.unwrap().unwrap();
        assert_eq!(any.id, trained);
        let which = WhichCheckpoint::Final;
        assert!(f.store.checkpoint_by_digest(digest, which).await.unwrap().is_none());
        let anew = f.submit(alone(spec.clone())).await;
        assert!(!anew.reused);
        f.store.cancel(anew.job).await.unwrap();
        // The pipeline runs again as far as necessary.
        let again = f.submit(pipeline(1)).await;
        assert!(!again.reused);
        let [first, second, third] = f.members(again.job).await.try_into().unwrap();
        assert_eq!((first, third), (simulated, evaluated));
        assert_ne!(second, trained);
        f.store.cancel(again.job).await.unwrap();
        // A job that needs it is refused.
        let needing = evaluate(&data, &training, vec![Need::Existing(trained)]);
        let needing = store::NewJob { spec: json!({"other": item.id}), ..needing };
        let needing = store::NewJob { digest: Digest::of_json(&needing.spec), ..needing };
        let refused = f.store.submit(alone(needing)).await.unwrap_err();
        assert!(matches!(refused, StoreError::InputDeleted { .. }), "{refused}");
        f.store.restore(item).await.unwrap();
        assert_eq!(f.submit(pipeline(1)).await.job, id);
    }
    // A checkpoint from before the end is no loss.
    let early = f.store.checkpoints_of_job(trained).await.unwrap()[0].id;
    f.store.delete(early.into(), &FORCED).await.unwrap();
    assert_eq!(f.submit_one(spec).await, trained);
}

pub async fn nothing_is_taken_over_from_what_was_deleted(f: Fixture) {
    let failed = f.submit_one(simulate(1)).await;
    let task = f.must_claim().await;
    let shard = f.publish_shard(&task).await;
    f.store.commit_shard(task.fence, &shard, None).await.unwrap();
    f.store.cancel(failed).await.unwrap();
    let next = f.submit_one(simulate(1)).await;
    assert!(f.store.earlier_shard(next, task.ordinal).await.unwrap().is_some());
    // A job that may be copying it keeps it.
    let refused = f.store.delete(failed.into(), &FORCED).await.unwrap_err();
    let StoreError::Needed { by, .. } = &refused else { panic!("{refused}") };
    assert_eq!((by[0].job, by[0].relation), (next, Relation::Continues));
    f.store.cancel(next).await.unwrap();
    f.store.delete(failed.into(), &FORCED).await.unwrap();
    let last = f.submit_one(simulate(1)).await;
    assert!(f.store.earlier_shard(last, task.ordinal).await.unwrap().is_none());
}

pub async fn the_trash_is_read_in_pages_and_tells_of_what_was_asked_for_alone(f: Fixture) {
    let (id, [simulated, trained, _]) = finished(&f, 1).await;
    let data = dataset_of(&f, simulated).await;
    let weights = final_checkpoint(&f, trained).await;
    for item in [data, weights] {
        f.store.delete(item, &FORCED).await.unwrap();
        tokio::time::sleep(Duration::from_millis(3)).await;
    }
    let reason = Some("failed jobs are kept for 3 days");
    f.store.delete(id.into(), &DeletionOrder { reason, ..FORCED }).await.unwrap();
    let all = f.store.trash(None, 10).await.unwrap();
    let items: Vec<Item> = all.iter().map(|trashed| trashed.item).collect();
    assert_eq!(items, [id.into(), weights, data]);
    assert_eq!(all[0].deletion.reason.as_deref(), reason);
    assert_eq!(all[2].bytes, f.store.size_of(&[data]).await.unwrap());
    assert!(all[2].bytes > 0 && all[1].bytes > 0);
    let (mut place, mut paged) = (None, Vec::new());
    while let Some(next) = f.store.trash(place, 1).await.unwrap().pop() {
        let Item { kind, id } = next.item;
        let item = Item::new(kind, id);
        place = Some(TrashPlace { deleted_at: next.deletion.deleted_at, item });
        paged.push(item);
    }
    assert_eq!(paged, items);
}

/// The trash had the name of before a renaming.
pub async fn things_have_the_names_that_users_gave_in_the_trash_too(f: Fixture) {
    let (id, [simulated, trained, evaluated]) = finished(&f, 1).await;
    let data = dataset_of(&f, simulated).await;
    let (training, test) = (run_of(&f, trained).await, run_of(&f, evaluated).await);
    let weights = final_checkpoint(&f, trained).await;
    for (item, name) in [(data, "payload 1 kg"), (training, "wide"), (id.into(), "night run")] {
        f.store.change_labels(item.kind, item.id, &naming(name)).await.unwrap();
    }
    let expected = [
        (data, "payload 1 kg"),
        (weights, "wide, step 10"),
        (test, "evaluate"),
        (training, "wide"),
        // Jobs keep theirs, whatever their results are called.
        (simulated.into(), "train-set"),
        (trained.into(), "train"),
        (id.into(), "night run"),
    ];
    for (item, name) in expected {
        assert_eq!(f.store.name_of(item).await.unwrap(), name, "{item}");
        f.store.delete(item, &FORCED).await.unwrap();
        assert_eq!(f.store.trash(None, 1).await.unwrap()[0].name, name, "{item}");
        assert_eq!(f.store.name_of(item).await.unwrap(), name, "{item}");
        f.store.restore(item).await.unwrap();
    }
    f.store.delete(simulated.into(), &FORCED).await.unwrap();
    let trashed = f.store.trash(None, 1).await.unwrap().remove(0);
    assert_eq!(trashed.result_name.as_deref(), Some("payload 1 kg"));
    f.store.restore(simulated.into()).await.unwrap();
    let named = f.store.result_names(&[simulated, trained, evaluated]).await.unwrap();
    let expected = [(simulated, "payload 1 kg"), (trained, "wide"), (evaluated, "evaluate")];
    assert_eq!(named, expected.map(|(job, name)| (job, name.to_owned())));
    let (_, jobs) = f.store.dependents(data).await.unwrap();
    assert!(jobs.iter().any(|job| job.name == "train"), "{jobs:?}");
    let lost = f.store.name_of(Item::new(ItemKind::Run, 99)).await;
    assert!(matches!(lost, Err(StoreError::NotFound { .. })), "{lost:?}");
}

pub async fn of_many_deletions_of_one_thing_one_counts(f: Fixture) {
    let (_, [simulated, _, _]) = finished(&f, 1).await;
    let item = dataset_of(&f, simulated).await;
    let delete = |store: Store| async move { store.delete(item, &FORCED).await };
    let begun: Vec<_> = (0..8).map(|_| tokio::spawn(delete(f.store.clone()))).collect();
    let mut counted = 0;
    for answer in begun {
        match answer.await.unwrap() {
            Ok(_) => counted += 1,
            Err(StoreError::InTrash { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
    assert_eq!(counted, 1);
    let restore = |store: Store| async move { store.restore(item).await };
    let begun: Vec<_> = (0..8).map(|_| tokio::spawn(restore(f.store.clone()))).collect();
    let mut counted = 0;
    for answer in begun {
        match answer.await.unwrap() {
            Ok(_) => counted += 1,
            Err(StoreError::NotDeleted { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
    assert_eq!(counted, 1);
}

pub async fn a_submission_and_a_deletion_agree(f: Fixture) {
    for seed in 0..24 {
        let simulated = f.submit_one(simulate(seed)).await;
        work(&f).await;
        let item = dataset_of(&f, simulated).await;
        let (first, second) = (f.store.clone(), f.store.clone());
        let reader = alone(train(&simulate(seed), vec![Need::Existing(simulated)]));
        let submission = async move { first.submit(reader).await };
        let deletion = async move { second.delete(item, &FORCED).await };
        // The client that is spawned first is not always the first to run.
        let (submitted, deleted) = if seed % 2 == 0 {
            let (a, b) = (tokio::spawn(submission), tokio::spawn(deletion));
            (a.await.unwrap(), b.await.unwrap())
        } else {
            let (b, a) = (tokio::spawn(deletion), tokio::spawn(submission));
            (a.await.unwrap(), b.await.unwrap())
        };
        match (&submitted, &deleted) {
            (Ok(_), Err(StoreError::Needed { .. })) => assert!(is_there(&f.store, item).await),
            (Err(StoreError::InputDeleted { .. }), Ok(_)) => {
                assert!(!is_there(&f.store, item).await);
            }
            other => panic!("{other:?}"),
        }
        if let Ok(submitted) = submitted {
            f.store.cancel(submitted.job).await.unwrap();
        }
    }
}

pub async fn a_restoration_and_a_purge_agree(f: Fixture) {
    for seed in 0..24 {
        let simulated = f.submit_one(simulate(seed)).await;
        work(&f).await;
        let item = dataset_of(&f, simulated).await;
        f.store.delete(item, &FORCED).await.unwrap();
        let (first, second) = (f.store.clone(), f.store.clone());
        let restoration = tokio::spawn(async move { first.restore(item).await });
        let purge = tokio::spawn(async move { second.purge(ANY).await });
        let (restored, purged) = (restoration.await.unwrap(), purge.await.unwrap().unwrap());
        match restored {
            Ok(_) => {
                assert_eq!(purged, []);
                let shards = f.store.shards(store::DatasetId(item.id)).await.unwrap();
                assert_eq!(shards.len(), 3);
            }
            Err(StoreError::Purged { .. }) => {
                assert_eq!(purged.len(), 1);
                let purged = f.store.dataset(store::DatasetId(item.id)).await.unwrap_err();
                assert!(matches!(purged, StoreError::Purged { .. }), "{purged}");
            }
            Err(error) => panic!("{error}"),
        }
        assert_whole(&f.store).await;
    }
}
