//! The studies: their pipelines, the results of its jobs, and the folder with their reports.

#[cfg(test)]
mod fixture;
mod folder;
mod machine;
mod paper;
mod plan;
mod real;
mod report;
mod results;
mod tables;
mod text;

pub use folder::check_replaceable;
pub use plan::Plan;
pub use report::write;
pub use results::{Evaluation, File, JobRecord, Study, Training};
