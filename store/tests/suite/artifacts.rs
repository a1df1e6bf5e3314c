use spec::Digest;
use store::NewArtifact;

use super::{Fixture, simulate, train};

pub async fn an_artifact_is_replaced_under_its_name(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let run = task.run.unwrap();
    let put = async |bytes: &'static str| {
        let new =
            NewArtifact { name: "loss.svg", media_type: "image/svg+xml", bytes: bytes.into() };
        f.store.put_artifact(task.fence, new).await.unwrap();
        f.store.artifact(run, "loss.svg").await.unwrap()
    };
    let first = put("<svg/>").await;
    let second = put("<svg></svg>").await;
    assert_eq!(second.object.sha256, Digest::of(b"<svg></svg>"));
    assert_eq!((second.media_type.as_str(), second.object.size), ("image/svg+xml", 11));
    assert!(f.store.read_object(&first.object).await.is_err(), "replaced bytes are gone");
    let same = put("<svg></svg>").await;
    assert_eq!(f.store.read_object(&same.object).await.unwrap(), "<svg></svg>");
    assert_eq!(f.store.artifacts(&[run]).await.unwrap().len(), 1);
    let error = f.store.artifact(run, "x").await.unwrap_err();
    assert_eq!(error.to_string(), format!("there is no artifact x of run {run}"));
}

pub async fn every_training_and_evaluation_has_a_run(f: Fixture) {
    let submitted = f.submit(super::pipeline(1)).await;
    let members = f.members(submitted.job).await;
    let runs = f.store.runs(None, store::Page::default()).await.unwrap();
    assert_eq!(runs.iter().map(|run| run.job).collect::<Vec<_>>(), [members[2], members[1]]);
    let trainings = f.store.runs(Some("train"), store::Page::default()).await.unwrap();
    assert_eq!(trainings.len(), 1);
    let run = f.store.run_of_job(members[1]).await.unwrap();
    assert_eq!((run.id, run.name.as_str()), (trainings[0].id, "train"));
    assert_eq!(f.store.run(run.id).await.unwrap().job, members[1]);
}
