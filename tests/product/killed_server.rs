//! A server that dies by SIGKILL leaves no worker behind, and the next one continues.

use crate::pipeline::results;
use crate::product::{Product, member, small_pipeline, until_gone};

#[tokio::test]
async fn the_workers_of_a_killed_server_end_and_the_next_server_goes_on() {
    let undisturbed_data = tempfile::tempdir().unwrap();
    let undisturbed = Product::start(undisturbed_data.path());
    let id = undisturbed.submit(&small_pipeline()).await;
    let pipeline = undisturbed.succeeded(id).await;
    let expected = results(&undisturbed, &pipeline).await;
    drop(undisturbed);

    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&small_pipeline()).await;
    let pipeline = product.get(&format!("/v1/jobs/{id}")).await;
    let training = member(&pipeline, "train");
    product.job_when(training, |job| job["state"] == "running").await;
    let workers = product.workers();
    assert_eq!(workers.len(), 1);
    product.end_by("KILL");

    until_gone(workers[0]).await;

    let product = Product::start(data.path());
    let pipeline = product.succeeded(id).await;
    assert_eq!(results(&product, &pipeline).await, expected);
}
