//! How SQLite finds what the statements ask for.

use sqlx::Row;
use wire::JobState;

use super::Database;
use super::statements::jobs::{SELECT_JOB, experiments};
use crate::data_dir::DataDir;
use crate::{Access, Page};

/// However many jobs pipelines made, none of them is looked at.
#[tokio::test]
async fn experiments_are_read_from_an_index_that_holds_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let dir = DataDir::new(folder.path());
    dir.create().unwrap();
    let database = Database::open(&dir, Access::Server).await.unwrap();
    for (state, index) in [(None, "experiment"), (Some(JobState::Failed), "experiment_by_state")] {
        let explain = format!("EXPLAIN QUERY PLAN {SELECT_JOB}");
        let mut query = experiments(explain, state, Page::default());
        let plan = query.build().fetch_all(&database.reader).await.unwrap();
        let steps: Vec<String> = plan.iter().map(|row| row.get("detail")).collect();
        let expected = format!("SEARCH job USING INDEX {index} (");
        assert!(steps[0].starts_with(&expected), "{steps:?}");
        assert!(!steps.iter().any(|step| step.contains("B-TREE")), "nothing is sorted: {steps:?}");
    }
}
