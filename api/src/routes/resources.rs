//! The operations that resources share: list, show, label, delete, restore and download. One list says
//! which resource has which, and has the texts that differ.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use axum::routing::{MethodRouter, delete, get, patch, post};
use utoipa::openapi::path::{HttpMethod, OperationBuilder, ParameterBuilder, ParameterIn, Paths};
use utoipa::openapi::request_body::RequestBodyBuilder;
use utoipa::openapi::security::SecurityRequirement;
use utoipa::openapi::{
    ContentBuilder, Ref, RefOr, Required, ResponseBuilder, ResponsesBuilder, Schema,
};
use utoipa::{IntoParams, IntoResponses, PartialSchema as _, ToSchema};
use utoipa_axum::router::{OpenApiRouter, UtoipaMethodRouter};
use wire::{
    Checkpoint, Dataset, Deleted, Dependents, Evaluation, ItemKind, Job, LabelChange, Restored,
    Robot, Run,
};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::app::resources::{Downloaded, Resource};
use crate::error::ApiError;
use crate::extract::{PatchBytes, Path, Query, QueryPairs};
use crate::routes::files::{
    CheckpointFile, DatasetFile, FileParameters, TarFile, send, send_or_redirect,
};
use crate::routes::lists::Parameters;
use crate::routes::trash::DeleteParameters;

/// Adds the operations of all resources.
pub fn add(router: OpenApiRouter<App>) -> OpenApiRouter<App> {
    Resources(router)
        .listed::<Job>("jobs and pipelines", "Get a job with its progress and its results.")
        .kept::<Job>(
            ItemKind::Job,
            "Move an ended job into the trash, with its logs and all its results; a pipeline with the jobs that were made for it.",
        )
        .listed::<Dataset>("datasets", "Get a dataset with the files that exist so far.")
        .kept::<Dataset>(ItemKind::Dataset, "Move a dataset into the trash.")
        .downloaded::<Dataset, DatasetFile>(
            ItemKind::Dataset,
            "Download a file of a dataset: a Parquet file with the samples or the robots of a shard, or\n\
             `dataset.json`, which describes them.",
        )
        .listed::<Run>("runs", "Get a run with the latest value of every metric and its artifacts.")
        .kept::<Run>(
            ItemKind::Run,
            "Move a run into the trash, with its metrics, files and checkpoints.",
        )
        .listed::<Checkpoint>("checkpoints", "Get a checkpoint with its files.")
        .kept::<Checkpoint>(ItemKind::Checkpoint, "Move a checkpoint into the trash.")
        .downloaded::<Checkpoint, CheckpointFile>(
            ItemKind::Checkpoint,
            "Download a file of a checkpoint: weights and optimizer as safetensors, configuration as JSON.",
        )
        .listed::<Robot>("robots", "Get a robot with its description, its links and its doubts.")
        .listed::<Evaluation>(
            "evaluations",
            "Get an evaluation by the id of its job. It has a `report` when all its cells are evaluated.",
        )
        .0
}

struct Resources(OpenApiRouter<App>);

impl Resources {
    /// Adds a list of `plural`, and one of them by its id.
    fn listed<T: Resource<Page: ToSchema> + ToSchema>(self, plural: &str, show: &str) -> Self {
        let name = T::LIST.name;
        let summary = format!("List {plural}, newest first unless `sort` says otherwise.");
        let list = Operation::new(name, summary).parameters::<Parameters<T>>();
        let list = list.answers::<T::Page>().at(HttpMethod::Get, "", get(self::list::<T>));
        let show = Operation::new(name, show).id().answers::<T>();
        Self(self.0.routes(list).routes(show.at(HttpMethod::Get, "/{id}", get(self::show::<T>))))
    }

    /// Adds what can be done with things that somebody keeps: they are labelled, deleted and
    /// restored.
    fn kept<T: Resource + ToSchema>(self, kind: ItemKind, delete: &str) -> Self {
        let operation = |summary: &str| Operation::new(T::LIST.name, summary).id();
        let label = operation(&format!("Change a {kind}'s name, note or tags."));
        let label = label
            .submits()
            .takes::<LabelChange>(&["application/merge-patch+json", "application/json"]);
        let delete = operation(delete).submits().parameters::<DeleteParameters>();
        let restore = operation(
            "Restore it from the trash, with everything that was deleted together with it.",
        );
        let dependents = operation(
            "List the things that would be deleted together with it, and the jobs that depend on\nit.",
        );
        let router = self.0;
        let router = router.routes(label.answers::<T>().at(
            HttpMethod::Patch,
            "/{id}",
            patch(async move |state, id, body| label_and_show::<T>(kind, state, id, body).await),
        ));
        let router = router.routes(delete.answers::<Deleted>().at(
            HttpMethod::Delete,
            "/{id}",
            self::delete(async move |state, id, parameters| {
                remove(kind, state, id, parameters).await
            }),
        ));
        let router = router.routes(restore.submits().answers::<Restored>().at(
            HttpMethod::Post,
            "/{id}/restore",
            post(async move |State(app): State<App>, Path(id): Path<i64>| {
                app.restore(kind, id).await.map(Json)
            }),
        ));
        Self(router.routes(dependents.answers::<Dependents>().at(
            HttpMethod::Get,
            "/{id}/dependents",
            get(async move |State(app): State<App>, Path(id): Path<i64>| {
                app.dependents(kind, id).await.map(Json)
            }),
        )))
    }

    /// Adds downloads of a file, which are answered as `F` says, and of all files.
    fn downloaded<T: Downloaded, F: IntoResponses>(self, kind: ItemKind, file: &str) -> Self {
        let name = T::LIST.name;
        let file = Operation::new(name, file).id().name().parameters::<FileParameters>();
        let all = Operation::new(name, format!("Download all files of a {kind} as one tar."));
        let all = all.id().describes(
            "The tar is streamed. Its size is known at once, and ranges of it can be requested.",
        );
        let file = file.responds::<F>();
        let router =
            self.0.routes(file.at(HttpMethod::Get, "/{id}/files/{name}", get(self::file::<T>)));
        Self(router.routes(all.responds::<TarFile>().at(
            HttpMethod::Get,
            "/{id}/tar",
            get(tar::<T>),
        )))
    }
}

async fn list<T: Resource>(
    State(app): State<App>,
    pairs: QueryPairs,
) -> Result<Json<T::Page>, ApiError> {
    Ok(Json(app.list::<T>(&ListRequest::read(const { &T::LIST }, &pairs.0)?).await?))
}

async fn show<T: Resource>(
    State(app): State<App>,
    Path(id): Path<i64>,
) -> Result<Json<T>, ApiError> {
    Ok(Json(T::find(&app, id).await?))
}

async fn label_and_show<T: Resource>(
    kind: ItemKind,
    State(app): State<App>,
    Path(id): Path<i64>,
    PatchBytes(body): PatchBytes,
) -> Result<Json<T>, ApiError> {
    let change = app.read_body(body, ApiError::Labels).await?;
    app.label(kind, id, &change).await?;
    Ok(Json(T::find(&app, id).await?))
}

async fn remove(
    kind: ItemKind,
    State(app): State<App>,
    Path(id): Path<i64>,
    Query(parameters): Query<DeleteParameters>,
) -> Result<Json<Deleted>, ApiError> {
    Ok(Json(app.delete(kind, id, parameters.respect()).await?))
}

async fn file<T: Downloaded>(
    State(app): State<App>,
    Path((id, name)): Path<(i64, String)>,
    Query(parameters): Query<FileParameters>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let file = T::file(&app, id, &name).await?;
    send_or_redirect(&app, &method, &headers, file, &parameters).await
}

async fn tar<T: Downloaded>(
    State(app): State<App>,
    Path(id): Path<i64>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    send(&app, &method, &headers, T::tar(&app, id).await?).await
}

/// The description of an operation in the OpenAPI document.
struct Operation {
    /// The resource's name in paths, which is also the operation's tag.
    resource: &'static str,
    operation: OperationBuilder,
    schemas: Vec<(String, RefOr<Schema>)>,
}

impl Operation {
    fn new(resource: &'static str, summary: impl Into<String>) -> Self {
        let operation = OperationBuilder::new().tag(resource).summary(Some(summary));
        Self { resource, operation, schemas: Vec::new() }
    }

    fn map(self, change: impl FnOnce(OperationBuilder) -> OperationBuilder) -> Self {
        Self { operation: change(self.operation), ..self }
    }

    fn describes(self, description: &str) -> Self {
        self.map(|operation| operation.description(Some(description)))
    }

    /// It needs a token of scope `submit`.
    fn submits(self) -> Self {
        let token = SecurityRequirement::new("token", ["submit"]);
        self.map(|operation| operation.security(SecurityRequirement::default()).security(token))
    }

    fn id(self) -> Self {
        self.in_path("id", i64::schema())
    }

    fn name(self) -> Self {
        self.in_path("name", String::schema())
    }

    fn in_path(self, name: &str, schema: RefOr<Schema>) -> Self {
        let parameter = ParameterBuilder::new().name(name).parameter_in(ParameterIn::Path);
        let parameter = parameter.required(Required::True).schema(Some(schema));
        self.map(|operation| operation.parameter(parameter))
    }

    fn parameters<P: IntoParams>(self) -> Self {
        let parameters = P::into_params(|| Some(ParameterIn::Query));
        self.map(|operation| parameters.into_iter().fold(operation, OperationBuilder::parameter))
    }

    fn takes<B: ToSchema>(mut self, media_types: &[&str]) -> Self {
        let schema = self.refer::<B>();
        let body = media_types.iter().fold(RequestBodyBuilder::new(), |body, media_type| {
            body.content(*media_type, ContentBuilder::new().schema(Some(schema.clone())).build())
        });
        let body = body.required(Some(Required::True)).build();
        self.map(|operation| operation.request_body(Some(body)))
    }

    /// Its answer is an `A` as JSON.
    fn answers<A: ToSchema>(mut self) -> Self {
        let content = ContentBuilder::new().schema(Some(self.refer::<A>())).build();
        let answer = ResponseBuilder::new().content("application/json", content);
        self.map(|operation| operation.response("200", answer))
    }

    fn responds<R: IntoResponses>(self) -> Self {
        let responses = ResponsesBuilder::new().responses_from_iter(R::responses());
        self.map(|operation| operation.responses(responses))
    }

    /// A reference to the schema of `A`, which is added to the document.
    fn refer<A: ToSchema>(&mut self) -> Ref {
        self.schemas.push((A::name().into_owned(), A::schema()));
        A::schemas(&mut self.schemas);
        Ref::from_schema_name(A::name())
    }

    /// The operation behind the resource's path.
    fn at(
        self,
        method: HttpMethod,
        rest: &str,
        handler: MethodRouter<App>,
    ) -> UtoipaMethodRouter<App> {
        let mut paths = Paths::new();
        let path = format!("/v1/{}{rest}", self.resource);
        paths.add_path_operation(path, vec![method], self.operation);
        (self.schemas, paths, handler)
    }
}
