//! The specs of all kinds of jobs.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::kind::KindSpec;
use crate::preset::{self, presets_of, text_for_object};
use crate::schema::Components;
use crate::shorten::shorten;
use crate::{
    Baseline, ControlSpec, DataSpec, Digest, Doubt, EvaluateSpec, Execution, IdentifySpec,
    ImportSpec, JobKind, PipelineSpec, PresetPlace, Product, Reference, SimulateSpec, SpecError,
    TrainSpec, VerifySpec, for_each_kind, stream,
};

macro_rules! job_specs {
    ($($name:ident => $Kind:ident($Spec:ident),)*) => {
        /// A job that a user can submit.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
        #[serde(tag = "kind", rename_all = "snake_case")]
        #[expect(missing_docs, reason = "the type of each variant says what the job does")]
        pub enum JobSpec {
            $($Kind($Spec),)*
            Pipeline(PipelineSpec),
        }

        impl JobKind {
            /// The product of jobs of this kind, which other jobs may refer to.
            pub fn makes(self) -> Option<Product> {
                match self {
                    $(Self::$Kind => $Spec::makes(),)*
                    Self::Pipeline => PipelineSpec::makes(),
                }
            }
        }

        impl JobSpec {
            /// The kind of the job.
            pub const fn kind(&self) -> JobKind {
                match self {
                    $(Self::$Kind(_) => JobKind::$Kind,)*
                    Self::Pipeline(_) => JobKind::Pipeline,
                }
            }

            /// Deserializes a job of this kind, without checking its values.
            pub(crate) fn read(
                kind: JobKind,
                fields: Map<String, Value>,
                found: SpecError,
                schemas: &Components,
            ) -> Result<Self, SpecError> {
                match kind {
                    $(JobKind::$Kind => $Spec::read(fields, found, schemas).map(Self::$Kind),)*
                    JobKind::Pipeline => PipelineSpec::read(fields, found, schemas).map(Self::Pipeline),
                }
            }

            pub(crate) fn fields(&self) -> &dyn KindSpec {
                match self {
                    $(Self::$Kind(spec) => spec,)*
                    Self::Pipeline(spec) => spec,
                }
            }

            fn fields_mut(&mut self) -> &mut dyn KindSpec {
                match self {
                    $(Self::$Kind(spec) => spec,)*
                    Self::Pipeline(spec) => spec,
                }
            }
        }
    };
}

for_each_kind!(job_specs);

impl JobKind {
    /// The kinds whose jobs make `product`.
    pub fn making(product: Product) -> Vec<Self> {
        Self::ALL.iter().copied().filter(|kind| kind.makes() == Some(product)).collect()
    }
}

impl Check for JobSpec {
    fn check(&self, violations: &mut Violations) {
        self.fields().check(violations);
    }
}

impl JobSpec {
    /// Deserializes one job by its `kind`, without checking its values.
    pub(crate) fn from_json(value: Value, schemas: &Components) -> Result<Self, SpecError> {
        let fields = match value {
            Value::Object(fields) => fields,
            Value::String(name) => {
                return Err(text_for_object("", &name, &presets_of(PresetPlace::Job)).into());
            }
            other => return Err(SpecError::one("", shorten(&other), "a JSON object")),
        };
        let mut fields = preset::resolve_job(fields)?;
        let kind: JobKind = match fields.remove("kind") {
            Some(Value::String(kind)) => kind.parse()?,
            Some(other) => return Err(SpecError::one("kind", shorten(&other), JobKind::names())),
            None => return Err(SpecError::one("kind", "missing", JobKind::names())),
        };
        let mut found = SpecError::default();
        let fields = stream::resolve(fields, &mut found, schemas);
        Self::read(kind, fields, found, schemas)
    }

    /// How the job is executed. A pipeline's members have their own execution.
    pub fn execution(&self) -> Execution {
        self.fields().execution()
    }

    /// All references of this job to other work. A pipeline has none; its members have.
    pub fn references(&mut self) -> Vec<Reference<'_>> {
        self.fields_mut().references()
    }

    /// Sets defaults that depend on the robot, according to the `data` that the references were
    /// resolved to.
    pub fn fit_to_data(&mut self, data: &DataSpec) {
        self.fields_mut().fit_to_data(data);
    }

    /// Warnings about values that are allowed but probably not intended, including those of streams
    /// and of a pipeline's members.
    pub fn doubts(&self) -> Vec<Doubt> {
        self.fields().doubts()
    }

    /// This job, or the jobs of a pipeline, each with the path to its fields.
    pub fn single_jobs(&self) -> Vec<(String, &Self)> {
        match self {
            Self::Pipeline(pipeline) => {
                let members = pipeline.jobs.iter();
                members.map(|(name, member)| (format!("jobs.{name}"), &member.spec)).collect()
            }
            single => vec![(String::new(), single)],
        }
    }

    /// The spec as JSON with every default filled in.
    pub fn to_json(&self) -> Value {
        // The types have only finite numbers and string keys, so this cannot fail.
        serde_json::to_value(self).expect("a spec serializes to JSON")
    }

    /// The digest that identifies the results of this spec; see the crate's documentation.
    ///
    /// It covers everything upstream once the references are digests. It does not cover
    /// `execution`, nor `constant-velocity` in an evaluation of all baselines.
    pub fn digest(&self) -> Digest {
        let mut json = self.to_json();
        keep_digested(&mut json);
        Digest::of_json(&json)
    }

    /// References to other jobs of the same pipeline.
    pub(crate) fn named_jobs(&self) -> Vec<NamedJob> {
        let mut spec = self.clone();
        let named = |reference: Reference<'_>| {
            let (product, name) = (reference.to.product()?, reference.to.job()?.to_owned());
            Some(NamedJob { field: reference.field, product, name })
        };
        spec.references().into_iter().filter_map(named).collect()
    }
}

impl DataSpec {
    /// The data that `job` makes; `None` if it makes none.
    pub fn of(job: &JobSpec) -> Option<Self> {
        job.fields().data()
    }

    /// The job that makes this data, without its execution. Files contain it as metadata.
    pub fn job(&self) -> JobSpec {
        let execution = Execution::default();
        match self {
            Self::Simulation(spec) => JobSpec::Simulate(SimulateSpec { execution, ..spec.clone() }),
            Self::Import(spec) => JobSpec::Import(ImportSpec { execution, ..spec.clone() }),
        }
    }
}

/// A reference to another job of the same pipeline, and its place in the spec.
pub(crate) struct NamedJob {
    pub field: String,
    /// The product that the reference needs.
    pub product: Product,
    pub name: String,
}

/// Removes the parts of a job, and of a pipeline's jobs, that its digest does not cover.
fn keep_digested(json: &mut Value) {
    let Value::Object(fields) = json else { return };
    fields.remove("execution");
    Baseline::leave_out_of_digest(fields);
    if let Some(Value::Object(members)) = fields.get_mut("jobs") {
        members.values_mut().for_each(keep_digested);
    }
}
