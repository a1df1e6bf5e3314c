//! Tokens with scopes, logins with them, and the audit log.

use std::collections::BTreeMap;

use api::Options;
use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HOST};
use axum::http::{Method, Request};
use serde_json::{Value, json};

use crate::fixture::{Server, TestResponse, small_simulation};

/// A server with one token of each scope, named after its scope.
struct Guarded {
    server: Server,
    /// Values of `Authorization`.
    credentials: BTreeMap<&'static str, String>,
}

const SCOPES: [&str; 3] = ["admin", "submit", "read"];

impl Guarded {
    async fn start() -> Self {
        let server = Server::start().await;
        let mut credentials: BTreeMap<&'static str, String> = BTreeMap::new();
        for scope in SCOPES {
            let asked = json!({"name": scope, "scope": scope});
            let by = credentials.get("admin").map(String::as_str);
            let answer = create(&server, &asked, by).await;
            assert_eq!(answer.status, 201, "{answer:?}");
            credentials.insert(scope, bearer(&answer));
        }
        Self { server, credentials }
    }

    async fn request(&self, method: Method, path: &str, scope: &str) -> TestResponse {
        let headers = [("authorization", self.credentials[scope].as_str())];
        self.server.request(method, path, &headers).await
    }
}

async fn create(server: &Server, asked: &Value, credentials: Option<&str>) -> TestResponse {
    let headers: Vec<_> = credentials.map(|value| ("authorization", value)).into_iter().collect();
    server.submit_to("/v1/tokens", asked, &headers).await
}

fn bearer(created: &TestResponse) -> String {
    format!("Bearer {}", created.json()["secret"].as_str().unwrap())
}

/// An operation's scope in the document; `None` if it needs no token.
fn needed(operation: &Value, whole: &Value) -> Option<String> {
    let security = operation.get("security").unwrap_or(&whole["security"]);
    let schemes = security.as_array().unwrap();
    let scopes = schemes.iter().find_map(|scheme| scheme.get("token"))?;
    Some(scopes[0].as_str().unwrap().to_owned())
}

fn reaches(scope: &str, needed: &str) -> bool {
    let rank = |scope| SCOPES.iter().position(|candidate| *candidate == scope).unwrap();
    rank(scope) <= rank(needed)
}

#[tokio::test]
async fn every_operation_is_refused_to_all_scopes_but_those_that_reach_it() {
    let guarded = Guarded::start().await;
    let document = serde_json::to_value(api::openapi()).unwrap();
    let mut checked = 0;
    for (path, item) in document["paths"].as_object().unwrap() {
        for (name, operation) in item.as_object().unwrap() {
            let method = Method::from_bytes(name.to_uppercase().as_bytes()).unwrap();
            let needed = needed(operation, &document);
            let path = path.replace("{id}", "999").replace("{name}", "x").replace("{index}", "0");
            let path = path.replace("{key}", "x").replace("{group}", "x");
            let nobody = guarded.server.request(method.clone(), &path, &[]).await;
            let Some(needed) = needed else {
                assert_ne!(nobody.status, 401, "{name} {path}");
                continue;
            };
            nobody.problem(401);
            for scope in SCOPES {
                let answer = guarded.request(method.clone(), &path, scope).await;
                if reaches(scope, &needed) {
                    assert!(![401, 403].contains(&answer.status.as_u16()), "{name} {path} {scope}");
                } else {
                    let problem = answer.problem(403);
                    assert_eq!(problem["type"], "tag:torqued,2026:scope");
                }
                checked += 1;
            }
        }
    }
    assert!(checked > 100, "{checked}");
}

#[tokio::test]
async fn every_page_is_closed_without_a_token_and_its_forms_to_readers() {
    let guarded = Guarded::start().await;
    for (path, _) in api::page_paths() {
        let route = path;
        let path = path.replace("{id}", "999").replace("{name}", "x");
        if ["/static/{name}", "/login", "/logout"].contains(&route) {
            assert_ne!(guarded.server.get(&path).await.status, 401, "{path}");
            continue;
        }
        guarded.server.get(&path).await.problem(401);
        guarded.server.request(Method::POST, &path, &[]).await.problem(401);
        guarded.request(Method::POST, &path, "read").await.problem(403);
        assert_ne!(guarded.request(Method::GET, &path, "read").await.status, 403, "{path}");
    }
}

#[tokio::test]
async fn who_may_only_read_submits_nothing_and_learns_why() {
    let guarded = Guarded::start().await;
    let spec = small_simulation(1);
    let headers = [("authorization", guarded.credentials["read"].as_str())];
    let problem = guarded.server.submit_to("/v1/jobs", &spec, &headers).await.problem(403);
    assert_eq!(
        problem["detail"],
        "the token read has the scope read, but this request needs submit; ask the server's administrator for such a token"
    );
    let headers = [("authorization", guarded.credentials["submit"].as_str())];
    let answer = guarded.server.submit_to("/v1/jobs", &spec, &headers).await;
    assert_eq!(answer.status, 201, "{answer:?}");
}

#[tokio::test]
async fn a_revoked_token_opens_nothing_from_the_next_request_on() {
    let guarded = Guarded::start().await;
    let list = guarded.request(Method::GET, "/v1/tokens", "admin").await.json();
    let named = |name: &str| {
        let tokens = list["tokens"].as_array().unwrap();
        tokens.iter().find(|token| token["name"] == name).unwrap()["id"].clone()
    };
    assert_eq!(guarded.request(Method::GET, "/v1/jobs", "read").await.status, 200);
    let path = format!("/v1/tokens/{}", named("read"));
    let revoked = guarded.request(Method::DELETE, &path, "admin").await;
    assert_eq!((revoked.status.as_u16(), &revoked.json()["valid"]), (200, &json!(false)));
    guarded.request(Method::GET, "/v1/jobs", "read").await.problem(401);
    guarded.request(Method::DELETE, "/v1/tokens/999", "admin").await.problem(404);
}

#[tokio::test]
async fn a_token_is_shown_once_and_kept_as_its_digest() {
    let guarded = Guarded::start().await;
    let list = guarded.request(Method::GET, "/v1/tokens", "admin").await;
    for credentials in guarded.credentials.values() {
        let secret = credentials.strip_prefix("Bearer ").unwrap();
        assert!(secret.starts_with("torqued_") && secret.len() == 51, "{secret}");
        assert!(!list.text().contains(secret));
    }
    let used = &list.json()["tokens"][0];
    assert_eq!(used["name"], "admin");
    assert!(used["last_used_at"].is_string(), "{used}");
}

#[tokio::test]
async fn a_token_that_cannot_be_made_is_refused_with_every_reason() {
    let server = Server::start().await;
    let problem =
        create(&server, &json!({"name": "ana", "scope": "read"}), None).await.problem(409);
    assert!(
        problem["detail"].as_str().unwrap().starts_with("the first token has the scope read"),
        "{problem}"
    );
    let asked = json!({"name": "a b", "scope": "admin", "expires_in_s": 1});
    let problem = create(&server, &asked, None).await.problem(422);
    let fields: Vec<_> = problem["violations"]
        .as_array()
        .unwrap()
        .iter()
        .map(|violation| violation["field"].clone())
        .collect();
    assert_eq!(fields, ["name", "expires_in_s"]);
    for wrong in [json!({"name": "ana", "scope": "root"}), json!({"name": "ana"}), json!([])] {
        create(&server, &wrong, None).await.problem(422);
    }
    // No token was created, so the server is still open.
    assert_eq!(server.get("/v1/jobs").await.status, 200);
    let made = create(&server, &json!({"name": "ana", "scope": "admin"}), None).await;
    let (asked, admin) = (json!({"name": "ana", "scope": "admin"}), bearer(&made));
    create(&server, &asked, Some(&admin)).await.problem(409);
}

#[tokio::test]
async fn an_expired_token_opens_nothing() {
    let guarded = Guarded::start().await;
    let expired = store::NewToken {
        name: "brief",
        digest: api::token_digest("brief"),
        scope: store::Scope::Admin,
        lifetime: Some(std::time::Duration::from_millis(1)),
        needs_an_admin: true,
    };
    guarded.server.store.create_token(&expired).await.unwrap();
    tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    let headers = [("authorization", "Bearer brief")];
    guarded.server.request(Method::GET, "/v1/jobs", &headers).await.problem(401);
}

#[tokio::test]
async fn the_servers_own_token_administers_beside_those_of_the_store() {
    let options = Options { token: Some("secret".to_owned()), ..Options::default() };
    let server = Server::start_with(&options).await;
    let made =
        create(&server, &json!({"name": "ben", "scope": "read"}), Some("Bearer secret")).await;
    assert_eq!(made.status, 201, "{made:?}");
    let headers = [("authorization", bearer(&made))];
    let headers = headers.each_ref().map(|(name, value)| (*name, value.as_str()));
    assert_eq!(server.request(Method::GET, "/v1/jobs", &headers).await.status, 200);
    server.request(Method::GET, "/v1/tokens", &headers).await.problem(403);
}

#[tokio::test]
async fn the_audit_log_says_who_did_what_and_what_became_of_it() {
    let guarded = Guarded::start().await;
    let headers = [("authorization", guarded.credentials["submit"].as_str())];
    guarded.server.submit_to("/v1/jobs", &small_simulation(1), &headers).await;
    guarded.request(Method::POST, "/v1/jobs/1/cancel?x=1", "read").await.problem(403);
    guarded.request(Method::GET, "/v1/jobs", "read").await;
    let log = guarded.request(Method::GET, "/v1/audit", "admin").await.json();
    let entries: Vec<_> = log["entries"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| {
            let text = |field: &str| entry[field].as_str().unwrap_or("").to_owned();
            format!(
                "{} {} {} {} {}",
                text("actor"),
                text("method"),
                text("path"),
                entry["status"],
                text("made")
            )
        })
        .collect();
    assert_eq!(
        entries,
        [
            "read POST /v1/jobs/1/cancel?x=1 403 ",
            "submit POST /v1/jobs 201 /v1/jobs/1",
            "admin POST /v1/tokens 201 ",
            "admin POST /v1/tokens 201 ",
            "anyone POST /v1/tokens 201 ",
        ]
    );
    let of_one =
        guarded.request(Method::GET, "/v1/audit?actor=submit&limit=1", "admin").await.json();
    assert_eq!(of_one["entries"].as_array().unwrap().len(), 1);
    guarded.request(Method::GET, "/v1/audit", "submit").await.problem(403);
}

/// Sends a request like a browser, for a page or with the fields of a form.
async fn browse(
    server: &Server,
    method: Method,
    path: &str,
    cookie: &str,
    body: &str,
) -> TestResponse {
    let request = Request::builder()
        .method(method)
        .uri(path)
        .header(HOST, "torqued.lab")
        .header("accept", "text/html")
        .header("cookie", cookie)
        .header("sec-fetch-site", "same-origin")
        .header(CONTENT_TYPE, "application/x-www-form-urlencoded");
    server.send(request.body(Body::from(body.to_owned())).unwrap()).await
}

#[tokio::test]
async fn a_browser_logs_in_goes_on_to_the_page_it_wanted_and_logs_out() {
    let Guarded { server, credentials } = Guarded::start().await;
    let sent = browse(&server, Method::GET, "/jobs/1?x=1", "", "").await;
    assert_eq!(
        (sent.status.as_u16(), sent.header("location")),
        (303, "/login?back=%2Fjobs%2F1%3Fx%3D1")
    );
    // A program that also accepts HTML gets a problem.
    browse(&server, Method::GET, "/v1/jobs", "", "").await.problem(401);
    let form = browse(&server, Method::GET, sent.header("location"), "", "").await;
    assert!(form.text().contains("value=\"/jobs/1?x=1\""), "{}", form.text());

    let refused = browse(&server, Method::POST, "/login", "", "token=wrong&back=%2F").await;
    assert_eq!(refused.status, 401);
    assert!(refused.text().contains("The token is not valid"));
    assert!(refused.headers.get("set-cookie").is_none());

    let token = credentials["submit"].strip_prefix("Bearer ").unwrap();
    let body = format!("token={token}&back=%2Fworkers");
    let welcome = browse(&server, Method::POST, "/login", "", &body).await;
    assert_eq!((welcome.status.as_u16(), welcome.header("location")), (303, "/workers"));
    let cookie = welcome.header("set-cookie");
    assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Lax"), "{cookie}");
    let cookie = cookie.split(';').next().unwrap().to_owned();
    assert!(!cookie.contains(token));

    let page = browse(&server, Method::GET, "/workers", &cookie, "").await;
    assert_eq!(page.status, 200);
    assert!(page.text().contains("<span>submit</span>"), "{}", page.text());
    let paused = browse(&server, Method::POST, "/queue/pause", &cookie, "").await;
    assert_eq!(paused.status, 403);

    let left = browse(&server, Method::POST, "/logout", &cookie, "").await;
    assert!(left.header("set-cookie").contains("Max-Age=0"));
    assert_eq!(browse(&server, Method::GET, "/workers", &cookie, "").await.status, 303);
}

/// A failed login left no trace in the audit log.
#[tokio::test]
async fn failed_logins_and_wrong_tokens_are_in_the_audit_log_without_the_token() {
    let Guarded { server, credentials } = Guarded::start().await;
    browse(&server, Method::POST, "/login", "", "token=guess-one&back=%2F").await;
    let wrong = [("authorization", "Bearer guess-two")];
    server.request(Method::POST, "/v1/queue/pause", &wrong).await.problem(401);
    server.get("/v1/jobs").await.problem(401);
    let headers = [("authorization", credentials["admin"].as_str())];
    let log = server.request(Method::GET, "/v1/audit?actor=nobody", &headers).await;
    assert!(!log.text().contains("guess"), "{log:?}");
    let log = log.json();
    let entries = log["entries"].as_array().unwrap().iter();
    let entries: Vec<_> =
        entries.map(|entry| (&entry["method"], &entry["path"], &entry["status"])).collect();
    let (post, refused) = (json!("POST"), json!(401));
    let paths = [json!("/v1/queue/pause"), json!("/login")];
    assert_eq!(entries, [(&post, &paths[0], &refused), (&post, &paths[1], &refused)]);
    let asked = json!({"name": "nobody", "scope": "read"});
    create(&server, &asked, Some(&credentials["admin"])).await.problem(422);
}

/// `back` was cut inside its first character, which ended the handler.
#[tokio::test]
async fn a_login_leads_back_to_nothing_but_a_path() {
    let server = Guarded::start().await.server;
    for back in ["%C3%A9", "%E2%82%AC/jobs", "%FF", "", "%2F%2Fevil.example"] {
        let form = browse(&server, Method::GET, &format!("/login?back={back}"), "", "").await;
        if form.status == 400 {
            // It is no text.
            continue;
        }
        assert_eq!(form.status, 200, "{back}: {form:?}");
        assert!(form.text().contains("name=\"back\" value=\"/\""), "{back}: {}", form.text());
        let body = format!("token=wrong&back={back}");
        assert_eq!(browse(&server, Method::POST, "/login", "", &body).await.status, 401);
    }
}

#[tokio::test]
async fn a_login_ends_with_its_token() {
    let Guarded { server, credentials } = Guarded::start().await;
    let token = credentials["read"].strip_prefix("Bearer ").unwrap();
    let welcome = browse(&server, Method::POST, "/login", "", &format!("token={token}")).await;
    let cookie = welcome.header("set-cookie").split(';').next().unwrap().to_owned();
    assert_eq!(browse(&server, Method::GET, "/", &cookie, "").await.status, 200);
    let headers = [("authorization", credentials["admin"].as_str())];
    let list = server.request(Method::GET, "/v1/tokens", &headers).await.json();
    let id = &list["tokens"][2]["id"];
    server.request(Method::DELETE, &format!("/v1/tokens/{id}"), &headers).await;
    assert_eq!(browse(&server, Method::GET, "/", &cookie, "").await.status, 303);
}

/// A browser got raw JSON when its token was too small.
#[tokio::test]
async fn a_browser_whose_token_may_only_read_gets_pages_without_buttons() {
    let Guarded { server, credentials } = Guarded::start().await;
    let submit = [("authorization", credentials["submit"].as_str())];
    server.submit_to("/v1/jobs", &small_simulation(1), &submit).await;
    let mut cookies = BTreeMap::new();
    for scope in SCOPES {
        let body = format!("token={}", credentials[scope].strip_prefix("Bearer ").unwrap());
        let welcome = browse(&server, Method::POST, "/login", "", &body).await;
        let cookie = welcome.header("set-cookie").split(';').next().unwrap().to_owned();
        cookies.insert(scope, cookie);
    }
    for (path, back) in [
        ("/jobs", "./launch"),
        ("/jobs/1", "../jobs/1"),
        ("/jobs/1/cancel", "../../jobs/1"),
        ("/datasets", "./upload"),
        ("/queue/pause", "../workers"),
    ] {
        let refused = browse(&server, Method::POST, path, &cookies["read"], "").await;
        assert_eq!(refused.status, 403, "{path}");
        assert_eq!(refused.header("content-type"), "text/html; charset=utf-8", "{path}");
        for part in ["This token may only read", "needs", "Log out", &format!("href=\"{back}\"")] {
            assert!(refused.text().contains(part), "{path}: {part}: {}", refused.text());
        }
    }
    // Programs still get problems.
    browse(&server, Method::POST, "/v1/jobs", &cookies["read"], "{}").await.problem(403);
    let paused = browse(&server, Method::POST, "/queue/pause", &cookies["submit"], "").await;
    assert!(paused.text().contains("scope is too small"), "{}", paused.text());

    for (path, button, needed) in [
        ("/jobs/1", "/cancel\"", "submit"),
        ("/jobs/1", "Duplicate and edit", "submit"),
        ("/datasets/1", "Duplicate and edit", "submit"),
        ("/jobs/1", "Change name, tags and note", "submit"),
        ("/workers", "Pause the queue", "admin"),
        ("/", "data-key=\"l\"", "submit"),
        ("/launch?job=1", "<button type=\"submit\">Launch<", "submit"),
    ] {
        for scope in SCOPES {
            let page = browse(&server, Method::GET, path, &cookies[scope], "").await;
            assert_eq!(page.status, 200, "{path}");
            let is_there = page.text().contains(button);
            assert_eq!(is_there, reaches(scope, needed), "{path} {scope} {button}");
        }
    }
}
