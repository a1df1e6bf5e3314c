//! The robot that is controlled.

use std::ops::ControlFlow;

use dynamics::{ArmState, DynamicsError, Joints, Motion, Replay, Robot};
use series::{Series, Shape};
use spec::SimulateSpec;

use super::forecast::Now;
use crate::baselines::to_f32;

/// A simulated robot with its recording.
#[derive(Clone, Debug)]
pub struct Plant {
    robot: Robot,
    replay: Replay,
    state: ArmState,
    u: Vec<Joints<f32>>,
    y: Vec<Joints<f32>>,
}

impl Plant {
    /// The robot of trajectory `index` after the first `samples` torques of its excitation.
    ///
    /// # Errors
    /// Those of [`dynamics::simulate`].
    pub fn excited(
        simulation: &SimulateSpec,
        index: u64,
        samples: usize,
    ) -> Result<Self, DynamicsError> {
        let recorded =
            dynamics::simulate(simulation, index..index + 1, &|_| ControlFlow::Continue(()))?;
        let scenario = &recorded.scenarios[0];
        let mut plant = Self {
            robot: scenario.robot.clone(),
            replay: Replay::of(simulation),
            state: ArmState { q: scenario.q0, qd: scenario.qd0 },
            u: Vec::new(),
            y: vec![scenario.q0.map(to_f32)],
        };
        let torques = recorded
            .series
            .true_u()
            .chunks_exact(recorded.series.joints())
            .take(samples)
            .map(Joints::from);
        plant.apply(&torques.collect::<Vec<_>>());
        Ok(plant)
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Its positions and velocities now.
    pub fn state(&self) -> &ArmState {
        &self.state
    }

    /// The knowledge at this moment.
    pub fn now(&self) -> Now<'_> {
        Now { u: &self.u, y: &self.y, state: &self.state }
    }

    /// Applies torques one after the other, N·m.
    pub fn apply(&mut self, torques: &[Joints<f32>]) {
        let ArmState { q: q0, qd: qd0 } = self.state;
        let u: Vec<f32> = torques.iter().flatten().copied().collect();
        let motion = Motion { robot: &self.robot, q0, qd0, u: &u, anchors: &[] };
        let (positions, ends) = self.replay.run_through(&[motion]);
        self.state = ends[0];
        self.u.extend(torques);
        let positions = positions.chunks_exact(self.robot.joints()).skip(1);
        self.y.extend(positions.map(Joints::from));
        if !torques.is_empty() {
            self.y.push(self.state.q.map(to_f32));
        }
    }

    /// The torques and positions so far. `None` if some are not finite.
    pub fn recorded(&self, rate_hz: f64) -> Option<Series> {
        let u: Vec<f32> = self.u.iter().flatten().copied().collect();
        let mut y: Vec<f32> = self.y.iter().flatten().copied().collect();
        // There is one position more than torques.
        y.truncate(u.len());
        let joints = self.robot.joints();
        let shape = Shape { robots: 1, samples: u.len() / joints, joints };
        let is_finite = u.iter().chain(&y).all(|value| value.is_finite());
        Series::new(shape, rate_hz, u, y).ok().filter(|_| is_finite)
    }

    /// Whether the state is finite.
    pub fn is_finite(&self) -> bool {
        let ArmState { q, qd } = &self.state;
        q.iter().chain(qd).all(|value| value.is_finite())
    }
}
