//! Merges fields over those of a preset.

use serde_json::Value;

/// Fields that hold one of several choices. They are replaced as a whole, because merging would mix
/// two choices.
pub(crate) const REPLACED_WHOLE: [&str; 7] =
    ["frequency_hz", "data", "integrator", "checkpoints", "path", "residual", "law"];

/// Merges objects field by field. Every other value replaces the one before. That includes `null`,
/// which is a value in specs and does not remove anything.
pub(crate) fn merge(base: &mut Value, over: Value) {
    match (base, over) {
        (Value::Object(base), Value::Object(over)) => {
            for (key, value) in over {
                match base.get_mut(&key) {
                    Some(slot) if !REPLACED_WHOLE.contains(&key.as_str()) => merge(slot, value),
                    _ => {
                        base.insert(key, value);
                    }
                }
            }
        }
        (base, over) => *base = over,
    }
}
