//! Tests of the query plans that SQLite chooses.

use spec::Resources;
use wire::JobState;

use crate::database::query::sql;
use crate::database::{Database, Scope};
use crate::lists::statements::listing::page;
use crate::place::data_dir::DataDir;
use crate::{Access, Direction, ItemKind, Key, Listing, Position, Sort};

/// The cost does not grow with the number of jobs that pipelines made.
#[tokio::test]
async fn experiments_are_read_from_an_index_that_holds_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let dir = DataDir::new(folder.path());
    dir.create().unwrap();
    let database = Database::open(&dir, None, Access::Server).await.unwrap();
    for (state, index) in [(None, "experiment"), (Some(JobState::Failed), "experiment_by_state")] {
        let state = state.map(|state| state.as_str().to_owned());
        let listing = Listing { state, experiments_alone: true, ..Listing::default() };
        let steps = steps(&database, ItemKind::Job, &listing).await;
        assert!(steps[0].contains(&format!("INDEX {index}")), "{steps:?}");
        assert!(!steps.iter().any(|step| step.contains("B-TREE")), "nothing is sorted: {steps:?}");
    }
}

/// The steps of the plan that finds a page of a list.
async fn steps(database: &Database, item: ItemKind, listing: &Listing) -> Vec<String> {
    let query = page("EXPLAIN QUERY PLAN ", item, listing);
    let plan = query.rows(&mut database.read("testing")).await.unwrap();
    plan.iter().map(|row| row.get("detail").unwrap()).collect()
}

/// The errors of items are not in an index, but nothing but the items themselves is read for them.
#[tokio::test]
async fn an_order_by_error_looks_up_one_row_per_thing() {
    let folder = tempfile::tempdir().unwrap();
    let dir = DataDir::new(folder.path());
    dir.create().unwrap();
    let database = Database::open(&dir, None, Access::Server).await.unwrap();
    for (item, found, looked_up) in [
        (
            ItemKind::Job,
            "SEARCH job USING INDEX job_by_kind",
            "SEARCH task USING INDEX sqlite_autoindex_task_1 (job=?)",
        ),
        (ItemKind::Run, "SCAN run", "SEARCH metric_latest USING PRIMARY KEY (run=? AND key=?)"),
        (ItemKind::Checkpoint, "SCAN checkpoint", "SCAN checkpoint"),
    ] {
        let kind = (item == ItemKind::Job).then(|| "evaluate".to_owned());
        let listing = Listing { kind, sort: Sort::Rmse, ..Listing::default() };
        let steps = steps(&database, item, &listing).await;
        assert!(steps[0].starts_with(found), "{steps:?}");
        assert!(steps.iter().any(|step| step.starts_with(looked_up)), "{steps:?}");
        let reads_jobs = steps.iter().any(|step| step.contains(" job "));
        assert_eq!(reads_jobs, item == ItemKind::Job, "{steps:?}");
    }
}

/// These orders have an index, so a page costs the same however long the list is.
#[tokio::test]
async fn a_page_behind_another_is_read_from_an_index_of_its_order() {
    let folder = tempfile::tempdir().unwrap();
    let dir = DataDir::new(folder.path());
    dir.create().unwrap();
    let database = Database::open(&dir, None, Access::Server).await.unwrap();
    let orders = [
        (ItemKind::Job, Sort::Created, "INTEGER PRIMARY KEY"),
        (ItemKind::Job, Sort::Finished, "INDEX job_by_finish"),
        (ItemKind::Job, Sort::Name, "INDEX job_by_name"),
        (ItemKind::Job, Sort::Priority, "INDEX job_by_priority"),
        (ItemKind::Run, Sort::Created, "INTEGER PRIMARY KEY"),
        (ItemKind::Dataset, Sort::Created, "INTEGER PRIMARY KEY"),
        (ItemKind::Dataset, Sort::Trajectories, "INDEX dataset_by_trajectories"),
        (ItemKind::Checkpoint, Sort::Created, "INTEGER PRIMARY KEY"),
        (ItemKind::Checkpoint, Sort::Step, "INDEX checkpoint_by_step"),
    ];
    for (item, sort, index) in orders {
        let key = if sort == Sort::Name { Key::Text("n".into()) } else { Key::Integer(7) };
        for direction in [Direction::Ascending, Direction::Descending] {
            let after = Some(Position { key: key.clone(), id: 7 });
            let listing = Listing { sort, direction, after, ..Listing::default() };
            let steps = steps(&database, item, &listing).await;
            let expected = format!("SEARCH {} USING ", item.as_str());
            assert!(steps[0].starts_with(&expected) && steps[0].contains(index), "{steps:?}");
            assert!(
                !steps.iter().any(|step| step.contains("B-TREE")),
                "nothing is sorted: {steps:?}"
            );
        }
    }
}

const TASKS: u32 = 100_000;

/// A database with a job whose tasks all wait: some for a GPU, and some until tomorrow.
async fn with_many_tasks(dir: &DataDir) -> Database {
    dir.create().unwrap();
    let database = Database::open(dir, None, Access::Server).await.unwrap();
    let mut tx = database.begin(Scope::Queue, "testing").await.unwrap();
    let gpu = Resources { gpus: 1, ..Resources::default() };
    let gpu = tx.resources_id(&gpu).await.unwrap();
    sql("INSERT INTO job (kind, name, spec, digest, state, unit, priority, max_attempts, \
         is_part, asked_alone, created_at) VALUES ('k', 'n', '{}', $1, 'queued', 'u', 0, 3, 0, \
         1, 0)")
    .bind("0".repeat(64))
    .run(&mut tx)
    .await
    .unwrap();
    sql("WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n \
         WHERE i < $1) INSERT INTO task (job, stage, ordinal, label, payload, state, turn, \
         run_at, max_attempts, total, resources, not_before) \
         SELECT 1, 0, i, 'l', '{}', 'queued', i, 0, 3, 1, CASE i % 2 WHEN 0 THEN $2 ELSE 1 END, \
         CASE i % 4 WHEN 1 THEN {now} + 86400000 ELSE 0 END FROM n")
    .bind(TASKS)
    .bind(gpu)
    .run(&mut tx)
    .await
    .unwrap();
    tx.commit().await.unwrap();
    database
}

/// The cost does not grow with the number of waiting tasks that this worker cannot take.
#[tokio::test]
async fn the_first_in_line_is_found_in_an_index_without_sorting() {
    let folder = tempfile::tempdir().unwrap();
    let database = with_many_tasks(&DataDir::new(folder.path())).await;
    let plan = sql("EXPLAIN QUERY PLAN {first_in_line}")
        .bind("w")
        .bind(0)
        .bind(0)
        .bind(0)
        .bind("[]")
        .rows(&mut database.read("testing"))
        .await
        .unwrap();
    let steps: Vec<String> = plan.iter().map(|row| row.get("detail").unwrap()).collect();
    let found = "SEARCH task USING COVERING INDEX task_to_claim (resources=?)";
    assert!(steps.iter().any(|step| step == found), "{steps:#?}");
    // Only the first task of each combination of resources is sorted.
    let sorts = steps.iter().filter(|step| step.contains("B-TREE")).count();
    assert_eq!(sorts, 1, "{steps:#?}");

    let nothing = Resources::default();
    assert!(database.read("testing").poll("w", &nothing).await.unwrap().is_any_claimable);
    let mut tx = database.begin(Scope::Queue, "testing").await.unwrap();
    let next = tx.next_task("w", &nothing).await.unwrap().unwrap();
    assert_eq!(next.task.ordinal, 3);
}

#[tokio::test]
async fn what_tasks_ask_for_is_counted_in_an_index() {
    let folder = tempfile::tempdir().unwrap();
    let database = with_many_tasks(&DataDir::new(folder.path())).await;
    let demand = database.read("testing").demand().await.unwrap();
    let counts: Vec<u64> = demand.iter().map(|demand| demand.waiting).collect();
    assert_eq!(counts, [u64::from(TASKS) / 2, u64::from(TASKS) / 4]);
}
