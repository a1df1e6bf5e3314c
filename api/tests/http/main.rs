//! Tests of the service through its router: requests, and answers compared with the promises.

#![expect(clippy::unwrap_used, reason = "a test stops where its case cannot be set up")]

mod access;
mod answers;
mod buttons;
mod compare;
mod connections;
mod contract;
mod damage;
mod documented;
mod downloads;
mod events;
mod fixture;
mod fuzz;
mod labels;
mod launch;
mod lineage;
mod lists;
mod logs;
mod mlflow;
mod monitoring;
mod now;
mod pages;
mod problems;
mod references;
mod request_ids;
mod resources;
mod robots;
mod serving;
mod streams;
mod submission;
mod tables;
mod tokens;
mod torques;
mod trainings;
mod trajectories;
mod trash;
mod uploads;
mod verification;
mod waiting;
mod worst;
