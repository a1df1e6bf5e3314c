//! Pipelines: named jobs, of which some need others.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::kind::{KindSpec, from_fields};
use crate::schema::{Components, nearest};
use crate::shorten::shorten;
use crate::{Digest, Doubt, Execution, JobKind, JobSpec, SpecError};

/// The largest number of jobs of a pipeline.
pub const MAX_MEMBERS: usize = 200;

const NUMBER_OF_JOBS: &str = "1 to 200 jobs";

/// Named jobs, some of which need others. Their order follows from references and `needs`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PipelineSpec {
    /// The name of its job, unless users give the job another one.
    pub name: String,
    /// 1 to 200 jobs. Names have lower-case letters, digits and dashes.
    #[schema(no_recursion)]
    pub jobs: BTreeMap<String, PipelineMember>,
}

/// A job of a pipeline: any job spec but a pipeline, with `needs` beside its fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PipelineMember {
    /// Jobs that must succeed first, in addition to those that this job refers to.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub needs: Vec<String>,
    /// The job itself.
    #[serde(flatten)]
    #[schema(no_recursion)]
    pub spec: JobSpec,
}

impl PipelineMember {
    /// All jobs of the pipeline that must succeed before this one.
    pub(crate) fn all_needs(&self) -> BTreeSet<String> {
        let referred = self.spec.named_jobs().into_iter().map(|job| job.name);
        self.needs.iter().cloned().chain(referred).collect()
    }
}

impl KindSpec for PipelineSpec {
    /// Reads the members one by one, so that errors name a member's path and presets work inside.
    fn read(
        mut fields: Map<String, Value>,
        mut found: SpecError,
        schemas: &Components,
    ) -> Result<Self, SpecError> {
        let members = match fields.insert("jobs".to_owned(), Value::Object(Map::new())) {
            Some(Value::Object(members)) => members,
            Some(other) => {
                return Err(SpecError::one("jobs", shorten(&other), "an object of named jobs"));
            }
            None => return Err(SpecError::one("jobs", "missing", "an object of named jobs")),
        };
        if members.len() > MAX_MEMBERS {
            return Err(SpecError::one("jobs", format!("{} jobs", members.len()), NUMBER_OF_JOBS));
        }
        let names: Vec<String> = members.keys().cloned().collect();
        let mut jobs = BTreeMap::new();
        for (name, member) in members {
            let path = format!("jobs.{name}");
            match read_member(&name, member, &names, schemas) {
                Ok(member) => drop(jobs.insert(name, member)),
                Err(error) => found.append(error.within(&path)),
            }
        }
        if found.is_empty() {
            let pipeline = from_fields(fields, found, schemas)?;
            return Ok(Self { jobs, ..pipeline });
        }
        // The violations of readable members are reported together with those of unreadable ones.
        let mut violations = Violations::default();
        jobs.iter().for_each(|(name, job)| violations.part(&format!("jobs.{name}"), &job.spec));
        if let Err(error) = violations.finish() {
            found.append(error);
        }
        if let Err(error) = from_fields::<Self>(fields, SpecError::default(), schemas) {
            found.append(error);
        }
        Err(found)
    }

    fn execution(&self) -> Execution {
        Execution::default()
    }

    fn doubts(&self) -> Vec<Doubt> {
        let of_member = |(name, member): (&String, &PipelineMember)| {
            let path = format!("jobs.{name}");
            member.spec.doubts().into_iter().map(move |doubt| doubt.within(&path))
        };
        self.jobs.iter().flat_map(of_member).collect()
    }
}

/// Reads the member `name`. Fields in its errors are its own; `names` has the names of all members.
fn read_member(
    name: &str,
    member: Value,
    names: &[String],
    schemas: &Components,
) -> Result<PipelineMember, SpecError> {
    let mut member = match member {
        Value::Object(member) => member,
        other => {
            return JobSpec::from_json(other, schemas)
                .map(|spec| PipelineMember { needs: Vec::new(), spec });
        }
    };
    if !member.contains_key("kind") && !member.contains_key("preset") {
        let others = names.iter().map(String::as_str).filter(|other| *other != name);
        if let Some(meant) = nearest(name, others) {
            let allowed = format!("a job with its kind; did you mean `{meant}`?");
            return Err(SpecError::one("", shorten(&Value::Object(member)), allowed));
        }
    }
    let needs = member.remove("needs").unwrap_or_else(|| Value::Array(Vec::new()));
    let read_needs = serde_json::from_value(needs.clone());
    let spec = JobSpec::from_json(Value::Object(member), schemas);
    match (read_needs, spec) {
        (Ok(needs), Ok(spec)) => Ok(PipelineMember { needs, spec }),
        (Ok(_), Err(error)) => Err(error),
        (Err(_), spec) => {
            let mut error = SpecError::one("needs", shorten(&needs), "a list of names of jobs");
            spec.err().into_iter().for_each(|more| error.append(more));
            Err(error)
        }
    }
}

impl PipelineSpec {
    /// Names of the jobs, each after all jobs that it needs; `None` if they need each other in a
    /// circle.
    pub fn order(&self) -> Option<Vec<&str>> {
        let mut waiting: Vec<(&str, BTreeSet<String>)> =
            self.jobs.iter().map(|(name, job)| (name.as_str(), job.all_needs())).collect();
        let mut done: BTreeSet<&str> = BTreeSet::new();
        let mut order = Vec::with_capacity(self.jobs.len());
        while !waiting.is_empty() {
            let (ready, rest): (Vec<_>, Vec<_>) = waiting
                .into_iter()
                .partition(|(_, needs)| needs.iter().all(|need| done.contains(need.as_str())));
            if ready.is_empty() {
                return None;
            }
            let names = ready.iter().map(|(name, _)| *name);
            done.extend(names.clone());
            order.extend(names);
            waiting = rest;
        }
        Some(order)
    }

    /// Replaces digests of the pipeline's own jobs by their names, from which the order follows.
    /// This undoes the resolution of references.
    pub fn name_siblings(&mut self) {
        let names: BTreeMap<Digest, String> =
            self.jobs.iter().map(|(name, job)| (job.spec.digest(), name.clone())).collect();
        for member in self.jobs.values_mut() {
            for reference in member.spec.references() {
                reference.to.name_job(&names);
            }
        }
    }
}

impl Check for PipelineSpec {
    fn check(&self, violations: &mut Violations) {
        violations.length("name", self.name.len(), 1..=100);
        if self.jobs.is_empty() || self.jobs.len() > MAX_MEMBERS {
            violations.add("jobs", format!("{} jobs", self.jobs.len()), NUMBER_OF_JOBS);
        }
        let known_violations = violations.count();
        for (name, member) in &self.jobs {
            let path = format!("jobs.{name}");
            if !is_job_name(name) {
                violations.add(
                    &path,
                    format!("{name:?}"),
                    "a name of 1 to 60 lower-case letters, digits and dashes",
                );
            }
            if member.spec.kind() == JobKind::Pipeline {
                violations.add(&format!("{path}.kind"), "pipeline", "any other kind of job");
                continue;
            }
            violations.part(&path, &member.spec);
            self.check_references(&path, member, violations);
        }
        if violations.count() == known_violations && self.order().is_none() {
            violations.add("jobs", "circular", "jobs that do not need each other in a circle");
        }
    }
}

impl PipelineSpec {
    fn check_references(&self, path: &str, member: &PipelineMember, violations: &mut Violations) {
        for need in &member.needs {
            self.check_reference(&format!("{path}.needs"), need, JobKind::ALL, violations);
        }
        for job in member.spec.named_jobs() {
            let field = format!("{path}.{}.job", job.field);
            self.check_reference(&field, &job.name, &JobKind::making(job.product), violations);
        }
    }

    /// Checks that `name` is a job of one of `kinds`.
    fn check_reference(
        &self,
        field: &str,
        name: &str,
        kinds: &[JobKind],
        violations: &mut Violations,
    ) {
        let fits = |job: &PipelineMember| kinds.contains(&job.spec.kind());
        if self.jobs.get(name).is_some_and(fits) {
            return;
        }
        violations.add_with(field, || {
            let kind = match kinds {
                kinds if kinds == JobKind::ALL => String::new(),
                kinds => {
                    let kinds: Vec<&str> = kinds.iter().map(|kind| kind.as_str()).collect();
                    format!("{} ", kinds.join(" or "))
                }
            };
            let fitting = self.jobs.iter().filter(|(_, job)| fits(job));
            let names: Vec<&str> = fitting.map(|(name, _)| name.as_str()).collect();
            let allowed = format!("a {kind}job of this pipeline: {}", names.join(", "));
            (format!("{name:?}"), allowed)
        });
    }
}

fn is_job_name(name: &str) -> bool {
    (1..=60).contains(&name.len())
        && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
}
