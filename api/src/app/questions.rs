//! Reads prediction requests from JSON, and checks that the model can answer them.

use std::fmt::Display;

use axum::body::Bytes;
use serde::de::{DeserializeOwned, IgnoredAny};
use serde_json::Value;
use series::{MeasurementNoise, Series, Shape, ShapeError};
use spec::{MAX_POSITION_NOISE_RAD, SpecError, Violation, read_json, shape_violations};
use utoipa::ToSchema;
use wire::{ObservedScenario, PredictionRequest, PredictionSampling};

use crate::app::App;
use crate::error::ApiError;
use crate::limits::{
    ANSWERED_NUMBERS, ASKED_NUMBERS, BODY_BYTES, PREDICTED_POSITIONS, QUANTILES, QUESTION_MAGNITUDE,
};
use crate::live::{AboutModel, Question};

impl App {
    /// Reads the body of a request like [`read`], without keeping other requests waiting.
    pub(crate) async fn read_body<T>(&self, body: Bytes, refusal: Refusal) -> Result<T, ApiError>
    where
        T: DeserializeOwned + ToSchema + Send + 'static,
    {
        self.checks.run(body.len(), move || read(&body, refusal)).await
    }
}

/// The error for a body with these violations, such as [`ApiError::Question`].
pub type Refusal = fn(SpecError) -> ApiError;

/// Reads a value of this type from JSON. An error names the fields, and in a body of more than
/// [`BODY_BYTES`] the first one.
///
/// # Errors
/// [`ApiError::Json`] for invalid JSON, and `refusal` for JSON of another type.
pub fn read<T: DeserializeOwned + ToSchema>(bytes: &[u8], refusal: Refusal) -> Result<T, ApiError> {
    // serde would accept a list in place of an object with named fields.
    let is_object = bytes.trim_ascii_start().starts_with(b"{");
    let reason = match serde_json::from_slice(bytes) {
        Ok(message) if is_object => return Ok(message),
        Ok(_) => "an object with named fields".to_owned(),
        Err(error) => error.to_string(),
    };
    if bytes.len() > BODY_BYTES {
        read_json::<IgnoredAny>(bytes).map_err(ApiError::Json)?;
        return Err(refusal(first_fault::<T>(bytes, reason)));
    }
    // The second pass finds all violations. Valid requests do not pay for it. The parsed message
    // takes up to a hundred times its bytes.
    let message: Value = read_json(bytes).map_err(ApiError::Json)?;
    let mut error = shape_violations::<T>(&message);
    if error.is_empty() {
        error = SpecError::one(WHOLE, "", reason);
    }
    for violation in error.violations.iter_mut().filter(|violation| violation.field.is_empty()) {
        violation.field = WHOLE.to_owned();
    }
    Err(refusal(error))
}

/// The field of an error about a message as a whole.
const WHOLE: &str = "the message";

/// The first fault of a message that is too large to be searched for all of them.
fn first_fault<T: DeserializeOwned>(bytes: &[u8], reason: String) -> SpecError {
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let read = serde_path_to_error::deserialize::<_, T>(&mut reader);
    let path = read.err().map(|error| error.path().to_string()).filter(|path| path != ".");
    SpecError::one(path.as_deref().unwrap_or(WHOLE), "", reason)
}

/// Everything that is wrong with a request.
#[derive(Default)]
pub struct RequestViolations(SpecError);

impl RequestViolations {
    pub fn add(&mut self, field: impl Into<String>, value: impl Display, allowed: impl Display) {
        self.0.add_with(|| Violation::new(field, value.to_string(), allowed.to_string()));
    }

    pub fn finish(self) -> Result<(), ApiError> {
        self.finish_as(ApiError::Question)
    }

    /// Like [`Self::finish`], for another request than one for a prediction.
    pub fn finish_as(self, refusal: Refusal) -> Result<(), ApiError> {
        self.0.into_result().map_err(refusal)
    }

    /// Checks the number of rows.
    pub fn rows(&mut self, field: &str, rows: &[Vec<f32>], expected: usize, why: &str) {
        if rows.len() != expected {
            self.add(field, counted(rows.len(), "row"), format!("{expected} rows, {why}"));
        }
    }

    /// Checks that every row has one value per joint, and that values are finite and within
    /// ±[`QUESTION_MAGNITUDE`].
    pub fn values(&mut self, field: &str, rows: &[Vec<f32>], joints: usize) {
        let allowed = -QUESTION_MAGNITUDE..=QUESTION_MAGNITUDE;
        for (index, row) in rows.iter().enumerate() {
            if row.len() != joints {
                let found = counted(row.len(), "value");
                let allowed = format!("{joints} values, one per joint");
                return self.add(format!("{field}[{index}]"), found, allowed);
            }
            if let Some(joint) = row.iter().position(|value| !allowed.contains(value)) {
                let allowed = format!("-{QUESTION_MAGNITUDE} to {QUESTION_MAGNITUDE}");
                return self.add(format!("{field}[{index}][{joint}]"), row[joint], allowed);
            }
        }
    }

    pub fn position_noise(&mut self, position_noise_rad: f64) {
        if !(0.0..=MAX_POSITION_NOISE_RAD).contains(&position_noise_rad) {
            let allowed = format!("0 to {MAX_POSITION_NOISE_RAD}");
            self.add("position_noise_rad", position_noise_rad, allowed);
        }
    }

    pub fn sampling(
        &mut self,
        sampling: &PredictionSampling,
        scenarios: usize,
        about: &AboutModel,
    ) {
        let samples = sampling.samples;
        let values = about.horizon * about.joints;
        let positions = scenarios.saturating_mul(values).max(1);
        let most = PREDICTED_POSITIONS / positions;
        if let Some(samples) = samples
            && !(1..=most.max(1)).contains(&(samples as usize))
        {
            let allowed = format!("1 to {most}, for {PREDICTED_POSITIONS} positions in an answer");
            self.add("sampling.samples", samples, allowed);
        }
        let quantiles = &sampling.quantiles;
        if !quantiles.is_empty() && samples.unwrap_or(1) < 2 {
            let samples = samples.map_or("null".to_owned(), |samples| samples.to_string());
            self.add("sampling.samples", samples, "at least 2, for quantiles");
        }
        if quantiles.len() > QUANTILES {
            self.add("sampling.quantiles", quantiles.len(), format!("at most {QUANTILES} of them"));
            return;
        }
        let returned = if sampling.return_samples { samples.unwrap_or(1) as usize } else { 0 };
        let numbers = positions.saturating_mul(1 + quantiles.len() + returned);
        if numbers > ANSWERED_NUMBERS {
            let allowed = format!(
                "at most {ANSWERED_NUMBERS} positions in an answer with those of quantiles and \
                 returned samples; ask for fewer, or in several requests"
            );
            self.add("sampling", format!("for {numbers} positions"), allowed);
        }
        for (index, &quantile) in quantiles.iter().enumerate() {
            if !(0.0..=1.0).contains(&quantile) {
                self.add(format!("sampling.quantiles[{index}]"), quantile, "0 to 1");
            }
        }
        // The largest integer that JSON keeps exactly.
        let most = (1u64 << 53) - 1;
        if sampling.seed > most {
            self.add("sampling.seed", sampling.seed, format!("0 to {most}"));
        }
    }
}

fn counted(number: usize, noun: &str) -> String {
    let plural = if number == 1 { "" } else { "s" };
    format!("{number} {noun}{plural}")
}

/// The number of rows of a context, as an error explains it.
pub fn context_of(about: &AboutModel) -> String {
    format!("the checkpoint's context at {} Hz", about.rate_hz)
}

/// The number of rows of a horizon, as an error explains it.
pub fn horizon_of(about: &AboutModel) -> String {
    format!("the checkpoint's horizon at {} Hz", about.rate_hz)
}

/// Number of answers to a request: one for each future of each scenario.
pub fn answers_to(request: &PredictionRequest) -> usize {
    request.scenarios.iter().map(|scenario| scenario.possible_futures().len()).sum()
}

/// The largest number of answers to one request.
fn most_answers(about: &AboutModel) -> usize {
    let answered = PREDICTED_POSITIONS / (about.horizon * about.joints).max(1);
    let asked = ASKED_NUMBERS / numbers_of(1, about).max(1);
    answered.min(asked).max(1)
}

/// Torques and positions of a question with `size` answers.
pub fn numbers_of(size: usize, about: &AboutModel) -> usize {
    let AboutModel { context, horizon, joints, .. } = *about;
    size.saturating_mul((2 * context + horizon) * joints)
}

/// Turns a request into the model's input.
///
/// # Errors
/// Every violation.
pub fn question(request: &PredictionRequest, about: &AboutModel) -> Result<Question, ApiError> {
    let PredictionRequest { scenarios, sampling, position_noise_rad, rate_hz: _ } = request;
    let AboutModel { context, horizon, joints, rate_hz, .. } = *about;
    let mut violations = RequestViolations::default();
    let size = answers_to(request);
    let most = most_answers(about);
    if !(1..=most).contains(&size) {
        let allowed = format!("1 to {most}, with each of their futures");
        violations.add("scenarios", format!("{size} of them"), allowed);
        // So many are not looked at one by one.
        return Err(violations.finish().err().unwrap_or(ApiError::Internal));
    }
    let [of_context, of_horizon] = [context_of(about), horizon_of(about)];
    for (index, scenario) in scenarios.iter().enumerate() {
        let field = |name: &str| format!("scenarios[{index}].{name}");
        let (u, y, future_u) = (field("u"), field("y"), field("future_u"));
        violations.rows(&u, &scenario.u, context, &of_context);
        violations.rows(&y, &scenario.y, context, &of_context);
        violations.values(&u, &scenario.u, joints);
        violations.values(&y, &scenario.y, joints);
        let futures = field("futures");
        if !scenario.future_u.is_empty() && !scenario.futures.is_empty() {
            let found = format!("{} of them beside future_u", scenario.futures.len());
            violations.add(&futures, found, "one of future_u and futures");
        }
        for (number, rows) in scenario.possible_futures().iter().enumerate() {
            let name = match scenario.futures.len() {
                0 => future_u.clone(),
                _ => format!("{futures}[{number}]"),
            };
            violations.rows(&name, rows, horizon, &of_horizon);
            violations.values(&name, rows, joints);
        }
    }
    violations.sampling(sampling, size, about);
    violations.position_noise(*position_noise_rad);
    violations.finish()?;
    // Models that fit a robot to its past do it once for neighbours with the same past.
    let answers: Vec<(&ObservedScenario, &Vec<Vec<f32>>)> = scenarios
        .iter()
        .flat_map(|past| past.possible_futures().iter().map(move |future| (past, future)))
        .collect();
    let torques = answers.iter().flat_map(|(past, future)| past.u.iter().chain(*future));
    let positions = answers.iter().flat_map(|(past, _)| &past.y);
    let shape = Shape { robots: size, samples: context + horizon, joints };
    let u = torques.flatten().copied().collect();
    let y = positions.flatten().copied().collect();
    let series = series_of(shape, context, rate_hz, u, y)?;
    Ok(asked(sampling, series.with_noise(noise_of_positions(*position_noise_rad))))
}

/// The noise of torques is not known.
pub fn noise_of_positions(position_rad: f64) -> MeasurementNoise {
    MeasurementNoise::new(position_rad, 0.0)
}

/// The model's input. The rows were checked before, so an error is a fault of this program.
pub fn series_of(
    shape: Shape,
    context: usize,
    rate_hz: f64,
    u: Vec<f32>,
    y: Vec<f32>,
) -> Result<Series, ApiError> {
    let refused =
        |error: ShapeError| SpecError::one("scenarios", shape.to_string(), error.to_string());
    Series::question(shape, context, rate_hz, u, y)
        .map_err(|error| ApiError::Question(refused(error)))
}

pub fn asked(sampling: &PredictionSampling, scenarios: Series) -> Question {
    Question {
        scenarios,
        samples: sampling.samples.map(|samples| samples as usize),
        sampler: sampling.sampler,
        seed: sampling.seed,
        previous: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_that_are_called_q_are_told_their_name_here() {
        let body = br#"{"scenarios": [{"u": [[0.0]], "q": [[0.0]], "future_u": [[0.0]]}]}"#;
        let error = read::<PredictionRequest>(body, ApiError::Question).err().unwrap();
        let message = error.to_string();
        assert!(message.contains("q: unknown field; did you mean `y`?"), "{message}");
    }

    #[test]
    fn one_row_is_no_plural() {
        let mut violations = RequestViolations::default();
        violations.rows("u", &[vec![0.0]], 320, "the checkpoint's context");
        violations.values("u", &[vec![0.0]], 7);
        let message = violations.finish().unwrap_err().to_string();
        let expected = "u is 1 row, allowed: 320 rows, the checkpoint's context; u[0] is 1 value, allowed: 7 values, one per joint";
        assert_eq!(message, expected);
    }
}
