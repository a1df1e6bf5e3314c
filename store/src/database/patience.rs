//! Patience of workers with a database that is away for a while, so that they do not lose their
//! work.

use std::time::{Duration, Instant};

use crate::StoreError;

/// How long a worker waits for an absent database before it gives up its task.
pub(crate) const PATIENCE: Duration = Duration::from_secs(10 * 60);

/// Pause between two tries.
const PAUSE: Duration = Duration::from_secs(1);

#[derive(Debug)]
pub(crate) struct Patience {
    began: Instant,
}

impl Patience {
    pub fn new() -> Self {
        Self { began: Instant::now() }
    }

    /// After `error`, waits a moment and returns false if another try may help: the database is
    /// away, or has no room until somebody deletes something. Returns true otherwise.
    pub async fn is_over(&self, error: &StoreError) -> bool {
        let may_pass = error.is_database_away() || matches!(error, StoreError::DiskFull { .. });
        if !may_pass || self.began.elapsed() > PATIENCE {
            return true;
        }
        tracing::warn!(error = error.to_string(), "the database cannot be written; trying again");
        tokio::time::sleep(PAUSE).await;
        false
    }
}

/// Repeats an idempotent action after the database was away or had no room: `patiently!({ ... })` with the body of
/// a function that returns a result.
macro_rules! patiently {
    ($operation:block) => {{
        let patience = $crate::database::patience::Patience::new();
        loop {
            match async { $operation }.await {
                Err(error) if !patience.is_over(&error).await => {}
                outcome => break outcome,
            }
        }
    }};
}
pub(crate) use patiently;
