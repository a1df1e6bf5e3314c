//! The names that filters and orders use: `metrics.loss`, "params.`batch size`", `attributes.status`, `start_time`.

use super::MlflowError;

/// A field of a run or an experiment that a filter can use.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Field {
    Metric(String),
    Param(String),
    Tag(String),
    Attribute(Attribute),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Attribute {
    RunId,
    RunName,
    UserId,
    Status,
    StartTime,
    EndTime,
    ArtifactUri,
    Name,
    ExperimentId,
    CreationTime,
    LastUpdateTime,
}

/// The value of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Datum<'a> {
    Number(f64),
    Text(&'a str),
}

impl Attribute {
    /// Attributes of runs.
    pub const OF_RUNS: [Self; 7] = [
        Self::RunId,
        Self::RunName,
        Self::UserId,
        Self::Status,
        Self::StartTime,
        Self::EndTime,
        Self::ArtifactUri,
    ];

    /// Attributes of experiments.
    pub const OF_EXPERIMENTS: [Self; 4] =
        [Self::Name, Self::ExperimentId, Self::CreationTime, Self::LastUpdateTime];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::RunId => "run_id",
            Self::RunName => "run_name",
            Self::UserId => "user_id",
            Self::Status => "status",
            Self::StartTime => "start_time",
            Self::EndTime => "end_time",
            Self::ArtifactUri => "artifact_uri",
            Self::Name => "name",
            Self::ExperimentId => "experiment_id",
            Self::CreationTime => "creation_time",
            Self::LastUpdateTime => "last_update_time",
        }
    }

    pub const fn is_number(self) -> bool {
        matches!(self, Self::StartTime | Self::EndTime | Self::CreationTime | Self::LastUpdateTime)
    }

    /// Names that MLflow's page also uses.
    fn alias(name: &str) -> &str {
        match name {
            "created" | "Created" => "start_time",
            "run name" | "Run name" | "Run Name" => "run_name",
            "last_updated" => "last_update_time",
            name => name,
        }
    }
}

impl Field {
    /// Reads a name in a filter. `attributes` are the allowed ones.
    pub fn parse(text: &str, attributes: &[Attribute]) -> Result<Self, MlflowError> {
        let (kind, key) = match text.split_once('.') {
            Some((kind, key)) if !text.starts_with(['`', '"']) => (kind, key),
            _ => ("attributes", text),
        };
        let key = unquoted(key).to_owned();
        match kind {
            "metric" | "metrics" => Ok(Self::Metric(key)),
            "param" | "params" | "parameter" | "parameters" => Ok(Self::Param(key)),
            "tag" | "tags" => Ok(Self::Tag(key)),
            "attribute" | "attributes" | "attr" | "run" => {
                let name = Attribute::alias(&key);
                let known = attributes.iter().find(|attribute| attribute.as_str() == name);
                known.copied().map(Self::Attribute).ok_or_else(|| {
                    let names: Vec<&str> =
                        attributes.iter().map(|attribute| attribute.as_str()).collect();
                    let allowed =
                        format!("metrics.KEY, params.KEY, tags.KEY, {}", names.join(", "));
                    MlflowError::invalid("a field", text, &allowed)
                })
            }
            _ => {
                let allowed = "one that begins with metrics., params., tags. or attributes.";
                Err(MlflowError::invalid("a field", text, allowed))
            }
        }
    }

    pub const fn is_number(&self) -> bool {
        match self {
            Self::Metric(_) => true,
            Self::Param(_) | Self::Tag(_) => false,
            Self::Attribute(attribute) => attribute.is_number(),
        }
    }
}

/// Whether MLflow's own server takes it as the key of a metric, a param or a tag: its file store uses keys as paths.
pub fn is_key(key: &str) -> bool {
    let is_allowed = |c: char| c.is_alphanumeric() || "_-. :/".contains(c);
    let is_path = key.split('/').all(|part| !matches!(part, "" | "." | ".."));
    key.chars().all(is_allowed) && is_path
}

fn unquoted(text: &str) -> &str {
    for quote in ['`', '"'] {
        let inner = text.strip_prefix(quote).and_then(|rest| rest.strip_suffix(quote));
        if let Some(inner) = inner {
            return inner;
        }
    }
    text
}

impl Datum<'_> {
    /// Milliseconds since 1970. Times in the next 285 000 years are exact.
    #[expect(clippy::cast_precision_loss, reason = "times are compared, not calculated with")]
    pub const fn moment(milliseconds: i64) -> Self {
        Self::Number(milliseconds as f64)
    }
}
