//! Links relative to the page, so that the page works below any path of a proxy.
//!
//! Templates and handlers write links from this server's root: `/jobs/3`. A proxy may show that root
//! below a path that the server does not know. So a page is sent with links from itself: on
//! `/runs/7`, `/jobs/3` becomes `../jobs/3`.

use axum::extract::Request;
use axum::http::HeaderValue;
use axum::http::header::LOCATION;
use axum::middleware::Next;
use axum::response::Response;

/// The attributes of a page that have links.
const ATTRIBUTES: [&str; 4] = [" href=\"", " src=\"", " action=\"", " data-events=\""];

tokio::task_local! {
    /// The server's root as a link from the present page.
    static ROOT: String;
}

/// Makes the links of pages and redirects relative.
pub async fn make_links_relative(request: Request, next: Next) -> Response {
    let root = root(request.uri().path());
    let mut response = ROOT.scope(root.clone(), next.run(request)).await;
    if response.status().is_redirection()
        && let Some(location) = response.headers_mut().get_mut(LOCATION)
        && let Some(path) = location.to_str().ok().and_then(|to| to.strip_prefix('/'))
        && let Ok(relative) = HeaderValue::try_from(format!("{root}{path}"))
    {
        *location = relative;
    }
    response
}

/// The page with links from itself.
pub fn with_relative_links(page: String) -> String {
    let replaced = ROOT.try_with(|root| {
        ATTRIBUTES.iter().fold(page.clone(), |page, attribute| {
            page.replace(&format!("{attribute}/"), &format!("{attribute}{root}"))
        })
    });
    // Without a request there is no place to link from.
    replaced.unwrap_or(page)
}

/// The link from a page to the server's root.
fn root(path: &str) -> String {
    match path.matches('/').count() {
        0 | 1 => "./".to_owned(),
        slashes => "../".repeat(slashes - 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_is_as_far_above_a_page_as_the_page_has_folders() {
        for (path, expected) in
            [("/", "./"), ("/runs", "./"), ("/runs/7", "../"), ("/runs/7/delete", "../../")]
        {
            assert_eq!(root(path), expected, "{path}");
        }
    }

    #[tokio::test]
    async fn links_become_relative_and_values_stay() {
        let page = r##"<a href="/jobs/3"></a><a href="/"></a><img src="/v1/x.svg"><form action="/login">
                      <input value="/jobs/1"><p data-events="/v1/events"><a href="?page=2"></a>
                      <a href="https://x/y"></a><a href="#part"></a>"##;
        let expected = r##"<a href="../jobs/3"></a><a href="../"></a><img src="../v1/x.svg"><form action="../login">
                      <input value="/jobs/1"><p data-events="../v1/events"><a href="?page=2"></a>
                      <a href="https://x/y"></a><a href="#part"></a>"##;
        let sent = ROOT.scope("../".to_owned(), async { with_relative_links(page.to_owned()) });
        assert_eq!(sent.await, expected);
        assert_eq!(with_relative_links(page.to_owned()), page);
    }
}
