//! What recordings say about their own torques, beside the arm that they are of.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The torques of recordings beside those of the named arm. Stored under `check` in the result of
/// an import's task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LogCheck {
    /// Length of the recordings that were compared, s. 0 if none is long enough.
    pub seconds: f64,
    /// One for each joint, from the base.
    pub channels: Vec<ChannelCheck>,
    /// What is probably wrong, a sentence each.
    pub doubts: Vec<String>,
}

/// The torque column of one joint beside the arm's torque. A number that the motion does not show is
/// left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ChannelCheck {
    /// From 1.
    pub joint: u32,
    /// By how much torques are recorded later than positions, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_s: Option<Measurement>,
    /// Whether a torque turns the joint towards larger positions (1), or towards smaller ones (-1).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sign: Option<i8>,
    /// Recorded torque per torque of the arm, N·m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<Measurement>,
    /// Whether the torques carry the arm's weight, or come without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub carries_weight: Option<bool>,
    /// The share of the arm's weight in the torques, if accelerations tell their scale as well.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity: Option<Measurement>,
    /// The share of the torque's variance that the arm explains, with friction, a rotor and an
    /// offset that fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub explained: Option<f64>,
    /// Why numbers are left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unseen: Option<String>,
}

/// A number with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Measurement {
    /// The number.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
}
