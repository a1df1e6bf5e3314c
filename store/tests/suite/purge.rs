//! Purges: what is deleted for good, and what has to stay.

use std::collections::BTreeSet;
use std::time::Duration;

use bytes::Bytes;
use store::{
    AttemptOutcome, ExperimentId, GarbageKind, JobId, JobState, NewTrackedRun, Page, Retry, Ripe,
    StoreError, Submission, Timestamp,
};

use super::trash::{ANY, ASKED, FORCED, assert_whole, finished, listed, work};
use super::{Fixture, LONG, alone, import, simulate, train};

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
    assert_eq!(f.sweep(Duration::ZERO).await, 0, "objects were left");
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
    f.store.put_object("uploads/upload-1-2-3", Bytes::from_static(b"nobody's")).await.unwrap();
    f.store.delete(id.into(), &FORCED).await.unwrap();
    // Some stores round times to seconds.
    tokio::time::sleep(Duration::from_millis(1100)).await;
    let before = assert_whole(&f.store).await;
    let foretold = f.store.garbage(ANY, Duration::ZERO).await.unwrap();
    assert_eq!(assert_whole(&f.store).await, before, "a look deleted something");
    let deleted = f.store.collect_garbage(ANY, Duration::ZERO).await.unwrap();
    assert_eq!(foretold, deleted);
    let orphans = deleted.iter().find(|garbage| garbage.kind == GarbageKind::Orphans).unwrap();
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
    let is_upload = |garbage: &store::Garbage| garbage.kind == GarbageKind::Upload(file.sha256);
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

pub async fn a_file_that_was_sent_for_nothing_goes(f: Fixture) {
    let mut files = Vec::new();
    for bytes in [b"u1,q1", b"u2,q2"] {
        let mut writer = f.store.begin_upload().await.unwrap();
        writer.write(bytes).await.unwrap();
        files.push(writer.finish("arm.csv").await.unwrap().object.sha256);
    }
    let [read, unread] = files[..] else { panic!("two files") };
    f.submit_one(import(read)).await;
    tokio::time::sleep(Duration::from_millis(2)).await;
    assert_eq!(f.store.garbage(ANY, LONG).await.unwrap(), [], "another request may name it");
    let foretold = f.store.garbage(ANY, Duration::ZERO).await.unwrap();
    assert_eq!(foretold.len(), 1);
    assert_eq!((foretold[0].kind.clone(), foretold[0].bytes), (GarbageKind::Upload(unread), 5));
    assert_eq!(f.store.purge(ANY).await.unwrap(), [], "only the trash");
    assert_eq!(f.store.collect_garbage(ANY, Duration::ZERO).await.unwrap(), foretold);
    assert!(f.store.upload(unread).await.unwrap().is_none());
    assert!(f.store.upload(read).await.unwrap().is_some());
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
