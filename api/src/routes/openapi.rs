//! The OpenAPI document: what the handlers do not say of themselves.

use std::collections::BTreeMap;

use utoipa::openapi::{self, ContentBuilder, Ref, RefOr, ResponseBuilder, ResponsesBuilder};
use utoipa::{IntoResponses, PartialSchema as _};
use wire::Problem;

#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "torqued",
        description = "In-context identification of robot dynamics as a service: simulate, train, \
                       evaluate.\n\nErrors are RFC 9457 problem details. Lists are newest first; \
                       `next` is the `before` of the following page. Tasks are in the order in \
                       which they run; `next` is the `after` of the following page; of logs it is there on every page. Downloads \
                       answer HEAD, Range, If-Range and If-None-Match and carry the SHA-256 of the \
                       whole file as ETag and Repr-Digest. They are compared with it: a file that is \
                       damaged on disk breaks off before its last bytes, and is answered with a \
                       problem of type `damaged` from then on.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    security((), ("token" = ["read"])),
    // The schemas of a pipeline's member and of a job refer to each other, which the derive does not
    // follow. The report of a control job is an artifact, and a stream speaks WebSocket.
    components(schemas(
        Problem, spec::PipelineMember, wire::ControlReport, wire::StreamMessage, wire::StreamReply,
    )),
    modifiers(&TokenScheme),
)]
pub struct Document;

/// The token, declared once for all operations.
struct TokenScheme;

impl utoipa::Modify for TokenScheme {
    fn modify(&self, document: &mut openapi::OpenApi) {
        use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
        let scheme = HttpBuilder::new()
            .scheme(HttpAuthScheme::Bearer)
            .description(Some(
                "Once the server was started with a token or has made one. An operation lists the scope that it needs: \
                 `read`, `submit` or `admin`, each of which holds those before it.",
            ))
            .build();
        document
            .components
            .get_or_insert_default()
            .add_security_scheme("token", SecurityScheme::Http(scheme));
    }
}

/// What a download answers with.
pub struct FileResponses;

impl IntoResponses for FileResponses {
    fn responses() -> BTreeMap<String, RefOr<openapi::Response>> {
        let bytes = || ContentBuilder::new().schema(Some(Vec::<u8>::schema())).build();
        let of = |description: &str| ResponseBuilder::new().description(description);
        ResponsesBuilder::new()
            .response("200", of("The file").content("application/octet-stream", bytes()))
            .response("206", of("The part asked for").content("application/octet-stream", bytes()))
            .response("304", of("The caller has the file"))
            .response("416", of("The part asked for lies beyond the end"))
            .build()
            .into()
    }
}

/// Every operation may answer with a problem instead.
pub fn add_problems(document: &mut openapi::OpenApi) {
    let content = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
    let problem = ResponseBuilder::new()
        .description("An error: the fault, its place, and what is allowed")
        .content("application/problem+json", content)
        .build();
    for item in document.paths.paths.values_mut() {
        for operation in [&mut item.get, &mut item.post, &mut item.delete].into_iter().flatten() {
            operation.responses.responses.insert("default".to_owned(), problem.clone().into());
        }
    }
}
