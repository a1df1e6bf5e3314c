//! The viewer of single trajectories in a dataset.

use serde_json::{Map, Value};
use wire::{Dataset, Summary};

use crate::app::App;
use crate::charts;
use crate::error::ApiError;
use crate::page::parts::Fact;
use crate::page::text;

/// The shown trajectory.
pub struct Viewer {
    pub trajectory: u64,
    /// The largest index.
    pub last: u64,
    pub previous: Option<u64>,
    pub next: Option<u64>,
    /// The height of its figure, px.
    pub height: u32,
    /// The main parameters of the trajectory. Empty if it cannot be shown.
    pub facts: Vec<Fact>,
    /// Why it cannot be shown.
    pub problem: String,
}

impl Viewer {
    /// `None` while there is no trajectory.
    pub async fn new(
        app: &App,
        dataset: &Dataset,
        summary: &Summary,
        asked: Option<u64>,
    ) -> Result<Option<Self>, ApiError> {
        if summary.trajectories == 0 {
            return Ok(None);
        }
        let last = dataset.trajectories.max(summary.trajectories) - 1;
        let trajectory = asked.unwrap_or(summary.first);
        let (facts, problem) = match app.robot(dataset.id, trajectory).await {
            Ok(robot) => (facts(&robot), String::new()),
            Err(error @ (ApiError::NotFound { .. } | ApiError::ShardUnreadable { .. })) => {
                error.log();
                (Vec::new(), capitalized(&error.to_string()))
            }
            Err(error) => return Err(error),
        };
        let columns: Vec<&str> = summary.channels.iter().map(|it| it.name.as_str()).collect();
        Ok(Some(Self {
            trajectory,
            last,
            height: charts::trajectory_height(&columns),
            previous: trajectory.checked_sub(1).map(|previous| previous.min(last)),
            next: trajectory.checked_add(1).filter(|next| *next <= last),
            facts,
            problem,
        }))
    }
}

/// The most informative fields of a row, for simulations and for imports.
const SHOWN: [(&str, &str, &str); 7] = [
    ("family", "Excitation", ""),
    ("frequency_hz", "Frequency", "Hz"),
    ("draws", "Draws", "until one was kept"),
    ("gravity_m_s2", "Gravity", "m/s²"),
    ("payload_mass", "Payload", "kg"),
    ("recording", "Recording", ""),
    ("first_time_s", "Begins at", "s"),
];

fn facts(robot: &Map<String, Value>) -> Vec<Fact> {
    let fact = |(column, name, unit): &(&str, &str, &str)| {
        let value = match robot.get(*column)? {
            Value::Number(number) if number.is_f64() => text::value(number.as_f64()?),
            Value::Number(number) => text::count(number.as_u64()?),
            Value::String(word) if !word.is_empty() => word.clone(),
            _ => return None,
        };
        Some(Fact::new(*name, value, *unit))
    };
    SHOWN.iter().filter_map(fact).collect()
}

fn capitalized(sentence: &str) -> String {
    let mut letters = sentence.chars();
    let first = letters.next().into_iter().flat_map(char::to_uppercase);
    first.chain(letters).collect()
}
