//! Patience of workers with a database that goes away for a while: what they have made is not lost for it.

use std::time::{Duration, Instant};

use crate::StoreError;

/// How long a worker waits for a database that went away before it gives its task up.
pub(crate) const PATIENCE: Duration = Duration::from_secs(10 * 60);

/// Between two tries.
const PAUSE: Duration = Duration::from_secs(1);

#[derive(Debug)]
pub(crate) struct Patience {
    began: Instant,
}

impl Patience {
    pub fn new() -> Self {
        Self { began: Instant::now() }
    }

    /// Waits a moment if the same may be tried again after `error`, or returns whether not.
    pub async fn is_over(&self, error: &StoreError) -> bool {
        if !error.is_database_away() || self.began.elapsed() > PATIENCE {
            return true;
        }
        tracing::warn!(error = error.to_string(), "the database is away; trying again");
        tokio::time::sleep(PAUSE).await;
        false
    }
}

/// Does what may be done twice, again after the database was away: `patiently!({ ... })` with the body of a function that
/// returns a result.
macro_rules! patiently {
    ($operation:block) => {{
        let patience = $crate::patience::Patience::new();
        loop {
            match async { $operation }.await {
                Err(error) if !patience.is_over(&error).await => {}
                outcome => break outcome,
            }
        }
    }};
}
pub(crate) use patiently;
