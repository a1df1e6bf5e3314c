//! Which scope a request needs. The OpenAPI document is what decides: an operation names its scope there.

use std::collections::HashMap;
use std::sync::Arc;

use axum::http::Method;
use utoipa::openapi::OpenApi;
use utoipa::openapi::path::Operation;
use wire::Scope;

use crate::parameters::operations;

/// The security scheme of the document that lists a scope.
const SCHEME: &str = "token";

/// The prefix of MLflow's paths.
const MLFLOW: &str = "/api/";

/// The prefix of the API's paths, which the page's do not have.
const API: &str = "/v1";

/// The end of the path of a form that deletes, since forms have no such method.
const DELETE_FORM: &str = "/delete";

/// The scope that each path and method needs.
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

    /// The scope of a request to a route, `None` where there is no route. A form of the page does what the operation of the same
    /// path does, by POST or by PATCH, which forms cannot send, and needs the same.
    pub fn needed(&self, route: Option<&str>, method: &Method) -> Scope {
        // The answer says only that there is nothing.
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

/// The scope of a path of MLflow, which the document leaves out: whoever may submit may log runs. Its clients search by POST.
fn of_mlflow(route: &str, method: &Method) -> Scope {
    if method.is_safe() || route.ends_with("/search") { Scope::Read } else { Scope::Submit }
}

/// Whether the audit log has requests to a route. A metric that a client of MLflow logs is no deed of its own.
pub fn is_recorded(route: Option<&str>) -> bool {
    let is_logged = |route: &str| route.starts_with(MLFLOW) && route.contains("/runs/log-");
    !route.is_some_and(is_logged)
}

/// The scope of what says nothing of it: whoever forgets to say opens nothing.
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
