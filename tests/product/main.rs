//! The whole product from outside: the released program, its HTTP API, signals and full disks.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod archives;
mod backup;
mod bad_specs;
mod closed_loop;
mod commands;
mod configuration;
mod controlled;
mod data_folder;
mod deployment;
mod devices;
mod doctor;
mod doubted_logs;
mod events;
mod everywhere;
mod excite;
mod fine_tuning;
mod foreign_predictions;
mod forgiving;
mod four_models;
mod full_disk;
mod hard_stops;
mod identify;
mod imports;
mod killed_server;
mod killed_worker;
mod listening;
mod logs;
mod lone_worker;
mod migration;
mod noise;
mod other_arms;
mod pipeline;
mod placing;
mod predictions;
mod product;
mod quickstart;
mod redirects;
mod reindex;
mod robots;
#[expect(dead_code, reason = "the tests of the store have it fail")]
#[path = "../../store/tests/s3_server/mod.rs"]
mod s3_server;
mod shards;
mod slurm;
mod slurm_cluster;
mod small_disk;
mod stopping;
mod stored_predictions;
mod streams;
mod studies;
mod sweeps;
mod trainings;
mod trash;
