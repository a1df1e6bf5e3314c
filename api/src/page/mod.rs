//! The page: HTML that works without scripts, from the same data as the API.

mod all_runs;
pub mod answer;
mod assets;
mod cancel;
mod checkpoint;
mod comparable;
mod compare;
mod dataset;
mod docs;
mod evaluation;
mod experiments;
mod filter_query;
mod follow_up;
mod instant;
mod job;
mod job_result;
mod kinds;
mod labels;
mod launch;
mod lineage;
mod lists;
mod logged;
mod login;
mod note;
mod parts;
mod predict;
mod predictions;
mod recordings;
mod robot;
mod rows;
mod run;
mod spec_form;
mod spec_text;
mod sweep;
mod text;
mod trash;
mod upload;
mod verification;
mod viewer;
mod workers;

use axum::Router;
use axum::extract::Request;
use axum::http::HeaderMap;
use axum::response::Response;
use axum::routing::{MethodRouter, get, post};
use wire::{Checkpoint, Dataset, Evaluation, ItemKind, Robot, Run};

use crate::access::{LOGIN, LOGOUT};
use crate::app::App;
use crate::error::ApiError;
use crate::page::answer::refused;

pub fn routes() -> Router<App> {
    paths().into_iter().fold(Router::new(), |router, (path, methods)| router.route(path, methods))
}

/// Every path of the page, with its handler.
pub fn paths() -> [(&'static str, MethodRouter<App>); 42] {
    [
        ("/", get(experiments::show)),
        ("/launch", get(launch::show)),
        ("/jobs", post(launch::submit)),
        ("/jobs/{id}", get(job::show).merge(labels::form(ItemKind::Job))),
        ("/jobs/{id}/cancel", get(cancel::ask).post(cancel::cancel)),
        ("/jobs/{id}/retry", post(job::retry)),
        ("/runs", get(lists::show::<Run>)),
        ("/logged", get(all_runs::show)),
        ("/logged/{id}", get(logged::show)),
        ("/compare", get(compare::show)),
        ("/predict", get(predict::show)),
        ("/runs/{id}", get(run::show).merge(labels::form(ItemKind::Run))),
        ("/evaluations", get(lists::show::<Evaluation>)),
        ("/evaluations/{id}", get(evaluation::show)),
        ("/upload", get(upload::show)),
        ("/datasets", get(lists::show::<Dataset>).post(upload::recordings)),
        ("/datasets/{id}", get(dataset::show).merge(labels::form(ItemKind::Dataset))),
        ("/datasets/{id}/verify", post(dataset::verify)),
        ("/checkpoints", get(lists::show::<Checkpoint>)),
        ("/checkpoints/{id}", get(checkpoint::show).merge(labels::form(ItemKind::Checkpoint))),
        ("/robots", get(lists::show::<Robot>).post(upload::robot)),
        ("/robots/{id}", get(robot::show)),
        ("/robots/{id}/delete", post(robot::delete)),
        ("/workers", get(workers::show)),
        ("/workers/{name}/drain", post(workers::drain)),
        ("/workers/{name}/undrain", post(workers::undrain)),
        ("/queue/pause", post(workers::pause)),
        ("/queue/resume", post(workers::resume)),
        ("/jobs/{id}/delete", trash::deletion(ItemKind::Job)),
        ("/jobs/{id}/restore", trash::restoration(ItemKind::Job)),
        ("/runs/{id}/delete", trash::deletion(ItemKind::Run)),
        ("/runs/{id}/restore", trash::restoration(ItemKind::Run)),
        ("/datasets/{id}/delete", trash::deletion(ItemKind::Dataset)),
        ("/datasets/{id}/restore", trash::restoration(ItemKind::Dataset)),
        ("/checkpoints/{id}/delete", trash::deletion(ItemKind::Checkpoint)),
        ("/checkpoints/{id}/restore", trash::restoration(ItemKind::Checkpoint)),
        ("/trash", get(trash::show)),
        (LOGIN, get(login::show).post(login::log_in)),
        (LOGOUT, post(login::log_out)),
        ("/docs", get(docs::show)),
        ("/docs/{name}", get(docs::file)),
        ("/static/{name}", get(assets::show)),
    ]
}

/// Answers a request without a route: with HTML to a browser, and with a problem to other clients.
pub async fn no_route(headers: HeaderMap, request: Request) -> Response {
    let error = ApiError::NoRoute { path: request.uri().path().to_owned() };
    refused(error, &headers)
}
