//! The modules that execute the tasks of each kind of job.

use spec::JobKind;

use crate::attempt::Attempt;
use crate::error::TaskError;

/// The entry that registers the module of a kind.
#[derive(Clone, Copy)]
pub(crate) struct KindModule {
    /// Executes one task and commits its result.
    pub run: fn(&Attempt) -> Result<(), TaskError>,
    /// Whether it computes models. A panic may then be the fault of the device.
    pub computes_models: bool,
}

macro_rules! registered {
    ($($name:ident => $Kind:ident($Spec:ident),)*) => {
        /// `None` for a pipeline, which has no tasks of its own.
        pub(crate) const fn module(kind: JobKind) -> Option<KindModule> {
            match kind {
                $(JobKind::$Kind => Some(crate::$name::MODULE),)*
                JobKind::Pipeline => None,
            }
        }
    };
}

spec::for_each_kind!(registered);
