//! The scope that a request needs. The OpenAPI document decides: each operation names its scope
//! there.

use std::collections::HashMap;
use std::sync::Arc;

use axum::http::Method;
use utoipa::openapi::OpenApi;
use utoipa::openapi::path::Operation;
use wire::Scope;

use crate::parameters::operations;

/// The document's security scheme that lists scopes.
const SCHEME: &str = "token";

/// The prefix of MLflow's paths.
const MLFLOW: &str = "/api/";

/// The prefix of the API's paths. The page's paths do not have it.
const API: &str = "/v1";

/// The suffix of a form's path that deletes, because forms cannot send DELETE.
const DELETE_FORM: &str = "/delete";

/// The scope for each path and method.
#[derive(Clone, Default)]
pub struct Scopes(Arc<HashMap<(String, Method), Scope>>);

impl Scopes {
    pub fn of(document: &OpenApi) -> Self {
        let mut scopes = HashMap::new();
        for (path, item) in &document.paths.paths {
            for (method, operation) in operations(item) {
                let scope = declared(operation).unwrap_or_else(|| usual(&method));
                scopes.insert((path.clone(), method), scope);
            }
        }
        Self(Arc::new(scopes))
    }

    /// The scope for a request to a route; `route` is `None` if no route exists. A form of the page
    /// does the same as the operation with its path and POST, or PATCH, which forms cannot send. It
    /// needs the same scope.
    pub fn needed(&self, route: Option<&str>, method: &Method) -> Scope {
        // The answer reveals only that nothing is there.
        let Some(route) = route else { return Scope::Read };
        if route.starts_with(MLFLOW) {
            return of_mlflow(route, method);
        }
        let asked = if *method == Method::HEAD { &Method::GET } else { method };
        let known = |path: String, method: &Method| self.0.get(&(path, method.clone())).copied();
        let of_page = || format!("{API}{route}");
        let is_form = *method == Method::POST;
        let patched = || is_form.then(|| known(of_page(), &Method::PATCH)).flatten();
        let deleted = || {
            let of = route.strip_suffix(DELETE_FORM).filter(|_| is_form)?;
            known(format!("{API}{of}"), &Method::DELETE)
        };
        known(route.to_owned(), asked)
            .or_else(|| known(of_page(), asked))
            .or_else(patched)
            .or_else(deleted)
            .unwrap_or_else(|| usual(method))
    }
}

/// The scope that an operation names.
fn declared(operation: &Operation) -> Option<Scope> {
    let requirements = serde_json::to_value(operation.security.as_ref()?).ok()?;
    let mut schemes = requirements.as_array()?.iter().filter_map(|scheme| scheme.get(SCHEME));
    schemes.find_map(|scopes| scopes.get(0)?.as_str()?.parse().ok())
}

/// The scope for a path of MLflow, which the document leaves out. A caller that may submit may also
/// log runs. MLflow's clients search with POST.
fn of_mlflow(route: &str, method: &Method) -> Scope {
    if method.is_safe() || route.ends_with("/search") { Scope::Read } else { Scope::Submit }
}

/// Whether the audit log records requests to a route. It leaves out data that MLflow clients log to
/// a run, because each request is only a small part of the run.
pub fn is_recorded(route: Option<&str>) -> bool {
    let is_logged = |route: &str| route.starts_with(MLFLOW) && route.contains("/runs/log-");
    !route.is_some_and(is_logged)
}

/// The default scope. It is strict, so that forgetting to name one opens nothing.
fn usual(method: &Method) -> Scope {
    if method.is_safe() { Scope::Read } else { Scope::Admin }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_operation_says_its_scope_and_a_form_of_the_page_needs_the_same() {
        let scopes = Scopes::of(&crate::routes::operations().into_openapi());
        let post = |route| scopes.needed(Some(route), &Method::POST);
        assert_eq!(post("/v1/jobs/{id}/cancel"), Scope::Submit);
        assert_eq!(post("/jobs/{id}/cancel"), Scope::Submit);
        assert_eq!(post("/jobs/{id}"), Scope::Submit);
        assert_eq!(post("/v1/jobs/{id}"), Scope::Admin);
        assert_eq!(scopes.needed(Some("/v1/jobs/{id}"), &Method::PATCH), Scope::Submit);
        assert_eq!(post("/queue/pause"), Scope::Admin);
        assert_eq!(post("/datasets/{id}/delete"), Scope::Submit);
        assert_eq!(post("/v1/checkpoints/{id}/predict"), Scope::Read);
        assert_eq!(post("/no/such/route"), Scope::Admin);
        for method in [Method::GET, Method::HEAD] {
            assert_eq!(scopes.needed(Some("/v1/tokens"), &method), Scope::Admin);
        }
        assert_eq!(scopes.needed(Some("/jobs/{id}"), &Method::GET), Scope::Read);
        assert_eq!(scopes.needed(Some("/jobs/{id}"), &Method::HEAD), Scope::Read);
        assert_eq!(scopes.needed(None, &Method::POST), Scope::Read);
        assert_eq!(post("/api/2.0/mlflow/runs/search"), Scope::Read);
        assert_eq!(post("/api/2.0/mlflow/runs/create"), Scope::Submit);
        assert!(is_recorded(Some("/api/2.0/mlflow/runs/delete")) && is_recorded(None));
        assert!(!is_recorded(Some("/api/2.0/mlflow/runs/log-batch")));
    }
}
