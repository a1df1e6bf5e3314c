//! The paper's study: its pipeline, the results of its jobs, and the folder with its report.

mod machine;
mod plan;
mod report;
mod results;

pub use plan::Plan;
pub use report::{check_replaceable, write};
pub use results::{Evaluation, File, JobRecord, Study, Training};
