//! Deletion, restoration and final deletion.

use std::collections::BTreeSet;
use std::time::Duration;

use bytes::Bytes;
use serde_json::json;
use spec::Digest;
use store::{
    AttemptOutcome, CheckpointFile, ClaimedTask, DeletionOrder, ExperimentId, GarbageKind, Item,
    ItemKind, JobFilter, JobId, JobState, Need, NewArtifact, NewCheckpoint, NewTrackedRun, Page,
    Relation, Respect, Retry, Ripe, Store, StoreError, Submission, Timestamp, TrashPlace,
    WhichCheckpoint, object_path,
};

use super::{Fixture, LONG, alone, evaluate, import, pipeline, simulate, train};

const ASKED: DeletionOrder<'_> = DeletionOrder { respect: Respect::All, keep: LONG, reason: None };

const FORCED: DeletionOrder<'_> =
    DeletionOrder { respect: Respect::Open, keep: LONG, reason: None };

/// Everything, whatever its date.
const ANY: Ripe = Ripe::After(Duration::ZERO);

/// Completes all tasks. Each leaves the results of its kind.
async fn work(f: &Fixture) {
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

async fn checkpoint(f: &Fixture, task: &ClaimedTask, step: u64, is_final: bool) {
    let path = object_path::checkpoint(task.job, step, task.fence.epoch, "model.safetensors");
    let object = f.store.put_object(&path, Bytes::from(format!("step {step}"))).await.unwrap();
    let files = vec![CheckpointFile { name: "model.safetensors".to_owned(), object }];
    let metrics = [("loss".to_owned(), 0.5)].into();
    let new = NewCheckpoint { step, is_final, is_best: is_final, metrics, files };
    f.store.commit_checkpoint(task.fence, &new).await.unwrap();
}

/// A pipeline that has succeeded, and its members.
async fn finished(f: &Fixture, seed: u64) -> (JobId, [JobId; 3]) {
    let id = f.submit(pipeline(seed)).await.job;
    work(f).await;
    assert_eq!(f.state(id).await, JobState::Succeeded);
    (id, f.members(id).await.try_into().unwrap())
}

async fn dataset_of(f: &Fixture, job: JobId) -> Item {
    f.store.job(job).await.unwrap().dataset.unwrap().into()
}

async fn run_of(f: &Fixture, job: JobId) -> Item {
    f.store.job(job).await.unwrap().run.unwrap().into()
}

async fn final_checkpoint(f: &Fixture, job: JobId) -> Item {
    f.store.checkpoints_of_job(job).await.unwrap().last().unwrap().id.into()
}

/// Whether something can be read.
async fn is_there(store: &Store, item: Item) -> bool {
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
async fn listed(store: &Store) -> BTreeSet<Item> {
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
async fn assert_whole(store: &Store) -> usize {
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
        assert_eq!(by.iter().map(|it| it.job).collect::<Vec<_>>(), [open]);
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
        found.iter().map(|it| (it.job, it.relation)).collect::<Vec<_>>()
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
        items.iter().filter(|it| it.kind == ItemKind::Job).map(|it| it.id).collect()
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
    let items: Vec<Item> = all.iter().map(|it| it.item).collect();
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

pub async fn what_is_purged_leaves_neither_bytes_nor_rows_that_claim_them(f: Fixture) {
    let (id, [simulated, _, _]) = finished(&f, 1).await;
    // Another dataset has the same bytes under its own names.
    f.submit(Submission { reuse: store::Reuse::Never, ..alone(simulate(1)) }).await;
    work(&f).await;
    let other = f.store.datasets(None, Page::default()).await.unwrap()[0].id;
    let all = assert_whole(&f.store).await;
    let own: Vec<_> = f.store.shards(dataset_id(&f, simulated).await).await.unwrap();
    f.store.delete(id.into(), &FORCED).await.unwrap();
    // Nothing may be purged before its date, and everything in the trash is complete.
    assert_eq!(f.store.purge(Ripe::AtItsDate { leap: Duration::ZERO }).await.unwrap(), []);
    assert_eq!(assert_whole(&f.store).await, all);
    assert!(!f.store.purge(ANY).await.unwrap().is_empty());
    assert_eq!(assert_whole(&f.store).await, 6);
    for shard in own {
        for (_, object) in shard.contents.files() {
            assert!(f.store.read_object(object).await.unwrap_err().is_missing_file());
        }
    }
    let gone = f.store.restore(id.into()).await.unwrap_err();
    assert!(matches!(gone, StoreError::NotFound { .. }), "{gone}");
    assert_eq!(f.store.shards(other).await.unwrap().len(), 3);
    assert_eq!(f.store.trash(None, 10).await.unwrap(), []);
    // Some stores round times to seconds.
    tokio::time::sleep(Duration::from_millis(1100)).await;
    assert_eq!(f.store.sweep_orphans(Duration::ZERO).await.unwrap(), 0, "objects were left");
}

async fn dataset_id(f: &Fixture, job: JobId) -> store::DatasetId {
    f.store.job(job).await.unwrap().dataset.unwrap()
}

pub async fn a_job_that_others_refer_to_keeps_its_spec(f: Fixture) {
    let (id, [simulated, trained, evaluated]) = finished(&f, 1).await;
    f.store.delete(simulated.into(), &FORCED).await.unwrap();
    f.store.purge(ANY).await.unwrap();
    let purged = f.store.job(simulated).await.unwrap_err();
    assert!(matches!(purged, StoreError::Purged { .. }), "{purged}");
    let refused = f.store.restore(simulated.into()).await.unwrap_err();
    assert!(matches!(refused, StoreError::Purged { .. }), "{refused}");
    let digest = simulate(1).digest;
    let found = f.store.job_by_digest(digest, &JobState::ALL).await.unwrap().unwrap();
    assert_eq!((found.id, found.spec), (simulated, simulate(1).spec));
    assert_eq!(f.states(&[id, trained, evaluated]).await, [JobState::Succeeded; 3]);
    // It goes with the last job that refers to it.
    f.store.delete(id.into(), &FORCED).await.unwrap();
    f.store.purge(ANY).await.unwrap();
    assert!(f.store.job_by_digest(digest, &JobState::ALL).await.unwrap().is_none());
    assert_eq!(listed(&f.store).await, BTreeSet::new());
}

pub async fn what_would_be_purged_is_what_is_purged(f: Fixture) {
    let (id, _) = finished(&f, 1).await;
    finished(&f, 2).await;
    f.store.put_object("orphan", Bytes::from_static(b"nobody's")).await.unwrap();
    f.store.delete(id.into(), &FORCED).await.unwrap();
    // Some stores round times to seconds.
    tokio::time::sleep(Duration::from_millis(1100)).await;
    let before = assert_whole(&f.store).await;
    let foretold = f.store.garbage(ANY, Duration::ZERO).await.unwrap();
    assert_eq!(assert_whole(&f.store).await, before, "a look deleted something");
    let deleted = f.store.collect_garbage(ANY, Duration::ZERO).await.unwrap();
    assert_eq!(foretold, deleted);
    let orphans = deleted.iter().find(|it| it.kind == GarbageKind::Orphans).unwrap();
    assert_eq!((orphans.files, orphans.bytes), (1, 8));
    // Four jobs, a dataset, two runs, two checkpoints.
    assert_eq!(deleted.len(), 4 + 1 + 2 + 2 + 1);
    assert_eq!(f.store.garbage(ANY, Duration::ZERO).await.unwrap(), []);
    assert!(assert_whole(&f.store).await < before);
}

pub async fn a_file_that_was_sent_goes_with_the_last_job_that_read_it(f: Fixture) {
    let mut writer = f.store.begin_upload().await.unwrap();
    writer.write(b"u1,q1").await.unwrap();
    let file = writer.finish("arm.csv").await.unwrap().object;
    let one = f.submit_one(import(file.sha256)).await;
    let two = f.submit(Submission { reuse: store::Reuse::Never, ..alone(import(file.sha256)) });
    let two = two.await.job;
    f.work_off().await;
    let is_upload = |it: &store::Garbage| it.kind == GarbageKind::Upload(file.sha256);
    f.store.delete(one.into(), &FORCED).await.unwrap();
    assert!(!f.store.purge(ANY).await.unwrap().iter().any(is_upload));
    assert!(f.store.upload(file.sha256).await.unwrap().is_some());
    f.store.delete(two.into(), &FORCED).await.unwrap();
    assert!(f.store.garbage(ANY, LONG).await.unwrap().iter().any(is_upload));
    assert!(f.store.purge(ANY).await.unwrap().iter().any(is_upload));
    assert!(f.store.upload(file.sha256).await.unwrap().is_none());
    let refused = f.store.submit(alone(import(file.sha256))).await.unwrap_err();
    assert!(matches!(refused, StoreError::FileDeleted { .. }), "{refused}");
    assert_eq!(assert_whole(&f.store).await, 0);
}

pub async fn jobs_that_failed_go_by_themselves_when_nothing_depends_on_them(f: Fixture) {
    finished(&f, 1).await;
    let lonely = f.submit_one(simulate(2)).await;
    f.store.cancel(lonely).await.unwrap();
    // Its checkpoint was evaluated.
    let data = simulate(1);
    let simulated = f.submit_one(data.clone()).await;
    let training = store::NewJob { spec: json!({"other": 1}), ..train(&data, vec![]) };
    let training = store::NewJob { digest: Digest::of_json(&training.spec), ..training };
    let trained = f.submit_one(training.clone()).await;
    let task = f.must_claim().await;
    checkpoint(&f, &task, 5, false).await;
    f.store.fail(task.fence, "too hot", Retry::Never).await.unwrap();
    let needs = vec![Need::Existing(simulated)];
    f.submit_one(evaluate(&data, &training, needs)).await;
    work(&f).await;
    // A member of this pipeline succeeded.
    let partly = f.submit(pipeline(3)).await.job;
    for _ in 0..3 {
        let task = f.must_claim().await;
        let shard = f.publish_shard(&task).await;
        f.store.commit_shard(task.fence, &shard, None).await.unwrap();
    }
    f.store.cancel(partly).await.unwrap();
    let retention =
        |age| store::Retention { failed_jobs: Some(age), ..store::Retention::default() };
    assert_eq!(f.store.outdated(store::Retention::default()).await.unwrap(), []);
    assert_eq!(f.store.outdated(retention(LONG)).await.unwrap(), []);
    tokio::time::sleep(Duration::from_millis(5)).await;
    let foretold = f.store.outdated(retention(Duration::ZERO)).await.unwrap();
    assert_eq!(foretold.iter().map(|it| it.item).collect::<Vec<_>>(), [lonely.into()]);
    let retired = f.store.retire(retention(Duration::ZERO), LONG).await.unwrap();
    assert_eq!(retired, foretold);
    let trash = f.store.trash(None, 10).await.unwrap();
    assert_eq!(trash[0].deletion.reason.as_deref(), Some("failed jobs are kept for 0 days"));
    assert!(is_there(&f.store, trained.into()).await && is_there(&f.store, partly.into()).await);
    assert_eq!(f.store.outdated(retention(Duration::ZERO)).await.unwrap(), []);
}

pub async fn old_checkpoints_go_unless_somebody_uses_them(f: Fixture) {
    let data = simulate(1);
    f.submit_one(data.clone()).await;
    work(&f).await;
    let training = train(&data, vec![]);
    let trained = f.submit_one(training.clone()).await;
    let task = f.must_claim().await;
    for step in [10, 20, 30, 40, 50, 60, 70] {
        checkpoint(&f, &task, step, step == 70).await;
    }
    let keep =
        |newest| store::Retention { checkpoints: Some(newest), ..store::Retention::default() };
    assert_eq!(f.store.outdated(keep(1)).await.unwrap(), [], "the training goes on");
    f.store.complete(task.fence, None).await.unwrap();
    let spec = json!({"checkpoint": {"step": {"digest": training.digest, "step": 20}}});
    let digest = Digest::of_json(&spec);
    let reader = store::NewJob { spec, digest, ..evaluate(&data, &training, vec![]) };
    let reading = f.submit_one(reader).await;
    let checkpoints = f.store.checkpoints_of_job(trained).await.unwrap();
    let change = store::LabelChange { tags: Some(vec!["keep".to_owned()]), ..Default::default() };
    f.store.change_labels(store::Thing::Checkpoint, checkpoints[2].id.0, &change).await.unwrap();
    assert_eq!(f.store.outdated(keep(2)).await.unwrap(), [], "an open job reads the training");
    work(&f).await;
    assert_eq!(f.state(reading).await, JobState::Succeeded);
    let steps = |found: &[store::Outdated]| {
        let step = |it: &store::Outdated| {
            checkpoints.iter().find(|found| it.item == found.id.into()).map(|found| found.step)
        };
        found.iter().filter_map(step).collect::<Vec<u64>>()
    };
    let found = f.store.outdated(keep(2)).await.unwrap();
    assert_eq!(steps(&found), [10, 40, 50]);
    assert_eq!(found[0].reason, "a training keeps its 2 newest checkpoints and the best");
    assert_eq!(f.store.retire(keep(2), LONG).await.unwrap(), found);
    let left = f.store.checkpoints_of_job(trained).await.unwrap();
    assert_eq!(left.iter().map(|it| it.step).collect::<Vec<_>>(), [20, 30, 60, 70]);
    assert_eq!(f.store.outdated(keep(2)).await.unwrap(), []);
}

pub async fn an_open_job_keeps_the_checkpoints_of_its_training_and_of_no_other(f: Fixture) {
    let mut trained = Vec::new();
    for seed in [1, 2] {
        let data = simulate(seed);
        f.submit_one(data.clone()).await;
        work(&f).await;
        let training = train(&data, vec![]);
        let job = f.submit_one(training.clone()).await;
        let task = f.must_claim().await;
        for step in [10, 20, 30] {
            checkpoint(&f, &task, step, step == 30).await;
        }
        f.store.complete(task.fence, None).await.unwrap();
        trained.push((job, data, training));
    }
    let keep = store::Retention { checkpoints: Some(1), ..store::Retention::default() };
    let outdated = async || f.store.outdated(keep).await.unwrap();
    assert_eq!(outdated().await.len(), 4, "nobody uses any");
    let checkpoints = f.store.checkpoints_of_job(trained[1].0).await.unwrap();
    let of_the_other: Vec<Item> = checkpoints[..2].iter().map(|it| it.id.into()).collect();

    let (job, data, training) = &trained[0];
    let reader = f.submit_one(evaluate(data, training, vec![])).await;
    let items = async || outdated().await.into_iter().map(|it| it.item).collect::<Vec<Item>>();
    assert_eq!(items().await, of_the_other, "it reads the first training");
    f.store.cancel(reader).await.unwrap();
    assert_eq!(outdated().await.len(), 4);
    let needs = vec![Need::Existing(*job)];
    let waiting = f.submit_one(evaluate(data, training, needs)).await;
    assert_eq!(items().await, of_the_other, "it needs the first training");
    f.store.cancel(waiting).await.unwrap();
    assert_eq!(outdated().await.len(), 4);
}

pub async fn old_logs_go_and_their_attempts_stay(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let line = store::NewLogChunk { position: 0, text: "here\n".to_owned() };
    f.store.append_log(task.fence, &[line]).await.unwrap();
    assert_eq!(f.store.outdated_logs(Duration::ZERO).await.unwrap(), [], "the job goes on");
    f.store.complete(task.fence, None).await.unwrap();
    assert_eq!(f.store.outdated_logs(LONG).await.unwrap(), []);
    assert_eq!(f.store.delete_old_logs(LONG).await.unwrap(), 0);
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(f.store.outdated_logs(Duration::ZERO).await.unwrap(), [job]);
    assert_eq!(f.store.delete_old_logs(Duration::ZERO).await.unwrap(), 1);
    let filter = store::LogFilter { jobs: vec![job], ..store::LogFilter::default() };
    let page = store::LogPage::After { id: 0, limit: 10 };
    assert_eq!(f.store.log_page(&filter, page).await.unwrap(), []);
    assert_eq!(f.store.delete_old_logs(Duration::ZERO).await.unwrap(), 0);
    assert_eq!(f.store.census().await.unwrap().attempts.len(), 1);
}

pub async fn runs_of_other_clients_are_purged_at_their_date(f: Fixture) {
    let experiment = f.store.create_experiment("robots", &[]).await.unwrap();
    let new = |experiment| NewTrackedRun {
        experiment,
        name: None,
        user: String::new(),
        start_time: Timestamp::from_milliseconds(0),
        tags: vec![],
    };
    let deleted = f.store.create_tracked_run(&new(experiment)).await.unwrap();
    let kept = f.store.create_tracked_run(&new(ExperimentId::DEFAULT)).await.unwrap();
    for run in [&deleted, &kept] {
        let mut writer = f.store.begin_tracked_artifact(run).await.unwrap();
        writer.write(b"plot").await.unwrap();
        writer.finish_as_artifact(&run.identifier, "plot.svg").await.unwrap();
    }
    f.store.set_experiment_deleted(experiment, Some(LONG)).await.unwrap();
    let at_date = Ripe::AtItsDate { leap: Duration::ZERO };
    assert_eq!(f.store.purge(at_date).await.unwrap(), []);
    f.store.set_experiment_deleted(experiment, None).await.unwrap();
    assert_eq!(f.store.purge(ANY).await.unwrap(), []);
    f.store.set_experiment_deleted(experiment, Some(Duration::ZERO)).await.unwrap();
    let purged = f.store.purge(at_date).await.unwrap();
    assert_eq!(purged.len(), 1);
    assert_eq!((purged[0].files, purged[0].bytes), (1, 4));
    assert!(f.store.tracked_run(&deleted.identifier).await.is_err());
    assert!(f.store.experiment(experiment).await.is_err());
    assert_eq!(assert_whole(&f.store).await, 1);
    assert_eq!(f.store.tracked_artifacts(kept.id).await.unwrap().len(), 1);
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

pub async fn a_purge_changes_no_count_of_attempts(f: Fixture) {
    let place = |(kind, outcome, _): &(String, Option<AttemptOutcome>, u64)| {
        (kind.clone(), outcome.map(AttemptOutcome::as_str))
    };
    for seed in 1..=2 {
        let job = f.submit_one(train(&simulate(seed), vec![])).await;
        let task = f.must_claim().await;
        f.store.fail(task.fence, "no room", Retry::Allowed).await.unwrap();
        work(&f).await;
        let before = f.store.census().await.unwrap();
        let of_all: u64 = before.attempts.iter().map(|(_, _, number)| number).sum();
        assert_eq!(of_all, seed * 2);
        f.store.delete(job.into(), &ASKED).await.unwrap();
        f.store.purge(ANY).await.unwrap();
        let mut after = f.store.census().await.unwrap();
        assert_eq!((after.jobs.len(), after.tasks.len()), (0, 0), "{after:?}");
        let mut expected = before.attempts;
        expected.sort_by_key(place);
        after.attempts.sort_by_key(place);
        assert_eq!(after.attempts, expected);
    }
}
