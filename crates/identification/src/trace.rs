//! Curves of a recording beside those of arms.

/// Measured values of a joint, and those of the described and the identified arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Times since the recording's beginning, s.
    pub times_s: Vec<f64>,
    /// Measured values after the low-pass.
    pub measured: Vec<f64>,
    /// The values of the description.
    pub described: Vec<f64>,
    /// The values of the identified arm.
    pub identified: Vec<f64>,
}
