//! Deletes things, shows what depends on them, and lists the trash.

use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use store::Respect;
use utoipa::IntoParams;
use wire::Trash;

use crate::app::{App, Paging};
use crate::error::ApiError;
use crate::extract::Query;

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct DeleteParameters {
    /// Delete it even if ended jobs depend on it. These jobs stay as they are.
    #[serde(default)]
    force: bool,
}

impl DeleteParameters {
    fn respect(&self) -> Respect {
        if self.force { Respect::Open } else { Respect::All }
    }
}

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct TrashParameters {
    /// Largest number of items, 1 to 500; 50 by default.
    limit: Option<u32>,
    /// Only items that come after this one. Pass the `next` of the page before.
    before: Option<String>,
}

/// List the trash, latest deletion first. Each item has the date until which it can be restored.
#[utoipa::path(
    get,
    path = "/v1/trash",
    tag = "trash",
    params(TrashParameters),
    responses((status = 200, body = Trash)),
)]
pub async fn list(
    State(app): State<App>,
    Query(parameters): Query<TrashParameters>,
) -> Result<Json<Trash>, ApiError> {
    let limit = Paging::new(parameters.limit, None)?.limit;
    Ok(Json(app.trash(limit, parameters.before.as_deref()).await?))
}

/// Defines the three operations for one kind of thing.
macro_rules! deletable {
    ($module:ident, $kind:ident, $tag:tt, $path:tt, $restore:tt, $dependents:tt, $about:tt) => {
        pub mod $module {
            use axum::Json;
            use axum::extract::State;
            use wire::{Deleted, Dependents, ItemKind, Restored};

            use super::DeleteParameters;
            use crate::app::App;
            use crate::error::ApiError;
            use crate::extract::{Path, Query};

            #[doc = $about]
            #[utoipa::path(
                                                delete,
                                                path = $path,
                                                tag = $tag,
                                                security((), ("token" = ["submit"])),
                                                params(("id" = i64, Path), DeleteParameters),
                                                responses((status = 200, body = Deleted)),
                                            )]
            pub async fn remove(
                State(app): State<App>,
                Path(id): Path<i64>,
                Query(parameters): Query<DeleteParameters>,
            ) -> Result<Json<Deleted>, ApiError> {
                Ok(Json(app.delete(ItemKind::$kind, id, parameters.respect()).await?))
            }

            /// Restore it from the trash, with everything that was deleted together with it.
            #[utoipa::path(
                                                post,
                                                path = $restore,
                                                tag = $tag,
                                                security((), ("token" = ["submit"])),
                                                params(("id" = i64, Path)),
                                                responses((status = 200, body = Restored)),
                                            )]
            pub async fn restore(
                State(app): State<App>,
                Path(id): Path<i64>,
            ) -> Result<Json<Restored>, ApiError> {
                Ok(Json(app.restore(ItemKind::$kind, id).await?))
            }

            /// List the things that would be deleted together with it, and the jobs that depend on
            /// it.
            #[utoipa::path(
                                                get,
                                                path = $dependents,
                                                tag = $tag,
                                                params(("id" = i64, Path)),
                                                responses((status = 200, body = Dependents)),
                                            )]
            pub async fn dependents(
                State(app): State<App>,
                Path(id): Path<i64>,
            ) -> Result<Json<Dependents>, ApiError> {
                Ok(Json(app.dependents(ItemKind::$kind, id).await?))
            }
        }
    };
}

deletable!(
    job,
    Job,
    "jobs",
    "/v1/jobs/{id}",
    "/v1/jobs/{id}/restore",
    "/v1/jobs/{id}/dependents",
    "Move an ended job into the trash, with its logs and all its results; a pipeline with the jobs that were made for it."
);
deletable!(
    run,
    Run,
    "runs",
    "/v1/runs/{id}",
    "/v1/runs/{id}/restore",
    "/v1/runs/{id}/dependents",
    "Move a run into the trash, with its metrics, files and checkpoints."
);
deletable!(
    dataset,
    Dataset,
    "datasets",
    "/v1/datasets/{id}",
    "/v1/datasets/{id}/restore",
    "/v1/datasets/{id}/dependents",
    "Move a dataset into the trash."
);
deletable!(
    checkpoint,
    Checkpoint,
    "checkpoints",
    "/v1/checkpoints/{id}",
    "/v1/checkpoints/{id}/restore",
    "/v1/checkpoints/{id}/dependents",
    "Move a checkpoint into the trash."
);
