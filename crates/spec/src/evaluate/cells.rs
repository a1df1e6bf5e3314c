use std::fmt;

use super::spec::EvaluateSpec;
use crate::{DataSpec, Family};

/// Default number of scenarios for data without a frequency grid.
const UNGRIDDED_SCENARIOS: u32 = 1000;

/// Scenarios that one task evaluates and that are summarized together.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioCell {
    /// Family and master frequency in Hz; `None` for data without a grid.
    pub excitation: Option<(Family, f64)>,
    /// Index of the first trajectory.
    pub first: u64,
    /// Number of trajectories. For recordings it is an upper limit, because only their file tells
    /// the number.
    pub count: u64,
    /// Standard deviation of the noise added to the positions of contexts, rad.
    pub position_noise_rad: f64,
}

impl EvaluateSpec {
    /// The cells of an evaluation of `data`, in order: one per family and frequency of its grid, or
    /// a single one. They are repeated for each level of noise.
    pub fn cells(&self, data: &DataSpec) -> Vec<ScenarioCell> {
        let levels = self.position_noise_rad.iter();
        levels.flat_map(|&level| self.cells_at(data, level)).collect()
    }

    fn cells_at(&self, data: &DataSpec, position_noise_rad: f64) -> Vec<ScenarioCell> {
        let limit = self.scenarios.map(u64::from);
        let grid = data.cells();
        if grid.is_empty() {
            let limit = limit.unwrap_or(u64::from(UNGRIDDED_SCENARIOS));
            let count = data.trajectories().unwrap_or(limit).min(limit);
            return vec![ScenarioCell { excitation: None, first: 0, count, position_noise_rad }];
        }
        grid.into_iter()
            .map(|cell| ScenarioCell {
                excitation: Some((cell.family, cell.frequency_hz)),
                first: cell.first,
                count: limit.map_or(cell.count, |limit| limit.min(cell.count)),
                position_noise_rad,
            })
            .collect()
    }
}

/// The cell's name in tables and tasks.
impl fmt::Display for ScenarioCell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.excitation {
            Some((family, frequency_hz)) => write!(f, "{family} {frequency_hz} Hz")?,
            None => f.write_str("all scenarios")?,
        }
        if self.position_noise_rad > 0.0 {
            write!(f, " at {} rad", self.position_noise_rad)?;
        }
        Ok(())
    }
}
