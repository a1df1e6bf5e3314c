//! Data folders that cannot be opened: each gives one clear line, and nothing is damaged.

#![expect(clippy::unwrap_used, reason = "tests")]

use std::path::Path;
use std::time::Duration;

use serde_json::json;
use spec::{Digest, Resources};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use store::{
    Access, ClaimedTask, Idempotency, JobFilter, JobId, JobState, Listing, NewJob, NewTask, Output,
    Page, Reuse, Store, StoreError, Submission, TaskState,
};

/// The number of the newest file in `migrations/sqlite`.
const SCHEMA: i64 = 18;

/// The number of the file with the whole schema.
const WHOLE_SCHEMA: i64 = 16;

async fn serve(dir: &Path) -> Result<Store, StoreError> {
    Store::open(dir, Access::Server).await
}

async fn refused(dir: &Path, access: Access) -> String {
    let error = Store::open(dir, access).await.unwrap_err().to_string();
    assert!(!error.contains('\n'), "{error}");
    error
}

/// Makes a store, then changes its database behind its back.
async fn with_changed_database(dir: &Path, sql: &'static str) -> Vec<u8> {
    serve(dir).await.unwrap().close().await;
    let file = dir.join("torqued.sqlite");
    let mut connection = SqliteConnectOptions::new().filename(&file).connect().await.unwrap();
    sqlx::raw_sql(sql).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
    std::fs::read(file).unwrap()
}

async fn submit(store: &Store, tasks: u32) -> JobId {
    store.submit(simulation(0, tasks, Reuse::Never)).await.unwrap().job
}

async fn claim(store: &Store, worker: &str) -> Option<ClaimedTask> {
    store.claim(worker, &Resources::default(), Duration::from_secs(600)).await.unwrap()
}

fn simulation(seed: u64, tasks: u32, reuse: Reuse) -> Submission {
    let spec = json!({"seed": seed});
    let task = |ordinal| NewTask {
        stage: 0,
        ordinal,
        label: format!("shard {ordinal}"),
        payload: json!({}),
        total: 1,
    };
    let job = NewJob {
        output: Output::Dataset { trajectories: 4, samples: 4 },
        tasks: (0..tasks).map(task).collect(),
        ..NewJob::new("simulate", spec)
    };
    Submission { reuse, ..Submission::of(job) }
}

#[tokio::test]
async fn a_folder_in_use_by_another_server_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    let error = refused(dir.path(), Access::Server).await;
    let pid = std::process::id();
    let path = dir.path().display();
    let expected = format!("data folder {path} is in use by another torqued server (pid {pid})");
    assert_eq!(error, expected);
    let clone = store.clone();
    drop(store);
    refused(dir.path(), Access::Server).await;
    drop(clone);
    serve(dir.path()).await.unwrap();
}

#[tokio::test]
async fn a_folder_without_a_store_is_refused_to_a_worker_and_not_touched() {
    let dir = tempfile::tempdir().unwrap();
    let error = refused(dir.path(), Access::Worker).await;
    assert!(error.ends_with("has no store; start a server on it first"), "{error}");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    assert!(refused(&dir.path().join("absent"), Access::Worker).await.contains("has no store"));
}

#[tokio::test]
async fn a_folder_that_cannot_be_created_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("file");
    std::fs::write(&file, "").unwrap();
    let error = refused(&file.join("data"), Access::Server).await;
    assert!(error.contains("cannot be used: Not a directory"), "{error}");
}

#[tokio::test]
async fn a_database_from_a_newer_version_is_refused_and_not_changed() {
    let dir = tempfile::tempdir().unwrap();
    let before = with_changed_database(
        dir.path(),
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
         VALUES (9001, 'from the future', 1, x'00', 0)",
    )
    .await;
    for access in [Access::Server, Access::Worker] {
        let error = refused(dir.path(), access).await;
        let expected = format!("newer torqued (schema 9001, this one knows {SCHEMA})");
        assert!(error.contains(&expected), "{error}");
    }
    assert_eq!(std::fs::read(dir.path().join("torqued.sqlite")).unwrap(), before);
}

#[tokio::test]
async fn a_database_without_a_schema_is_refused_to_a_worker() {
    let dir = tempfile::tempdir().unwrap();
    with_changed_database(dir.path(), "DELETE FROM _sqlx_migrations").await;
    let error = refused(dir.path(), Access::Worker).await;
    assert!(error.contains("has no store; start a server on it first"), "{error}");
}

#[tokio::test]
async fn a_database_from_before_the_release_is_refused_and_not_changed() {
    let dir = tempfile::tempdir().unwrap();
    let earlier = "DELETE FROM _sqlx_migrations WHERE version > 16; \
                   UPDATE _sqlx_migrations SET version = 15";
    let before = with_changed_database(dir.path(), earlier).await;
    for access in [Access::Server, Access::Worker] {
        let error = refused(dir.path(), access).await;
        let found = format!(
            "has schema 15 of an unreleased torqued, and this one opens schema {WHOLE_SCHEMA} or later"
        );
        assert!(error.contains(&found), "{error}");
        assert!(error.contains("build torqued at commit"), "{error}");
    }
    assert_eq!(std::fs::read(dir.path().join("torqued.sqlite")).unwrap(), before);
}

#[tokio::test]
async fn a_database_that_is_none_is_refused_and_not_changed() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("torqued.sqlite");
    let garbage = vec![7u8; 10_000];
    std::fs::write(&file, &garbage).unwrap();
    let error = refused(dir.path(), Access::Server).await;
    assert!(error.contains("is damaged: file is not a database"), "{error}");
    assert_eq!(std::fs::read(&file).unwrap(), garbage);
}

#[tokio::test]
async fn a_database_with_a_damaged_page_is_refused_and_not_changed() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    submit(&store, 500).await;
    store.close().await;
    drop(store);
    let file = dir.path().join("torqued.sqlite");
    let mut bytes = std::fs::read(&file).unwrap();
    let last_pages = bytes.len() - 3 * 4096;
    bytes[last_pages..].fill(0xa5);
    std::fs::write(&file, &bytes).unwrap();
    let error = refused(dir.path(), Access::Server).await;
    assert!(error.contains("is damaged"), "{error}");
    assert_eq!(std::fs::read(&file).unwrap(), bytes);
}

#[tokio::test]
async fn everything_is_there_after_a_restart() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    let job = submit(&store, 1).await;
    let task = claim(&store, "w").await.unwrap();
    drop(store);
    let store = serve(dir.path()).await.unwrap();
    assert_eq!(store.job(job).await.unwrap().state, JobState::Running);
    // The worker and its lease outlived its server.
    store.complete(task.fence, None).await.unwrap();
    assert_eq!(store.job(job).await.unwrap().state, JobState::Succeeded);
    store.ping().await.unwrap();
    assert_eq!(store.schema_version(), SCHEMA);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn several_processes_share_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    let server = serve(dir.path()).await.unwrap();
    let job = submit(&server, 40).await;
    let mut workers = Vec::new();
    for i in 0..4 {
        // SQLite tells processes apart only by their connections, so this one opens its own.
        let store = Store::open(dir.path(), Access::Worker).await.unwrap();
        workers.push(tokio::spawn(async move {
            let mut count = 0;
            let name = format!("w{i}");
            while let Some(task) = claim(&store, &name).await {
                store.complete(task.fence, None).await.unwrap();
                count += 1;
            }
            count
        }));
    }
    let mut count = 0;
    for worker in workers {
        count += worker.await.unwrap();
    }
    assert_eq!(count, 40);
    let tasks = server.tasks(job).await.unwrap();
    assert!(tasks.iter().all(|task| task.state == TaskState::Succeeded && task.attempt == 1));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn processes_that_submit_the_same_at_once_make_one_job() {
    let dir = tempfile::tempdir().unwrap();
    let server = serve(dir.path()).await.unwrap();
    let mut submitters = Vec::new();
    for _ in 0..4 {
        let store = Store::open(dir.path(), Access::Worker).await.unwrap();
        submitters.push(tokio::spawn(async move {
            let mut new = 0;
            for seed in 0..25 {
                let submission = simulation(seed, 2, Reuse::SameDigest);
                new += u32::from(!store.submit(submission).await.unwrap().reused);
            }
            new
        }));
    }
    let mut new = 0;
    for submitter in submitters {
        new += submitter.await.unwrap();
    }
    assert_eq!(new, 25);
    let page = Page { before: None, limit: 500 };
    assert_eq!(server.jobs(JobFilter::default(), page).await.unwrap().len(), 25);
}

#[tokio::test]
async fn an_idempotency_key_is_known_for_a_day() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    let asked = Idempotency { key: "k".to_owned(), request: Digest::of(b"request") };
    let request =
        || Submission { idempotency: Some(asked.clone()), ..simulation(1, 2, Reuse::Never) };
    let first = store.submit(request()).await.unwrap();
    let mut connection = SqliteConnectOptions::new()
        .filename(dir.path().join("torqued.sqlite"))
        .connect()
        .await
        .unwrap();
    for (minutes, is_known) in [(23 * 60 + 59, true), (2, false)] {
        sqlx::query("UPDATE idempotency_key SET created_at = created_at - ? * 60000")
            .bind(minutes)
            .execute(&mut connection)
            .await
            .unwrap();
        let known = store.repeated(&asked).await.unwrap();
        assert_eq!(known, Some(first.clone()).filter(|_| is_known), "{minutes} min");
    }
    assert_ne!(store.submit(request()).await.unwrap().job, first.job);
}

#[tokio::test]
async fn final_states_cannot_be_changed_by_any_sql() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    submit(&store, 1).await;
    let task = claim(&store, "w").await.unwrap();
    store.complete(task.fence, None).await.unwrap();
    let mut connection = SqliteConnectOptions::new()
        .filename(dir.path().join("torqued.sqlite"))
        .connect()
        .await
        .unwrap();
    for sql in ["UPDATE job SET state = 'failed'", "UPDATE task SET state = 'queued'"] {
        let error = sqlx::query(sql).execute(&mut connection).await.unwrap_err();
        assert!(error.to_string().contains("never changes"), "{error}");
    }
}

/// Adds an hour to all moments, as a clock that was set back by one hour sees them.
#[tokio::test]
async fn a_clock_that_was_set_back_does_not_stall_the_queue() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    submit(&store, 1).await;
    for attempt in 1..=2 {
        let task = claim(&store, "w").await.unwrap();
        assert_eq!(task.attempt, attempt);
        store.fail(task.fence, "out of luck", store::Retry::Allowed).await.unwrap();
    }
    assert!(claim(&store, "w").await.is_none(), "it waits 5 s");
    let options = SqliteConnectOptions::new().filename(dir.path().join("torqued.sqlite"));
    let mut connection = options.connect().await.unwrap();
    sqlx::query("UPDATE task SET run_at = run_at + 3600000")
        .execute(&mut connection)
        .await
        .unwrap();
    connection.close().await.unwrap();
    assert_eq!(claim(&store, "w").await.unwrap().attempt, 3);
}

/// Runs a statement behind the store's back, as another process could.
async fn change(dir: &Path, sql: &'static str) {
    let options = SqliteConnectOptions::new().filename(dir.join("torqued.sqlite"));
    let mut connection = options.connect().await.unwrap();
    sqlx::query(sql).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
}

fn of_priority(seed: u64, priority: i32) -> Submission {
    let mut submission = simulation(seed, 1, Reuse::Never);
    submission.jobs[0].execution.priority = priority;
    submission
}

/// The order in which the waiting jobs are claimed.
async fn order(store: &Store) -> Vec<JobId> {
    let mut jobs = Vec::new();
    while let Some(task) = claim(store, "w").await {
        jobs.push(task.job);
    }
    jobs
}

#[tokio::test]
async fn a_point_of_priority_is_made_up_for_by_an_hour_of_waiting() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    let old = store.submit(of_priority(1, 0)).await.unwrap().job;
    // Eleven hours pass.
    change(dir.path(), "UPDATE job SET waits_since = waits_since - 11 * 3600000").await;
    change(dir.path(), "UPDATE task SET turn = turn - 11 * 3600000").await;
    let ten = store.submit(of_priority(2, 10)).await.unwrap().job;
    let twelve = store.submit(of_priority(3, 12)).await.unwrap().job;
    assert_eq!(order(&store).await, [twelve, old, ten]);
}

/// A clock was an hour ahead, and is set back.
#[tokio::test]
async fn a_clock_that_was_set_back_lets_nobody_pass_who_came_later() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    let first = store.submit(of_priority(1, 0)).await.unwrap().job;
    change(dir.path(), "UPDATE job SET waits_since = waits_since + 3600000").await;
    change(dir.path(), "UPDATE task SET turn = turn + 3600000").await;
    let second = store.submit(of_priority(2, 0)).await.unwrap().job;
    let urgent = store.submit(of_priority(3, 1)).await.unwrap().job;
    assert_eq!(order(&store).await, [urgent, first, second]);
}

#[tokio::test]
async fn nobody_else_may_look_into_a_new_folder_and_an_old_one_keeps_its_mode() {
    use std::os::unix::fs::PermissionsExt as _;

    let parent = tempfile::tempdir().unwrap();
    let mode =
        |folder: &std::path::Path| std::fs::metadata(folder).unwrap().permissions().mode() & 0o777;
    let new = parent.path().join("labs/arm");
    Store::open(&new, Access::Server).await.unwrap().close().await;
    assert_eq!(mode(&new), 0o700);

    let shared = parent.path().join("shared");
    std::fs::create_dir(&shared).unwrap();
    std::fs::set_permissions(&shared, std::fs::Permissions::from_mode(0o750)).unwrap();
    Store::open(&shared, Access::Server).await.unwrap().close().await;
    assert_eq!(mode(&shared), 0o750);
}

/// Names from before there was a search are found as well.
#[tokio::test]
async fn names_of_an_older_version_are_found_after_the_server_has_started() {
    let dir = tempfile::tempdir().unwrap();
    let store = serve(dir.path()).await.unwrap();
    let named = |name: &str, seed| {
        let mut submission = simulation(seed, 1, Reuse::Never);
        submission.jobs[0].name = name.to_owned();
        submission
    };
    store.submit(named("ÄRGER", 1)).await.unwrap();
    store.submit(named("other", 2)).await.unwrap();
    store.close().await;
    drop(store);
    with_changed_database(dir.path(), "UPDATE job SET searched = NULL").await;
    let store = serve(dir.path()).await.unwrap();
    let listing = Listing { text: Some("ärg".to_owned()), ..Listing::default() };
    let found = store.list_jobs(&listing).await.unwrap().items;
    assert_eq!(found.iter().map(|job| job.name.as_str()).collect::<Vec<_>>(), ["ÄRGER"]);
}
