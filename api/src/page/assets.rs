//! The style sheets, the scripts and the icon, which are part of the binary.

use axum::extract::Path;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, ETAG, IF_NONE_MATCH};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use spec::Digest;

use crate::error::ApiError;

struct Asset {
    name: &'static str,
    media_type: &'static str,
    bytes: &'static [u8],
}

const ASSETS: [Asset; 9] = [
    Asset {
        name: "page.css",
        media_type: "text/css; charset=utf-8",
        bytes: include_bytes!("../../../web/static/page.css"),
    },
    Asset {
        name: "live.js",
        media_type: "text/javascript; charset=utf-8",
        bytes: include_bytes!("../../../web/static/live.js"),
    },
    Asset {
        name: "charts.js",
        media_type: "text/javascript; charset=utf-8",
        bytes: include_bytes!("../../../web/static/charts.js"),
    },
    Asset {
        name: "times.js",
        media_type: "text/javascript; charset=utf-8",
        bytes: include_bytes!("../../../web/static/times.js"),
    },
    Asset {
        name: "replace.js",
        media_type: "text/javascript; charset=utf-8",
        bytes: include_bytes!("../../../web/static/replace.js"),
    },
    Asset {
        name: "forms.js",
        media_type: "text/javascript; charset=utf-8",
        bytes: include_bytes!("../../../web/static/forms.js"),
    },
    Asset {
        name: "docs.css",
        media_type: "text/css; charset=utf-8",
        bytes: include_bytes!("../../../web/static/docs.css"),
    },
    Asset {
        name: "docs.js",
        media_type: "text/javascript; charset=utf-8",
        bytes: include_bytes!("../../../web/static/docs.js"),
    },
    Asset {
        name: "icon.svg",
        media_type: "image/svg+xml",
        bytes: include_bytes!("../../../web/static/icon.svg"),
    },
];

pub async fn show(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, ApiError> {
    let asset = ASSETS
        .iter()
        .find(|asset| asset.name == name)
        .ok_or_else(|| ApiError::NoRoute { path: format!("/static/{name}") })?;
    Ok(answer(asset.media_type, asset.bytes, &headers))
}

/// A file of the binary, unless the browser has it already.
pub(super) fn answer(
    media_type: &'static str,
    bytes: &'static [u8],
    headers: &HeaderMap,
) -> Response {
    let tag = format!("\"{}\"", Digest::of(bytes));
    // The next version of the binary may have another file under the same name.
    let validators = [(ETAG, tag.clone()), (CACHE_CONTROL, "no-cache".to_owned())];
    if headers.get(IF_NONE_MATCH).is_some_and(|known| known.as_bytes() == tag.as_bytes()) {
        return (StatusCode::NOT_MODIFIED, validators).into_response();
    }
    (validators, [(CONTENT_TYPE, media_type)], bytes).into_response()
}
