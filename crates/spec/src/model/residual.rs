use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::Given;
use crate::check::{Check, Violations};

/// The path that a model's prediction is added to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case", from = "Written")]
pub enum Residual {
    /// None: the model predicts positions, as in the paper.
    #[default]
    None,
    /// The damped integrator q̇ = u / D, from the last sample of the context on.
    Integrator(DampedIntegrator),
    /// The damped integrator from the last measured position *and* velocity. The velocity turns
    /// into u / D with the lag that the context shows. The path's scale grows from 0 in the same
    /// way as its errors grow in the context, so a prediction continues where the arm is.
    LaggedIntegrator(DampedIntegrator),
    /// The reference of the controller, shifted so that it goes through the last position of the
    /// context. Only with `given` references.
    Reference,
}

/// The forms in which a residual may be written. `"integrator"` alone has the default damping.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "expected \"none\", \"integrator\", \"lagged-integrator\", \"reference\", {\"integrator\": {\"damping\": D}} or \
                 {\"lagged-integrator\": {\"damping\": D}}"
)]
enum Written {
    Name(Name),
    WithDamping(WithDamping),
    LaggedWithDamping(LaggedWithDamping),
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Name {
    None,
    Integrator,
    LaggedIntegrator,
    Reference,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WithDamping {
    integrator: DampedIntegrator,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct LaggedWithDamping {
    lagged_integrator: DampedIntegrator,
}

impl From<Written> for Residual {
    fn from(written: Written) -> Self {
        match written {
            Written::Name(Name::None) => Self::None,
            Written::Name(Name::Reference) => Self::Reference,
            Written::Name(Name::Integrator) => Self::Integrator(DampedIntegrator::default()),
            Written::Name(Name::LaggedIntegrator) => {
                Self::LaggedIntegrator(DampedIntegrator::default())
            }
            Written::WithDamping(WithDamping { integrator }) => Self::Integrator(integrator),
            Written::LaggedWithDamping(LaggedWithDamping { lagged_integrator }) => {
                Self::LaggedIntegrator(lagged_integrator)
            }
        }
    }
}

/// q̇ = u / D.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DampedIntegrator {
    /// D of every joint, N·m·s/rad. 10 is the damping of the simulated arms.
    pub damping: f64,
}

impl Default for DampedIntegrator {
    fn default() -> Self {
        Self { damping: 10.0 }
    }
}

impl Residual {
    /// Whether the model predicts positions themselves.
    pub const fn is_none(&self) -> bool {
        matches!(self, Self::None)
    }

    /// Whether the path follows from the series that a model is `given`.
    pub(crate) const fn fits(&self, given: Given) -> bool {
        match self {
            Self::None => true,
            Self::Integrator(_) | Self::LaggedIntegrator(_) => matches!(given, Given::Torques),
            Self::Reference => matches!(given, Given::References),
        }
    }

    pub(crate) const fn name(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Integrator(_) => "integrator",
            Self::LaggedIntegrator(_) => "lagged-integrator",
            Self::Reference => "reference",
        }
    }
}

impl Check for Residual {
    fn check(&self, violations: &mut Violations) {
        let (field, integrator) = match self {
            Self::None | Self::Reference => return,
            Self::Integrator(integrator) => ("integrator.damping", integrator),
            Self::LaggedIntegrator(integrator) => ("lagged-integrator.damping", integrator),
        };
        violations.within(field, integrator.damping, 1e-3..=1e6);
    }
}
