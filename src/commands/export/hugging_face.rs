//! Exports a checkpoint as a model of the Hugging Face hub: the weights, their configuration, and a
//! model card.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context;
use serde_json::{Value, json};
use wire::Checkpoint;

use super::Done;
use crate::client::Client;
use crate::resource::Reference;

/// The files of a checkpoint that a prediction needs. The optimizer is only for further training.
const FILES: [&str; 2] = ["model.safetensors", "config.json"];

/// Returns the checkpoint in the API's form.
pub async fn export(
    client: &Client,
    id: &Reference,
    out: &Path,
    done: &Done,
) -> anyhow::Result<Value> {
    let checkpoint: Checkpoint = client.get(&format!("/v1/checkpoints/{id}")).await?;
    let files: Vec<_> =
        checkpoint.files.iter().filter(|file| FILES.contains(&file.name.as_str())).collect();
    done.begin(files.iter().map(|file| file.size).sum());
    for file in files {
        client.fetch(file, out, |_| {}).await?;
        done.add(file.size);
    }
    let config = std::fs::read(out.join("config.json")).context("it has no config.json")?;
    let config = serde_json::from_slice(&config).context("its config.json is not JSON")?;
    let path = out.join("README.md");
    std::fs::write(&path, card(&checkpoint, &config))
        .with_context(|| format!("cannot write {}", path.display()))?;
    Ok(json!(checkpoint))
}

/// Fields of models that PyTorch has no twin for, as `LACKS` of python/torqued/lagrangian.py.
const WITHOUT_TWIN: [&str; 5] = ["robot", "chain", "rotor_inertia", "torque_offset", "disturbance"];

fn is_set(value: &Value) -> bool {
    !matches!(value, Value::Null | Value::Bool(false))
}

fn card(checkpoint: &Checkpoint, config: &Value) -> String {
    let Checkpoint { id, architecture, step, digest, .. } = checkpoint;
    let number = |name: &str| config[name].to_string();
    let lacking: Vec<&str> =
        WITHOUT_TWIN.into_iter().filter(|field| is_set(&config["model"][field])).collect();
    let usage = match lacking.as_slice() {
        [] => "```python\nimport torqued\n\nmodel = torqued.load(\".\")    # this folder\n```"
            .to_owned(),
        fields => format!(
            "`torqued.load` has no {architecture} with `{}` in PyTorch. Ask the torqued server that trained it for predictions: \
             `torqued predict {id}`, or `POST /v1/checkpoints/{id}/predict`.",
            fields.join("`, `")
        ),
    };
    let mut text = format!(
        "---\nlibrary_name: torqued\npipeline_tag: robotics\ntags:\n- robotics\n- dynamics\n\
         - in-context-learning\n- {architecture}\n---\n\n\
         # {architecture}, {step} steps\n\n\
         Predicts where the joints of a robot arm will be: it is given {} samples of torques (N·m) and \
         positions (rad) of an arm that it has not seen, and the torques of the next {} samples. \
         {} samples a second.\n\n\
         {usage}\n\n",
        number("context"),
        number("horizon"),
        number("rate_hz"),
    );
    text.push_str("| metric when it was written | |\n|---|---|\n");
    for (key, value) in &checkpoint.metrics {
        let _ = writeln!(text, "| `{key}` | {value} |");
    }
    let _ = write!(
        text,
        "\n{} parameters in `model.safetensors`; `config.json` says what they mean.\n\n\
         Trained by torqued {}. SHA-256 of the training's spec: `{digest}`.\n",
        number("parameters"),
        config["versions"]["torqued"].as_str().unwrap_or("of an unknown version"),
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_begins_with_what_the_hub_reads_and_names_what_the_model_is_given() {
        let checkpoint = Checkpoint {
            id: 1,
            job: 2,
            run: 3,
            name: None,
            note: None,
            tags: Vec::new(),
            job_tags: Vec::new(),
            aliases: Vec::new(),
            step: 200,
            is_final: true,
            is_best: true,
            is_last: true,
            metrics: [("validation/rmse_deg".to_owned(), 4.5)].into(),
            data: None,
            digest: spec::Digest::of(b"spec"),
            architecture: "robomorph".to_owned(),
            files: Vec::new(),
            created_at: String::new(),
        };
        let mut config = json!({
            "context": 40, "horizon": 20, "rate_hz": 60, "parameters": 7,
            "versions": {"torqued": "0.1.0"},
        });
        let text = card(&checkpoint, &config);
        assert!(text.starts_with("---\nlibrary_name: torqued\n"), "{text}");
        for words in [
            "given 40 samples",
            "next 20 samples",
            "| `validation/rmse_deg` | 4.5 |",
            "torqued.load(\".\")",
        ] {
            assert!(text.contains(words), "no {words:?} in {text}");
        }

        // PyTorch has no law that is told its arm.
        config["model"] = json!({"robot": {"model": "panda"}, "disturbance": false});
        let text = card(&checkpoint, &config);
        assert!(!text.contains("import torqued") && text.contains("torqued predict 1"), "{text}");
        assert!(text.contains("with `robot` in PyTorch"), "{text}");
    }
}
