//! Streams: robots that are simulated when they are needed and never stored.

use std::ops::{ControlFlow, Range};

use dynamics::{DynamicsError, InstructionSet, Trajectories};
use series::Series;
use spec::{DataSpec, SimulateSpec};

use crate::attempt::Attempt;
use crate::error::TaskError;

/// An endless simulation of a spec: it has a trajectory `i` for every `i`, and the same one each
/// time. Its beginning is the dataset that the simulation would store.
#[derive(Clone, Debug)]
pub(crate) struct Stream {
    /// A simulation.
    pub data: DataSpec,
    spec: SimulateSpec,
}

impl Stream {
    pub fn new(spec: &SimulateSpec) -> Self {
        Self { data: DataSpec::Simulation(spec.clone()), spec: spec.clone() }
    }

    /// Reads any trajectories, using the threads of the current rayon pool.
    pub fn read(&self, attempt: &Attempt, range: Range<u64>) -> Result<Series, TaskError> {
        let mut simulated = Trajectories::default();
        self.simulate(range, &|| attempt.stop.get().is_some(), &mut simulated)?;
        Ok(simulated.series)
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
        dynamics::simulate_into(InstructionSet::best(), &self.spec, range, &progress, into).map_err(
            |error| match error {
                DynamicsError::Cancelled { .. } => TaskError::Stopped,
                other => other.into(),
            },
        )
    }
}
