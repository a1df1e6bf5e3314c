//! A disk that runs full fails a job with one clear reason and damages nothing.

use std::path::Path;
use std::process::Command;

use crate::product::{Product, small_pipeline};

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
