//! The horizons of predictions.

/// How far ahead motions are predicted, s: one step of a controller, half a second, and the horizon
/// of the paper's study.
pub const HORIZONS_S: [f64; 3] = [0.1, 0.5, 1.33];
