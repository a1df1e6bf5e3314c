//! Several servers with one database.

use std::collections::BTreeSet;
use std::time::Duration;

use store::Location;
use testbed::Cluster;
use tokio_util::sync::CancellationToken;

use crate::lab::Lab;

/// Waits until the cluster of a lab has received a request.
async fn is_asked(lab: &Lab) {
    while lab.server.asked().is_empty() {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// Each server has a cluster of its own, so the test sees which one requests workers.
#[tokio::test]
async fn of_two_servers_one_asks_for_workers_and_the_other_does_when_it_ends() {
    let database = Cluster::shared().database();
    let server = async || {
        let folder = tempfile::tempdir().unwrap();
        let location = Location {
            database: Some(database.url().parse().unwrap()),
            ..Location::in_folder(folder.path())
        };
        Lab::at(&location, folder).await
    };
    let (first, second) = (server().await, server().await);
    let stop = CancellationToken::new();
    let look_every = Duration::from_millis(20);
    let asking = tokio::spawn(first.autoscaler_with(1, look_every).await.run(stop.clone()));
    is_asked(&first).await;
    let waiting = second.autoscaler_with(1, look_every).await;
    let waiting = tokio::spawn(waiting.run(CancellationToken::new()));
    tokio::time::sleep(20 * look_every).await;
    assert_eq!(second.server.asked(), BTreeSet::new());
    stop.cancel();
    asking.await.unwrap();
    is_asked(&second).await;
    waiting.abort();
    let _ = waiting.await;
    first.store.close().await;
    second.store.close().await;
}
