//! Contents of datasets: single trajectories, summaries, figures.

use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Int32Type};
use arrow_ipc::reader::StreamReader;
use axum::http::Method;
use serde_json::json;

use crate::fixture::{Server, TestResponse, small_simulation};
use crate::tables::value;

/// 25 trajectories of 40 samples in shards of 10, with velocities.
async fn with_dataset() -> Server {
    let server = Server::start().await;
    let spec = json!({
        "preset": "D1-multisine", "trajectories": 25, "shard_trajectories": 10, "samples": 40,
        "observations": {"joint_velocities": true, "end_effector_pose": true},
    });
    server.submitted(&spec).await;
    server.work().await;
    server
}

#[tokio::test]
async fn a_trajectory_has_its_channels_units_times_and_robot() {
    let server = with_dataset().await;
    let trajectory = server.json("/v1/datasets/1/trajectories/13").await;
    assert_eq!((&trajectory["dataset"], &trajectory["trajectory"]), (&json!(1), &json!(13)));
    assert_eq!((&trajectory["shard"], &trajectory["samples"]), (&json!(1), &json!(40)));
    assert_eq!(trajectory["time_s"].as_array().unwrap().len(), 40);
    assert_eq!(trajectory["time_s"][30], json!(0.5));
    let columns = trajectory["columns"].as_object().unwrap();
    assert_eq!(columns.len(), 28);
    // `u1` is the third column, `q1` the tenth.
    for (name, position) in [("u1", 2), ("q1", 9), ("qd7", 22), ("ee_qw", 29)] {
        let values: Vec<f32> = serde_json::from_value(columns[name].clone()).unwrap();
        let expected: Vec<f64> = (0..40).map(|step| value(position, 13, step)).collect();
        assert_eq!(values.into_iter().map(f64::from).collect::<Vec<_>>(), expected, "{name}");
    }
    let units = &trajectory["units"];
    assert_eq!((&units["u1"], &units["q1"]), (&json!("N·m"), &json!("rad")));
    assert_eq!((&units["qd1"], &units["ee_x"]), (&json!("rad/s"), &json!("m")));
    assert_eq!(units["ee_qw"], json!(null));
    let robot = &trajectory["robot"];
    assert_eq!((&robot["trajectory"], &robot["family"]), (&json!(13), &json!("multisine")));
    assert!(robot.as_object().unwrap().contains_key("mass_7"));
}

fn read(stream: &TestResponse) -> RecordBatch {
    assert_eq!(stream.status, 200, "{stream:?}");
    assert_eq!(stream.header("content-type"), "application/vnd.apache.arrow.stream");
    let batches: Vec<_> = StreamReader::try_new(stream.body.as_ref(), None)
        .unwrap()
        .collect::<Result<_, _>>()
        .unwrap();
    assert_eq!(batches.len(), 1);
    batches[0].clone()
}

#[tokio::test]
async fn an_arrow_stream_has_the_same_samples_with_units_and_robot() {
    let server = with_dataset().await;
    let path = "/v1/datasets/1/trajectories/24";
    let accept = [("accept", "application/vnd.apache.arrow.stream;q=0.9, */*;q=0.1")];
    let batch = read(&server.request(Method::GET, path, &accept).await);
    assert_eq!(batch, read(&server.get(&format!("{path}?format=arrow")).await));
    assert_eq!((batch.num_rows(), batch.num_columns()), (40, 30));
    assert_eq!(batch["trajectory"].as_primitive::<Int32Type>().value(39), 24);
    let q7 = batch["q7"].as_primitive::<Float32Type>().value(39);
    assert_eq!(f64::from(q7), value(15, 24, 39));
    let schema = batch.schema();
    assert_eq!(schema.field_with_name("u3").unwrap().metadata()["unit"], "N·m");
    let robot: serde_json::Value =
        serde_json::from_str(&schema.metadata()["torqued.robot"]).unwrap();
    assert_eq!(robot["trajectory"], 24);

    let json = server.request(Method::GET, &format!("{path}?format=json"), &accept).await;
    assert_eq!(json.header("content-type"), "application/json");
    server.get(&format!("{path}?format=parquet")).await.problem(400);
}

#[tokio::test]
async fn a_trajectory_that_is_not_there_names_those_that_are() {
    let server = with_dataset().await;
    for tail in ["", "/figure.svg", "/figure.csv"] {
        let path = format!("/v1/datasets/1/trajectories/25{tail}");
        let detail = server.get(&path).await.problem(404)["detail"].clone();
        assert_eq!(detail, "there is no trajectory 25 in dataset 1: there are 0 to 24");
        server.get(&format!("/v1/datasets/2/trajectories/0{tail}")).await.problem(404);
        server.get(&format!("/v1/datasets/1/trajectories/-1{tail}")).await.problem(400);
    }
}

#[tokio::test]
async fn finished_shards_can_be_looked_into_while_others_are_missing() {
    let server = Server::start().await;
    let spec = json!({"preset": "D1-multisine", "trajectories": 25, "shard_trajectories": 10});
    server.submitted(&spec).await;
    let detail = server.get("/v1/datasets/1/trajectories/0").await.problem(404)["detail"].clone();
    assert!(detail.as_str().unwrap().ends_with("no shard is finished yet"), "{detail}");
    server.finish(&server.claim().await.unwrap()).await;
    assert_eq!(server.json("/v1/datasets/1/trajectories/9").await["shard"], 0);
    let detail = server.get("/v1/datasets/1/trajectories/10").await.problem(404)["detail"].clone();
    assert!(detail.as_str().unwrap().ends_with("the finished shards have 0 to 9"));
    let summary = server.json("/v1/datasets/1/summary").await;
    assert_eq!((&summary["trajectories"], &summary["rejected"]), (&json!(10), &json!(3)));
}

#[tokio::test]
async fn a_figure_of_a_trajectory_has_a_panel_for_each_quantity_and_a_table() {
    let server = with_dataset().await;
    let svg = server.get("/v1/datasets/1/trajectories/3/figure.svg").await;
    assert_eq!(svg.header("content-type"), "image/svg+xml");
    for text in ["Torques", "Positions", "Velocities", "Orientation of the hand", "joint 7", "N·m"]
    {
        assert!(svg.text().contains(text), "{text} is not drawn");
    }
    let csv = server.get("/v1/datasets/1/trajectories/3/figure.csv").await;
    let lines: Vec<&str> = csv.text().lines().collect();
    assert_eq!(lines.len(), 41);
    assert!(lines[0].starts_with("time_s,u1 (N·m),u2 (N·m),"), "{}", lines[0]);
    assert!(lines[31].starts_with(&format!("0.5,{},", value(2, 3, 30))), "{}", lines[31]);
}

#[tokio::test]
async fn a_summary_covers_all_shards() {
    let server = with_dataset().await;
    let summary = server.json("/v1/datasets/1/summary").await;
    assert_eq!((&summary["trajectories"], &summary["summarized"]), (&json!(25), &json!(25)));
    assert_eq!((&summary["samples"], &summary["rejected"]), (&json!(1000), &json!(9)));
    let q1 = &summary["channels"][7];
    assert_eq!((&q1["name"], &q1["unit"]), (&json!("q1"), &json!("rad")));
    assert_eq!((&q1["min"], &q1["mean"]), (&json!(-0.5), &json!(0.25)));
    let spectrum = &summary["spectra"][0];
    assert_eq!((&spectrum["signal"], &spectrum["unit"]), (&json!("u"), &json!("(N·m)²/Hz")));
    assert_eq!(spectrum["density"], json!([0.0, 4.0, 2.0, 1.0]));
    let svg = server.get("/v1/datasets/1/spectrum.svg").await;
    assert!(svg.text().contains("(N·m)²/Hz") && svg.text().contains("rad²/Hz"), "{svg:?}");
    let csv = server.get("/v1/datasets/1/spectrum.csv").await;
    // The means, and joint 2.
    assert_eq!(csv.text().lines().count(), 1 + 3 * 4);
    assert!(csv.text().contains("q2,rad²/Hz,0.15,4"), "{csv:?}");
    let arms = summary["arms"].as_array().unwrap();
    let told: Vec<_> = arms.iter().map(|arm| (&arm["name"], &arm["unit"], &arm["mean"])).collect();
    assert_eq!(told[2], (&json!("payload_mass"), &json!("kg"), &json!(1.5)));
    let page = server.get("/datasets/1").await;
    for part in [
        "<h2>Arms by joint</h2>",
        "<h2>Arms</h2>",
        "link mass",
        "2.5 <span class=\"interval\">[0, 5]</span>",
    ] {
        assert!(page.text().contains(part), "{part}: {page:?}");
    }
}

/// Regression: the decoder panics on invalid pages.
#[tokio::test]
async fn a_damaged_shard_is_told_as_such_and_the_others_can_still_be_read() {
    let server = with_dataset().await;
    let shards = server.store.shards(store::DatasetId(1)).await.unwrap();
    let path = server.object(&shards[0].contents.trajectories.path);
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0xff;
    std::fs::write(&path, bytes).unwrap();
    std::fs::remove_file(server.object(&shards[1].contents.robots.path)).unwrap();
    for index in [0, 10] {
        let problem =
            server.get(&format!("/v1/datasets/1/trajectories/{index}")).await.problem(500);
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(&format!("shard {} of dataset 1", index / 10)), "{detail}");
    }
    assert_eq!(server.get("/v1/datasets/1/trajectories/20").await.status, 200);
    assert_eq!(server.get("/datasets/1?trajectory=0").await.status, 200);
}

#[tokio::test]
async fn more_readers_than_places_are_all_answered() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    server.work().await;
    let get = |index: usize| {
        let path = format!("/v1/datasets/1/trajectories/{}", index % 10);
        let server = &server;
        async move { (server.get(&path).await.status, path) }
    };
    let answers = futures::future::join_all((0..40).map(get)).await;
    assert!(answers.iter().all(|(status, _)| *status == 200), "{answers:?}");
}
