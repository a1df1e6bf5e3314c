//! File downloads: with their digest, whole or in part, and only if the client does not have them
//! yet.

use axum::body::Body;
use axum::http::header::{
    ACCEPT_RANGES, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE,
    ETAG, HeaderName, IF_MATCH, IF_NONE_MATCH, IF_RANGE, LOCATION, RANGE,
};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use axum::response::Response;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use spec::Digest;

use crate::error::ApiError;
use crate::range::{self, Requested};

/// RFC 9530. It is not among the constants of `http` yet.
const REPR_DIGEST: HeaderName = HeaderName::from_static("repr-digest");

/// The facts about a file that are known before it is read.
#[derive(Clone, Debug)]
pub struct FileInfo {
    /// The name under which the client should save it.
    pub name: String,
    pub media_type: String,
    pub size: u64,
    pub identity: Identity,
}

/// The identity of a file's bytes, for its `ETag`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Identity {
    /// The SHA-256 digest of its bytes, which the answer also has in a header.
    Bytes(Digest),
    /// A digest of everything that it is made from. The same digest means the same bytes.
    Parts(Digest),
}

impl Identity {
    fn tag(self) -> String {
        let (Self::Bytes(digest) | Self::Parts(digest)) = self;
        format!("\"{digest}\"")
    }
}

/// The answer to a request for a file: its headers, and the bytes to send, if any.
#[derive(Debug)]
pub struct FileResponse {
    status: StatusCode,
    headers: HeaderMap,
    /// The bytes to send; `None` if the answer has no body.
    pub part: Option<std::ops::Range<u64>>,
}

impl FileResponse {
    /// Decides according to RFC 9110, sections 13.2.2 and 14.2. Files have no date of modification,
    /// so conditions on it are ignored, as section 13.1 demands.
    ///
    /// # Errors
    /// [`ApiError::OtherFile`] when `If-Match` names other bytes.
    pub fn new(method: &Method, request: &HeaderMap, file: &FileInfo) -> Result<Self, ApiError> {
        let tag = file.identity.tag();
        if request.contains_key(IF_MATCH) && !lists_tag(request, IF_MATCH, Weak::Differs, &tag) {
            return Err(ApiError::OtherFile { tag });
        }
        let mut headers = HeaderMap::new();
        headers.insert(ETAG, ascii(&tag));
        headers.insert(ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        if let Identity::Bytes(sha256) = file.identity {
            let digest = BASE64.encode(sha256.as_bytes());
            headers.insert(REPR_DIGEST, ascii(&format!("sha-256=:{digest}:")));
        }
        // The bytes behind an id never change, but another data folder may take the place of this
        // one.
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        if lists_tag(request, IF_NONE_MATCH, Weak::Counts, &tag) {
            return Ok(Self { status: StatusCode::NOT_MODIFIED, headers, part: None });
        }
        headers.insert(CONTENT_TYPE, ascii(&file.media_type));
        headers.insert(CONTENT_DISPOSITION, disposition(&file.name));

        let (status, part) = match requested(method, request, &tag, file.size) {
            Requested::Whole => (StatusCode::OK, 0..file.size),
            Requested::Part { first, last } => {
                let range = format!("bytes {first}-{last}/{}", file.size);
                headers.insert(CONTENT_RANGE, ascii(&range));
                (StatusCode::PARTIAL_CONTENT, first..last + 1)
            }
            Requested::Unsatisfiable => {
                headers.insert(CONTENT_RANGE, ascii(&format!("bytes */{}", file.size)));
                headers.insert(CONTENT_LENGTH, HeaderValue::from(0));
                let status = StatusCode::RANGE_NOT_SATISFIABLE;
                return Ok(Self { status, headers, part: None });
            }
        };
        headers.insert(CONTENT_LENGTH, HeaderValue::from(part.end - part.start));
        let part = (method != Method::HEAD).then_some(part);
        Ok(Self { status, headers, part })
    }

    /// Whether the client has the file already.
    pub fn is_known(&self) -> bool {
        self.status == StatusCode::NOT_MODIFIED
    }

    /// Redirects to the file at another address, which is valid for a while.
    pub fn redirected(mut self, address: &str) -> Response {
        let about_the_bytes =
            [ACCEPT_RANGES, CONTENT_TYPE, CONTENT_DISPOSITION, CONTENT_RANGE, CONTENT_LENGTH];
        about_the_bytes.iter().for_each(|name| drop(self.headers.remove(name)));
        self.headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
        self.headers.insert(LOCATION, ascii(address));
        self.status = StatusCode::TEMPORARY_REDIRECT;
        self.with_body(Body::empty())
    }

    pub fn with_body(self, body: Body) -> Response {
        let mut response = Response::new(body);
        *response.status_mut() = self.status;
        *response.headers_mut() = self.headers;
        response
    }
}

/// The part that `Range` asks for, unless `If-Range` shows that the client has another file.
fn requested(method: &Method, request: &HeaderMap, tag: &str, size: u64) -> Requested {
    let Some(range) = text(request, RANGE).filter(|_| method == Method::GET) else {
        return Requested::Whole;
    };
    // Dates never match, because a file is identified by its digest here.
    if request.contains_key(IF_RANGE) && text(request, IF_RANGE) != Some(tag) {
        return Requested::Whole;
    }
    range::requested(range, size)
}

fn text(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Whether a weak tag can name a file.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Weak {
    Counts,
    Differs,
}

/// Whether a header, which may have several lines, names `tag`.
fn lists_tag(request: &HeaderMap, name: HeaderName, weak: Weak, tag: &str) -> bool {
    let lines = request.get_all(name).into_iter().filter_map(|line| line.to_str().ok());
    lines.flat_map(|line| line.split(',')).map(str::trim).any(|known| {
        let strong = known.strip_prefix("W/").filter(|_| weak == Weak::Counts);
        known == "*" || strong.unwrap_or(known) == tag
    })
}

/// Tells the client to save the file as `name`. Characters that a header or a file system could not
/// handle are replaced.
fn disposition(name: &str) -> HeaderValue {
    let safe: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '-' })
        .collect();
    ascii(&format!("attachment; filename=\"{safe}\""))
}

/// A header value made here. The callers pass only ASCII.
fn ascii(value: &str) -> HeaderValue {
    HeaderValue::from_str(value)
        .unwrap_or_else(|_| HeaderValue::from_static("application/octet-stream"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> FileInfo {
        FileInfo {
            name: "d1 \"x\"\r\n.parquet".to_owned(),
            media_type: "application/vnd.apache.parquet".to_owned(),
            size: 1000,
            identity: Identity::Bytes(Digest::of(b"bytes")),
        }
    }

    fn answer(method: &Method, request: &[(HeaderName, &str)]) -> FileResponse {
        let request = request
            .iter()
            .map(|(name, value)| (name.clone(), HeaderValue::from_str(value).unwrap()))
            .collect();
        FileResponse::new(method, &request, &file()).unwrap()
    }

    fn header(answer: &FileResponse, name: HeaderName) -> &str {
        answer.headers[name].to_str().unwrap()
    }

    fn tag() -> String {
        file().identity.tag()
    }

    #[test]
    fn a_whole_file_says_its_size_and_digest_and_a_harmless_name() {
        let answer = answer(&Method::GET, &[]);
        assert_eq!((answer.status, answer.part.clone()), (StatusCode::OK, Some(0..1000)));
        assert_eq!(header(&answer, CONTENT_LENGTH), "1000");
        assert_eq!(header(&answer, ETAG), tag());
        let digest = BASE64.encode(Digest::of(b"bytes").as_bytes());
        assert_eq!(header(&answer, REPR_DIGEST), format!("sha-256=:{digest}:"));
        assert_eq!(
            header(&answer, CONTENT_DISPOSITION),
            "attachment; filename=\"d1--x---.parquet\""
        );
    }

    #[test]
    fn head_has_the_headers_of_get_and_no_bytes() {
        let head = answer(&Method::HEAD, &[(RANGE, "bytes=0-9")]);
        assert_eq!((head.status, head.part.clone()), (StatusCode::OK, None));
        assert_eq!(head.headers, answer(&Method::GET, &[]).headers);
    }

    #[test]
    fn a_part_is_sent_with_its_place() {
        let answer = answer(&Method::GET, &[(RANGE, "bytes=990-2000")]);
        assert_eq!(answer.status, StatusCode::PARTIAL_CONTENT);
        assert_eq!(answer.part, Some(990..1000));
        assert_eq!(header(&answer, CONTENT_RANGE), "bytes 990-999/1000");
        assert_eq!(header(&answer, CONTENT_LENGTH), "10");
    }

    #[test]
    fn a_part_beyond_the_end_is_refused_with_the_size() {
        let answer = answer(&Method::GET, &[(RANGE, "bytes=1000-")]);
        assert_eq!((answer.status, answer.part.clone()), (StatusCode::RANGE_NOT_SATISFIABLE, None));
        assert_eq!(header(&answer, CONTENT_RANGE), "bytes */1000");
    }

    #[test]
    fn a_part_of_another_file_is_not_asked_for() {
        let range = (RANGE, "bytes=0-9");
        let same = answer(&Method::GET, &[range.clone(), (IF_RANGE, &tag())]);
        assert_eq!(same.part, Some(0..10));
        for other in ["\"other\"", "W/\"weak\"", "Wed, 21 Oct 2015 07:28:00 GMT"] {
            let answer = answer(&Method::GET, &[range.clone(), (IF_RANGE, other)]);
            assert_eq!((answer.status, answer.part), (StatusCode::OK, Some(0..1000)));
        }
    }

    #[test]
    fn a_file_with_another_tag_than_the_demanded_one_is_refused() {
        let refused = |known: &str| {
            let range = (RANGE, HeaderValue::from_static("bytes=0-9"));
            let request = [(IF_MATCH, HeaderValue::from_str(known).unwrap()), range];
            FileResponse::new(&Method::GET, &request.into_iter().collect(), &file()).is_err()
        };
        for other in ["\"other\"", "", &format!("W/{}", tag()), "\"a\", \"b\""] {
            assert!(refused(other), "{other}");
        }
        for same in [tag(), format!("\"a\", {}", tag()), "*".to_owned()] {
            assert!(!refused(&same), "{same}");
        }
    }

    #[test]
    fn a_file_that_the_caller_has_is_not_sent_again() {
        for known in [tag(), format!("\"x\", W/{}", tag()), "*".to_owned()] {
            let answer = answer(&Method::GET, &[(IF_NONE_MATCH, &known)]);
            assert_eq!((answer.status, answer.part), (StatusCode::NOT_MODIFIED, None));
        }
        let answer = answer(&Method::GET, &[(IF_NONE_MATCH, "\"x\"")]);
        assert_eq!(answer.status, StatusCode::OK);
    }
}
