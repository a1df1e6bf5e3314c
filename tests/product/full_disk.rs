//! A disk that runs full fails a job with one clear reason and damages nothing.

use std::path::Path;
use std::process::Command;

use serde_json::json;

use crate::product::{Product, run_to_end, small_pipeline, torqued};

/// A small file system in memory, as long as this lives.
struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    /// `None` where mounting is not permitted.
    fn mount(size: &str) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"])
            .arg(folder.path())
            .output();
        mounted.is_ok_and(|output| output.status.success()).then_some(Self(folder))
    }

    fn path(&self) -> &Path {
        self.0.path()
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(self.path()).status();
    }
}

#[tokio::test]
async fn a_full_disk_fails_the_job_and_the_server_goes_on_when_there_is_room_again() {
    let Some(disk) = SmallDisk::mount("24m") else {
        eprintln!("not run: mounting a file system is not permitted here");
        return;
    };
    let data = disk.path().join("data");
    let product = Product::start(&data);
    let filler = disk.path().join("filler");
    let mut spec = small_pipeline()["jobs"]["train-set"].clone();
    spec["trajectories"] = 40_000.into();
    spec["shard_trajectories"] = 5_000.into();
    spec["samples"] = 400.into();
    let large = product.submit(&spec).await;
    let job = product.finished(large).await;
    assert_eq!(job["state"], "failed", "{job:#}");
    let reason = job["error"].as_str().unwrap();
    assert!(reason.contains("disk full"), "{reason}");
    product.get("/healthz").await;
    assert!(!filler.exists());

    spec["trajectories"] = 100.into();
    let small = product.submit(&spec).await;
    product.succeeded(small).await;
}

#[test]
fn a_full_disk_stops_a_simulation_into_a_folder_and_room_lets_it_go_on() {
    let Some(disk) = SmallDisk::mount("24m") else {
        eprintln!("not run: mounting a file system is not permitted here");
        return;
    };
    let (out, filler) = (disk.path().join("folder"), disk.path().join("filler"));
    std::fs::write(&filler, vec![7; 16 << 20]).unwrap();
    let spec = disk.path().join("spec.json");
    let simulation = json!({
        "preset": "D1-chirp", "trajectories": 6000, "samples": 60, "shard_trajectories": 1000,
    });
    std::fs::write(&spec, simulation.to_string()).unwrap();
    let simulate =
        || run_to_end(torqued(&["simulate", "--spec"]).arg(&spec).arg("--out").arg(&out));
    let (code, _, errors) = simulate();
    assert_eq!(code, Some(1), "{errors}");
    assert!(errors.contains("disk full"), "{errors}");
    let names: Vec<_> =
        std::fs::read_dir(&out).unwrap().map(|it| it.unwrap().file_name()).collect();
    assert!(names.len() > 2, "{names:?}");
    assert!(names.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{names:?}");

    std::fs::remove_file(&filler).unwrap();
    let (code, output, errors) = simulate();
    assert_eq!(code, Some(0), "{output}{errors}");
    let (code, output, errors) = run_to_end(torqued(&["verify"]).arg(&out));
    assert_eq!(code, Some(0), "{output}{errors}");
}
