//! MLflow's own limits (`mlflow/utils/validation.py`), in characters or items. Exceeding one gives
//! INVALID_PARAMETER_VALUE.

/// Characters of the key of a metric, a param or a tag.
pub const KEY: usize = 250;

/// Characters of the value of a param.
pub const PARAM_VALUE: usize = 6000;

/// Characters of the value of a tag of a run.
pub const TAG_VALUE: usize = 8000;

/// Characters of the value of a tag of an experiment.
pub const EXPERIMENT_TAG_VALUE: usize = 20_000;

/// Characters of the name of an experiment.
pub const EXPERIMENT_NAME: usize = 500;

/// Characters of the name of a run, and of its user's name.
pub const RUN_NAME: usize = 500;

/// Metrics of one batch.
pub const METRICS_PER_BATCH: usize = 1000;

/// Params of one batch, and tags.
pub const TEXTS_PER_BATCH: usize = 100;

/// Metrics, params and tags of one batch together.
pub const ENTITIES_PER_BATCH: usize = 1000;

/// Default number of runs or experiments on a page.
pub const PAGE_DEFAULT: u32 = 1000;

/// Largest number of runs or experiments on a page.
pub const PAGE_MAXIMUM: u32 = 50_000;

/// Points on a page of a metric.
pub const HISTORY_PAGE: u32 = 25_000;

/// Bytes of the name of an artifact, including its folders.
pub const ARTIFACT_NAME: usize = 1000;

/// Characters of the pattern of LIKE. A comparison takes up to the product of both lengths.
pub const PATTERN: usize = 500;

/// Clauses of a filter, and items of an order.
pub const CLAUSES: usize = 100;
