//! Checks that a fine-tuning fits the training whose checkpoint it begins from.

use serde_json::{Map, Value};

use super::TrainSpec;
use crate::check::{Violations, first_repeated};
use crate::shorten::shorten;
use crate::{DataSpec, Lengths, SpecError, Training};

/// Fields of a model that a fine-tuning may change. They change neither the parameters nor what a
/// network computes from them, only how it is trained and sampled.
const FREE_FIELDS: [&str; 7] = [
    "sampler",
    "loss",
    "weights",
    "dropout",
    "embedding_dropout",
    "matmul_precision",
    "least_context",
];

/// The largest number of entries of `frozen`, and of bytes of each.
const MOST_FROZEN: usize = 100;
const LONGEST_NAME: usize = 200;

impl TrainSpec {
    pub(super) fn check_frozen(&self, violations: &mut Violations) {
        violations.length("frozen", self.frozen.len(), 0..=MOST_FROZEN);
        if self.init.is_none() && !self.frozen.is_empty() {
            let allowed = "left out without init, whose weights it keeps";
            violations.add("frozen", "given", allowed);
        }
        for (i, name) in self.frozen.iter().enumerate().take(MOST_FROZEN) {
            let field = format!("frozen[{i}]");
            violations.length(&field, name.len(), 1..=LONGEST_NAME);
            let part = name.split('.').next().unwrap_or_default();
            let parts = self.model.parts();
            if !parts.contains(&part) {
                let value = shorten(&Value::from(name.as_str()));
                let architecture = self.model.architecture();
                let allowed = format!(
                    "a part of {architecture}, or a parameter inside one: {}",
                    parts.join(", ")
                );
                violations.add(&field, value, allowed);
            }
        }
        if let Some(twice) = first_repeated(&self.frozen) {
            violations.add(
                "frozen",
                format!("{} twice", shorten(&twice.as_str().into())),
                "each once",
            );
        }
    }

    /// Checks the training whose checkpoint `init` names, and its data, against this training with
    /// `data`.
    ///
    /// # Errors
    /// Names each field of this training or its data that differs, with both values.
    pub fn check_init(&self, data: &DataSpec, init: &Training<'_>) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        let mut same = |field: &str, theirs: String, ours: String| {
            if theirs != ours {
                violations.add(field, ours, format!("{theirs}, as init was trained"));
            }
        };
        let [theirs, ours] = [&init.spec.model, &self.model];
        let is_same_architecture = theirs.architecture() == ours.architecture();
        let [found, asked] = [theirs, ours].map(|model| model.architecture().to_owned());
        same("model.architecture", found, asked);
        same("data.joints", init.data.joints().to_string(), data.joints().to_string());
        same("data.rate_hz", init.data.rate_hz().to_string(), data.rate_hz().to_string());
        if is_same_architecture {
            if ours.lengths() != Lengths::Any {
                same("context", init.spec.context.to_string(), self.context.to_string());
                same("data.samples", init.data.samples().to_string(), data.samples().to_string());
            }
            let [found, asked] = [init.spec, self].map(|spec| spec.normalization.name().to_owned());
            same("normalization", found, asked);
            same("given", init.spec.given.to_string(), self.given.to_string());
            let [theirs, ours] = [theirs, ours].map(fields);
            for field in ours.keys().chain(theirs.keys().filter(|field| !ours.contains_key(*field)))
            {
                let value = |of: &Map<String, Value>| {
                    of.get(field).map_or_else(|| "left out".to_owned(), shorten)
                };
                if !FREE_FIELDS.contains(&field.as_str()) {
                    same(&format!("model.{field}"), value(&theirs), value(&ours));
                }
            }
        }
        violations.finish()
    }
}

/// The fields of a model in specs.
fn fields(model: &crate::ModelSpec) -> Map<String, Value> {
    match serde_json::to_value(model) {
        Ok(Value::Object(fields)) => fields,
        _ => Map::new(),
    }
}
