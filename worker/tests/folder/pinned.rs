//! The bytes of datasets, pinned. A change to the construction of robots, kernels or files must not
//! change the result of a spec.
//!
//! A digest covers every file of the folder except `dataset.json`. It may change only with the
//! science or with the version of the Parquet writer, and then the changelog says so.

use serde_json::{Value, json};
use spec::Digest;
use store::DatasetDescription;

use super::fixture::{digests, make, spec_with};

/// The digest of the digests of all data files.
fn pinned(fields: &Value) -> String {
    let dir = tempfile::tempdir().unwrap();
    make(dir.path(), &spec_with(fields));
    let mut files = digests(dir.path());
    files.remove(DatasetDescription::FILE_NAME).unwrap();
    assert_eq!(files.len(), 6, "{files:?}");
    Digest::of_json(&json!(files)).to_string()
}

#[test]
fn a_plain_dataset_has_its_pinned_bytes() {
    assert_eq!(
        pinned(&json!({})),
        "bc156b20321f190caa6849d37428b0fb3b63421b7afd77088cb7db191ab9d2b5"
    );
}

#[test]
fn a_dataset_in_double_precision_has_its_pinned_bytes() {
    assert_eq!(
        pinned(&json!({"precision": "f64", "seed": 5})),
        "06c3b3c710766d7e1103a589471c2e6a41ca6e1c9fb78e216d36a0e74336bde0"
    );
}

#[test]
fn a_dataset_with_all_that_can_be_drawn_and_recorded_has_its_pinned_bytes() {
    let fields = json!({
        "seed": 12,
        "observations": {"joint_velocities": true, "end_effector_pose": true},
        "robot": {
            "gravity": "compensated",
            "geometry_fraction": 0.05,
            "armature_fraction": 0.2,
            "friction": {},
            "payload": {"mass_kg": [0.5, 2.0]},
        },
    });
    assert_eq!(pinned(&fields), "091a1053a87cdceddca6e6af0bf0f4fb5060faaf78490903f0482fedb674b91d");
}

#[test]
fn a_dataset_by_the_papers_choices_has_its_pinned_bytes() {
    let fields = json!({
        "seed": 3,
        "robot": {"inertia_scheme": "per-entry"},
        "integrator": {"scheme": "reference"},
        "rejection": {"position_margin_rad": 0.3},
    });
    assert_eq!(pinned(&fields), "67568ce0dc0c6abdcce04f9d2debbae3dd10b585840a9ca417fb23a39c7ee64e");
}

#[test]
fn a_dataset_by_runge_kutta_without_rejection_has_its_pinned_bytes() {
    let fields = json!({
        "seed": 4,
        "robot": {"gravity": "on"},
        "integrator": {"scheme": "rk4", "substeps": 12},
        "rejection": {"position_margin_rad": null},
    });
    assert_eq!(pinned(&fields), "699fc6675ba92bea7c54f58d933b90ec038d96263ad3a18414faab53e5cf7b26");
}
