//! The kinds of jobs.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::SpecError;
use crate::schema::{listed, nearest};

/// Passes every kind of job except the pipeline to `$callback!`, as `name => Variant(Spec)`.
///
/// This is the only list of kinds. A kind's module has the kind's name in every crate that has one.
///
/// ```
/// macro_rules! names {
///     ($($name:ident => $Kind:ident($Spec:ident),)*) => { [$(stringify!($name)),*] };
/// }
/// let names = spec::for_each_kind!(names);
/// assert!(names.contains(&"simulate") && !names.contains(&"pipeline"));
/// ```
#[macro_export]
macro_rules! for_each_kind {
    ($callback:ident) => {
        $callback! {
            simulate => Simulate(SimulateSpec),
            train => Train(TrainSpec),
            evaluate => Evaluate(EvaluateSpec),
            control => Control(ControlSpec),
            import => Import(ImportSpec),
            verify => Verify(VerifySpec),
            identify => Identify(IdentifySpec),
        }
    };
}

macro_rules! job_kinds {
    ($($name:ident => $Kind:ident($Spec:ident),)*) => {
        /// The work that a job does.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
        #[serde(rename_all = "snake_case")]
        #[expect(missing_docs, reason = "the spec of each kind says what its jobs do")]
        pub enum JobKind {
            $($Kind,)*
            Pipeline,
        }

        impl JobKind {
            /// All kinds, the pipeline last.
            pub const ALL: &[Self] = &[$(Self::$Kind,)* Self::Pipeline];

            /// Their words, in the same order.
            pub const WORDS: &[&'static str] = &[$(stringify!($name),)* "pipeline"];

            /// The word in specs, which is also the name of the kind's modules.
            pub const fn as_str(self) -> &'static str {
                match self {
                    $(Self::$Kind => stringify!($name),)*
                    Self::Pipeline => "pipeline",
                }
            }
        }
    };
}

for_each_kind!(job_kinds);

impl JobKind {
    /// The names of all kinds, for an error.
    pub(crate) fn names() -> String {
        let names: Vec<&str> = Self::ALL.iter().map(|kind| kind.as_str()).collect();
        names.join(", ")
    }
}

impl FromStr for JobKind {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let known = Self::ALL.iter().copied().find(|kind| kind.as_str() == text);
        known.ok_or_else(|| {
            let names: Vec<String> = Self::ALL.iter().map(ToString::to_string).collect();
            let meant = nearest(text, names.iter().map(String::as_str));
            SpecError::one("kind", format!("{text:?}"), listed(&names, meant))
        })
    }
}

impl fmt::Display for JobKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_called_the_same_in_code_and_in_json() {
        for kind in JobKind::ALL {
            assert_eq!(serde_json::to_value(kind).unwrap(), kind.as_str());
        }
    }
}
