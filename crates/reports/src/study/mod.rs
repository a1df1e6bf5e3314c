//! The paper's study: one pipeline, and a folder with the report.

mod machine;
mod plan;
mod report;
mod results;

pub use plan::Plan;
pub use report::{check_replaceable, write};
pub use results::{Evaluation, File, JobRecord, Study, Training};
