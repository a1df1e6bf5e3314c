use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::kind::KindSpec;
use crate::{DataSource, Execution, Reference};

/// Makes a dataset again, shard by shard, and compares it with the stored files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct VerifySpec {
    /// A dataset. A stream is not stored, so there is nothing to compare it with.
    pub data: DataSource,
    /// How the job is executed. It is not part of the digest.
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

impl KindSpec for VerifySpec {
    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        vec![Reference::data(&mut self.data)]
    }
}

impl Check for VerifySpec {
    fn check(&self, violations: &mut Violations) {
        if let DataSource::Stream(_) = self.data {
            violations.add("data", "a stream", r#"{"dataset": ID} or {"digest": HEX}"#);
        }
        violations.part("execution", &self.execution);
    }
}
