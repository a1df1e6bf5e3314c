//! The default data of an evaluation.

use serde_json::{Map, Value, json};

use super::spec::{Baseline, EvaluateSpec};
use crate::kind::from_fields;
use crate::schema::Components;
use crate::{DataSource, SpecError};

/// Default horizon in samples, if the data has no length either.
const HORIZON: u32 = 80;

/// A seed of its own, so that no training shares its robots.
const SEED: u64 = 1_000_003;

/// Number of robots at each frequency.
const SCENARIOS: u32 = 100;

/// Reads an evaluation from JSON, without checking its values.
pub(super) fn read(
    mut fields: Map<String, Value>,
    found: SpecError,
    schemas: &Components,
) -> Result<EvaluateSpec, SpecError> {
    let names_data = fields.contains_key("data");
    if !names_data {
        fields.insert("data".to_owned(), stream_over_grid());
    }
    let names_baselines = fields.contains_key("baselines");
    let mut spec: EvaluateSpec = from_fields(fields, found, schemas)?;
    if !names_baselines {
        spec.baselines = Baseline::usual_with(spec.given);
    }
    if !names_data {
        spec.fit_grid();
    }
    Ok(spec)
}

/// The frequencies of the test grids in Hz: of chirps and of multisines.
fn test_grids() -> [Vec<f64>; 2] {
    let chirp = (1..=10).map(|k| f64::from(k) / 10.0).collect();
    [chirp, vec![0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5]]
}

fn stream_over_grid() -> Value {
    let [chirp, multisine] = test_grids();
    json!({"stream": {
        "trajectories": 1,
        "seed": SEED,
        "excitation": {
            "chirp": {"frequency_hz": {"grid": chirp}},
            "multisine": {"frequency_hz": {"grid": multisine}},
        },
    }})
}

impl EvaluateSpec {
    /// Sets the numbers of robots and samples that the evaluation needs.
    fn fit_grid(&mut self) {
        /// The most samples of a simulation. If more are needed, the error is reported for
        /// `context`, `horizon` or `rounds`.
        const MOST: u32 = 10_000;
        let asked = [self.context, self.horizon.unwrap_or(HORIZON), self.rounds()];
        let samples = asked.into_iter().fold(0, u32::saturating_add).clamp(2, MOST);
        let scenarios = self.scenarios.unwrap_or(SCENARIOS).clamp(1, MOST);
        if let DataSource::Stream(stream) = &mut self.data {
            stream.samples = samples;
            stream.trajectories = u64::from(scenarios) * stream.excitation.grid().len() as u64;
        }
    }
}
