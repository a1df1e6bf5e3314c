//! Streams: robots that are simulated when they are needed and never stored.

use std::ops::{ControlFlow, Range};

use dynamics::{DynamicsError, InstructionSet, Trajectories};
use series::Series;
use spec::{DataSpec, Given, SimulateSpec};

use crate::attempt::Attempt;
use crate::error::TaskError;

/// An endless simulation of a spec: it has a trajectory `i` for every `i`, and the same one each
/// time. Its beginning is the dataset that the simulation would store.
#[derive(Clone, Debug)]
pub(crate) struct Stream {
    /// A simulation.
    pub data: DataSpec,
    spec: SimulateSpec,
    given: Given,
}

impl Stream {
    pub fn new(spec: &SimulateSpec) -> Self {
        let data = DataSpec::Simulation(spec.clone());
        Self { data, spec: spec.clone(), given: Given::Torques }
    }

    /// The same stream with what predictors are given in the place of torques.
    pub fn given(self, given: Given) -> Self {
        Self { given, ..self }
    }

    /// Reads any trajectories, using the threads of the current rayon pool.
    pub fn read(&self, attempt: &Attempt, range: Range<u64>) -> Result<Series, TaskError> {
        Ok(self.trajectories(attempt, range)?.series)
    }

    /// All that a simulation gives for these trajectories.
    pub fn trajectories(
        &self,
        attempt: &Attempt,
        range: Range<u64>,
    ) -> Result<Trajectories, TaskError> {
        let mut simulated = Trajectories::default();
        self.simulate(range, &|| attempt.stop.get().is_some(), &mut simulated)?;
        Ok(simulated)
    }

    /// Simulates, reusing the memory of trajectories that are no longer needed, unless told to
    /// stop.
    pub fn simulate(
        &self,
        range: Range<u64>,
        stopped: &(dyn Fn() -> bool + Sync),
        into: &mut Trajectories,
    ) -> Result<(), TaskError> {
        let progress = |_| {
            if stopped() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        dynamics::simulate_into(InstructionSet::best(), &self.spec, range, &progress, into)
            .map_err(|error| match error {
                DynamicsError::Cancelled { .. } => TaskError::Stopped,
                other => other.into(),
            })?;
        if self.given == Given::References {
            let missing =
                || TaskError::Missing { what: "the references of", name: "a stream".to_owned() };
            into.series.replace_u(into.reference.as_ref().ok_or_else(missing)?);
        }
        Ok(())
    }
}
