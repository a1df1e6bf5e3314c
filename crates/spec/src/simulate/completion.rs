//! Defaults of a simulation that come from its robot's description.

use serde::Serialize;
use serde_json::{Map, Value};

use super::controller;
use super::robot_spec::{Friction, RobotSpec};
use crate::schema::{Components, explain};
use crate::shorten::shorten;
use crate::{RobotModel, SpecError};

/// Completes a simulation's fields from the description of its robot. The types' own defaults are
/// for the Panda, so a spec for a Panda needs nothing.
pub(crate) fn complete(
    fields: &mut Map<String, Value>,
    schemas: &Components,
) -> Result<(), SpecError> {
    controller::complete(fields);
    let Some(model) = complete_robot(fields, schemas)? else { return Ok(()) };
    let description = model.description();
    let initial_state = fields.entry("initial_state").or_insert_with(|| Map::new().into());
    if let Value::Object(initial_state) = initial_state {
        add_missing(initial_state, &description.initial_state);
    }
    if let Some(multisine) = fields
        .get_mut("excitation")
        .and_then(|excitation| excitation.get_mut("multisine"))
        .and_then(Value::as_object_mut)
    {
        let divisors = description.per_joint(|joint| joint.multisine_divisor);
        multisine.entry("torque_divisor").or_insert_with(|| divisors.into());
    }
    Ok(())
}

/// Completes only the field `robot`. Returns its model, unless it is the Panda.
pub(crate) fn complete_robot(
    fields: &mut Map<String, Value>,
    schemas: &Components,
) -> Result<Option<RobotModel>, SpecError> {
    let Some(robot) = fields.get_mut("robot").and_then(Value::as_object_mut) else {
        return Ok(None);
    };
    let Some(model) = robot.get("model") else { return Ok(None) };
    let model = read_model(model, schemas).map_err(|error| error.within("robot.model"))?;
    if model == RobotModel::panda() {
        return Ok(None);
    }

    if let Some(Value::Object(friction)) = robot.get_mut("friction") {
        let nominal = Friction::nominal(model.description());
        match nominal {
            Some(nominal) => add_missing(friction, &nominal),
            None => {
                if let Some(missing) = ["phi1_nm", "phi2_s_rad", "phi3_rad_s"]
                    .iter()
                    .find(|name| !friction.contains_key(**name))
                {
                    let field = format!("robot.friction.{missing}");
                    let allowed = "one number per joint: the robot's description has no friction";
                    return Err(SpecError::one(field, "missing", allowed));
                }
            }
        }
    }
    add_missing(robot, &RobotSpec::of(model.clone()));
    Ok(Some(model))
}

fn read_model(value: &Value, schemas: &Components) -> Result<RobotModel, SpecError> {
    explain(schemas, "RobotModel", value, &SpecError::default()).error.into_result()?;
    serde_json::from_value(value.clone())
        .map_err(|error| SpecError::one("", shorten(value), error.to_string()))
}

/// Adds those fields of `defaults` that are missing.
fn add_missing(given: &mut Map<String, Value>, defaults: &impl Serialize) {
    let Ok(Value::Object(defaults)) = serde_json::to_value(defaults) else { return };
    for (field, value) in defaults {
        given.entry(field).or_insert(value);
    }
}
