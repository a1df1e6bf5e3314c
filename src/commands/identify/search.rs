//! The search for an arm and the loads in its hand, with its progress.

use std::ops::ControlFlow;

use identification::{
    Identification, IdentificationError, Recording, Settings, identify, identify_load,
};
use spec::RobotDescription;
use worker::FoundLoad;

use crate::progress::ProgressCallback;

/// Recordings, and the arm that the search begins from.
pub struct Search {
    pub description: RobotDescription,
    pub fit: Vec<Recording>,
    pub validation: Vec<Recording>,
    /// The recordings of each load.
    pub loads: Vec<Vec<Recording>>,
    pub settings: Settings,
}

/// The arm and the loads that a search found.
pub struct Found {
    pub arm: Identification,
    pub loads: Vec<FoundLoad>,
}

impl Search {
    /// The most steps.
    pub fn steps(&self) -> u64 {
        self.settings.steps() + self.loads.len() as u64 * self.settings.load_steps()
    }

    /// Searches, and tells `progress` of every step.
    ///
    /// # Errors
    /// See [`IdentificationError`].
    pub fn run(&self, progress: ProgressCallback<'_>) -> Result<Found, IdentificationError> {
        let Self { description, fit, validation, loads, settings } = self;
        let mut done = 0;
        let mut step = || -> ControlFlow<()> {
            done += 1;
            progress(done)
        };
        let arm = identify(description, fit, validation, settings, &mut step)?;
        let mut load = |recordings: &Vec<Recording>| {
            let names: Vec<&str> = recordings.iter().map(|log| log.name.as_str()).collect();
            let found = identify_load(description, &arm.arm, recordings, &[], settings, &mut step)?;
            Ok(FoundLoad { recordings: names.join(", "), found })
        };
        let loads = loads.iter().map(&mut load).collect::<Result<_, IdentificationError>>()?;
        Ok(Found { arm, loads })
    }
}
