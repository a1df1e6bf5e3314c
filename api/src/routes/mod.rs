//! All paths of the API. The router and the OpenAPI document are built from one list.

mod audit;
mod datasets;
mod events;
mod files;
mod health;
mod jobs;
mod lists;
mod logs;
mod mlflow;
mod monitoring;
mod names;
mod openapi;
mod predictions;
mod presets;
mod problems;
mod queue;
mod resources;
mod robots;
mod runs;
mod tokens;
mod trajectories;
mod trash;
mod workers;

use axum::extract::{DefaultBodyLimit, Request};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router, middleware};
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::csrf::{CsrfLayer, ProtectionError};
use tower_http::trace::TraceLayer;
use utoipa::OpenApi as _;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::access::Scopes;
use crate::admission::{self, RequestPlaces};
use crate::app::App;
use crate::error::ApiError;
use crate::limits::BODY_BYTES;
use crate::pace::{self, AddressRateLimit};
use crate::parameters::KnownParameters;
use crate::remote::TrustedProxies;
use crate::routes::openapi::Document;
use crate::{access, aliases, guard, page, parameters, relative, remote, request_id};

pub fn operations() -> OpenApiRouter<App> {
    resources::add(OpenApiRouter::with_openapi(Document::openapi()))
        .routes(routes!(health::show))
        .routes(routes!(health::ready))
        .routes(routes!(monitoring::metrics))
        .routes(routes!(presets::list))
        .routes(routes!(jobs::submit))
        .routes(routes!(jobs::cancel))
        .routes(routes!(jobs::retry))
        .routes(routes!(jobs::tasks))
        .routes(routes!(jobs::attempts))
        .routes(routes!(logs::list))
        .routes(routes!(logs::file))
        .routes(routes!(robots::create))
        .routes(routes!(robots::file))
        .routes(routes!(robots::remove))
        .routes(routes!(datasets::create))
        .routes(routes!(datasets::verify))
        .routes(routes!(trajectories::show))
        .routes(routes!(trajectories::figure))
        .routes(routes!(trajectories::figure_data))
        .routes(routes!(trajectories::predictions))
        .routes(routes!(trajectories::summary))
        .routes(routes!(trajectories::spectrum))
        .routes(routes!(trajectories::spectrum_data))
        .routes(routes!(runs::metric))
        .routes(routes!(runs::metric_of_group))
        .routes(routes!(runs::artifact))
        .routes(routes!(runs::figure))
        .routes(routes!(predictions::predict))
        .routes(routes!(predictions::say_torques))
        .routes(routes!(predictions::open_stream))
        .routes(routes!(workers::list))
        .routes(routes!(workers::drain))
        .routes(routes!(workers::undrain))
        .routes(routes!(queue::show))
        .routes(routes!(queue::pause))
        .routes(routes!(queue::resume))
        .routes(routes!(tokens::list, tokens::create))
        .routes(routes!(tokens::revoke))
        .routes(routes!(audit::list))
        .routes(routes!(trash::list))
        .routes(routes!(events::all))
        .routes(routes!(events::of_job))
        .routes(routes!(events::of_run))
}

/// The OpenAPI document of every operation under `/v1`, and of `/healthz`, `/readyz` and `/metrics`.
pub fn openapi() -> serde_json::Value {
    openapi::complete(&operations().into_openapi())
}

/// The whole service: the API, the page, and the guards before them.
pub fn router(app: App) -> Router {
    let (api, operations) = operations().split_for_parts();
    let known = KnownParameters::of(&operations);
    let scopes = Scopes::of(&operations);
    let document = openapi::complete(&operations);
    let api = api
        .route("/v1/openapi.json", get(async move || Json(document)))
        .layer(middleware::from_fn_with_state(known, parameters::refuse_unknown));

    let (options, access) = (app.options(), app.access());
    // The first layer is the outermost.
    let guards = ServiceBuilder::new()
        .layer(middleware::from_fn(request_id::identify))
        .layer(TraceLayer::new_for_http())
        .layer(middleware::from_fn_with_state(app.clone(), guard::count))
        .layer(middleware::from_fn(guard::add_browser_headers))
        .layer(middleware::from_fn(relative::make_links_relative))
        .layer(middleware::from_fn(page::answer::problems_as_pages))
        .layer(middleware::from_fn(crate::mlflow::translate))
        .layer(CatchPanicLayer::custom(guard::answer_panic))
        .layer(middleware::from_fn_with_state(
            TrustedProxies::new(&options.trusted_proxies),
            remote::identify,
        ))
        .layer(middleware::from_fn_with_state(
            AddressRateLimit::new(options.requests_per_second),
            pace::keep,
        ))
        .layer(middleware::from_fn(guard::refuse_repeated))
        .layer(middleware::from_fn_with_state(access.clone(), access::identify))
        .layer(middleware::from_fn_with_state(
            RequestPlaces::new(options.connections),
            admission::admit,
        ))
        .layer(middleware::from_fn_with_state(access.clone(), access::require_loopback_name))
        .layer(middleware::from_fn_with_state((access.clone(), scopes), access::require_scope))
        .layer(CsrfLayer::new().with_rejection_response(refuse_cross_site))
        .layer(DefaultBodyLimit::max(BODY_BYTES));

    let routes = api.merge(page::routes());
    let unguarded = routes.clone().with_state(app.clone());
    routes
        .merge(mlflow::routes())
        .fallback(page::no_route)
        .method_not_allowed_fallback(refuse_method)
        .layer(middleware::from_fn_with_state((app.clone(), unguarded), aliases::resolve))
        .layer(guards)
        .with_state(app)
}

fn refuse_cross_site(_: ProtectionError) -> Response {
    ApiError::CrossSite.into_response()
}

async fn refuse_method(request: Request) -> ApiError {
    ApiError::Method { method: request.method().clone(), path: request.uri().path().to_owned() }
}
