//! The digests of presets are pinned, because most people run presets. Changing how they are
//! written must not change what they mean.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use serde_json::json;
use spec::{PresetPlace, parse, presets};

/// One line per preset with its name and its digest. A model's digest is that of a training with
/// it.
fn digests() -> String {
    let mut lines: Vec<String> = presets()
        .iter()
        .map(|preset| {
            let job = match preset.place {
                PresetPlace::Job => json!({"preset": preset.name}),
                PresetPlace::Model => json!({
                    "kind": "train", "data": {"digest": "0".repeat(64)},
                    "model": {"preset": preset.name}, "steps": 1,
                }),
            };
            let digest = parse(job.to_string().as_bytes()).unwrap().digest();
            format!("{} {digest}\n", preset.name)
        })
        .collect();
    lines.sort();
    lines.concat()
}

/// Writes the digests anew if `UPDATE` is set.
#[test]
fn the_digests_of_all_presets_are_pinned() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/preset_digests.txt");
    let found = digests();
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &found).unwrap();
    }
    let pinned = std::fs::read_to_string(&path).unwrap();
    assert_eq!(found, pinned, "a preset is new or means something else; UPDATE=1 pins it");
}
