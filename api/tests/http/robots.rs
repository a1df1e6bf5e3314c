//! Robots that the server keeps: added as URDFs or descriptions, looked at, named by specs, deleted.

use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HOST};
use axum::http::{Method, Request};
use serde_json::{Value, json};
use spec::{Digest, RobotModel};

use crate::fixture::{Server, TestResponse, small_training};
use crate::uploads::{FORM, form};

/// An arm of two links, with a finger that slides.
const URDF: &str = r#"<robot name="lamp"><link name="foot"/>
  <link name="lever"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="head"><inertial><mass value="0.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="finger"><inertial><mass value="0.1"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="hip" type="revolute"><parent link="foot"/><child link="lever"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="2"/></joint>
  <joint name="neck" type="revolute"><parent link="lever"/><child link="head"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="10"/></joint>
  <joint name="slide" type="prismatic"><parent link="head"/><child link="finger"/><origin xyz="0 0 0.1"/>
    <limit lower="0" upper="0.1" effort="10" velocity="1"/></joint></robot>"#;

const LOCKED: &str = "/v1/robots?lock=slide=0.05&name=my%20lamp";

async fn send(server: &Server, path: &str, media_type: &str, body: &str) -> TestResponse {
    let request = Request::post(path).header(HOST, "127.0.0.1:7070");
    let request = request.header(CONTENT_TYPE, media_type);
    server.send(request.body(Body::from(body.to_owned())).unwrap()).await
}

pub async fn send_urdf(server: &Server) -> TestResponse {
    send(server, LOCKED, "application/xml", URDF).await
}

pub async fn added(server: &Server) -> Value {
    let answer = send_urdf(server).await;
    assert_eq!(answer.status, 201, "{answer:?}");
    answer.json()
}

fn simulation(model: &Value) -> Value {
    json!({
        "kind": "simulate", "trajectories": 4, "samples": 30, "robot": {"model": model},
        "excitation": {"chirp": {"frequency_hz": {"fixed": 0.3}}},
    })
}

#[tokio::test]
async fn a_urdf_is_kept_once_and_shown_with_its_links_doubts_and_files() {
    let server = Server::start().await;
    let robot = added(&server).await;
    assert_eq!((&robot["name"], &robot["joints"]), (&json!("my lamp"), &json!(2)));
    assert_eq!(robot["urdf"]["base"], "foot");
    assert_eq!(robot["urdf"]["tip"], "finger");
    assert_eq!(robot["urdf"]["locks"], json!({"slide": 0.05}));
    assert_eq!(robot["added_by"], "anyone");
    assert_eq!(robot["links"][1]["parts"], json!(["head", "finger"]));
    assert!((robot["mass_kg"].as_f64().unwrap() - 1.6).abs() < 1e-12, "{robot}");
    let doubts = robot["doubts"].to_string();
    assert!(doubts.contains("joint `neck`") && doubts.contains("velocity"), "{doubts}");
    assert_eq!(robot["digest"], Digest::of_json(&robot["description"]).to_string());

    let path = format!("/v1/robots/{}", robot["id"]);
    assert_eq!(server.json(&path).await, robot);
    let again = send(&server, LOCKED, "text/xml; charset=utf-8", URDF).await;
    assert_eq!((again.status.as_u16(), again.json()), (200, robot.clone()));
    assert_eq!(again.header("location"), path);

    assert_eq!(server.get(&format!("{path}/arm.urdf")).await.text(), URDF);
    let description = server.json(&format!("{path}/description.json")).await;
    assert_eq!(description, robot["description"]);
    let model = server.get(&format!("{path}/arm.xml")).await;
    assert_eq!(model.header("content-type"), "application/xml");
    assert!(model.text().starts_with("<mujoco model=\"lamp\""), "{model:?}");
    let figure = server.get(&format!("{path}/zero-pose.svg")).await;
    assert!(figure.text().starts_with("<svg") && figure.text().contains(">neck</text>"));
    let problem = server.get(&format!("{path}/arm.step")).await.problem(404);
    assert!(problem["detail"].as_str().unwrap().contains("there are description.json, arm.urdf"));
}

#[tokio::test]
async fn a_description_is_kept_too_and_has_no_urdf() {
    let server = Server::start().await;
    let mut description = serde_json::to_value(RobotModel::panda().description()).unwrap();
    description["name"] = json!("two\nlines");
    let text = description.to_string();
    let answer = send(&server, "/v1/robots", "application/json", &text).await;
    assert_eq!(answer.status, 201, "{answer:?}");
    let robot = answer.json();
    assert_eq!((&robot["name"], &robot["joints"]), (&json!("two lines"), &json!(7)));
    assert_eq!((&robot["urdf"], &robot["description"]), (&Value::Null, &description));
    let path = format!("/v1/robots/{}", robot["id"]);
    let problem = server.get(&format!("{path}/arm.urdf")).await.problem(404);
    assert!(problem["detail"].as_str().unwrap().contains("which came as a description"));
    assert_eq!(server.get(&format!("{path}/arm.xml")).await.status, 200);
    assert_eq!(server.get(&format!("{path}/zero-pose.svg")).await.status, 200);

    description["joints"][2]["link"]["mass_kg"] = json!(-1);
    let problem = send(&server, "/v1/robots", "application/json", &description.to_string()).await;
    let violations = problem.problem(422)["violations"].clone();
    assert_eq!(violations[0]["field"], "joints[2].link.mass_kg", "{violations}");
}

#[tokio::test]
async fn what_is_no_robot_is_refused_with_the_part_the_value_and_what_is_allowed() {
    let server = Server::start().await;
    let refused = async |path: &str, media_type: &str, body: &str, status: u16| {
        let answer = send(&server, path, media_type, body).await;
        answer.problem(status)["detail"].as_str().unwrap().to_owned()
    };
    let xml = "application/xml";
    let detail = refused("/v1/robots", xml, URDF, 422).await;
    assert!(detail.contains("joint `slide` between base and tip is prismatic"), "{detail}");
    let broken = URDF.replace("value=\"0.5\"", "value=\"heavy\"");
    let detail = refused(LOCKED, xml, &broken, 422).await;
    assert!(detail.contains("link `head`") && detail.contains("heavy"), "{detail}");
    let detail = refused("/v1/robots?tip=toe", xml, URDF, 422).await;
    assert!(detail.contains("names link `toe`, which is not there"), "{detail}");
    let detail = refused("/v1/robots", xml, "<robot name='a'>\0</robot>", 422).await;
    assert!(detail.contains("line 1"), "{detail}");
    let detail = refused("/v1/robots", xml, "{}", 422).await;
    assert!(detail.contains("not XML") || detail.contains("root"), "{detail}");
    let large = " ".repeat(urdf::MAX_BYTES + 1);
    let detail = refused("/v1/robots", xml, &large, 413).await;
    assert!(detail.contains("4194304 bytes"), "{detail}");
    let detail = refused("/v1/robots", "text/plain", URDF, 415).await;
    assert!(detail.contains("declared as text/plain; send a URDF with Content-Type"), "{detail}");
    let detail = refused("/v1/robots", "application/json", "{", 400).await;
    assert!(detail.contains("line 1, column 2"), "{detail}");
    for (query, expected) in [
        ("lock=slide", "lock is \"slide\", allowed: JOINT=VALUE"),
        ("lock=slide=0&lock=slide=1", "allowed: each joint once"),
        ("mount=1,2", "mount is \"1,2\", allowed: six numbers"),
        ("nearest_physical=yes", "allowed: true, false"),
        ("tip=a&tip=b", "tip is \"b\", allowed: given once"),
        ("name=a%0Ab", "allowed: 1 to 200 characters in one line"),
        ("lok=1", "allowed: name, base, tip, lock, mount, nearest_physical"),
    ] {
        let detail = refused(&format!("/v1/robots?{query}"), xml, URDF, 400).await;
        assert!(detail.contains(expected), "{query}: {detail}");
    }
    let detail = refused("/v1/robots?tip=a", "application/json", "{}", 400).await;
    let allowed = "it is only for a URDF; send the arm's URDF or edit the description instead";
    assert!(detail.contains(allowed), "{detail}");
    assert_eq!(server.json("/v1/robots").await, json!({"robots": [], "next": null}));
}

#[tokio::test]
async fn a_spec_names_a_robot_and_is_the_same_job_as_with_the_description_in_place() {
    let server = Server::start().await;
    let robot = added(&server).await;
    let in_place = server.submitted(&simulation(&robot["description"])).await;
    for model in [json!({"robot": robot["id"]}), json!({"digest": robot["digest"]})] {
        let answer = server.submit(&simulation(&model)).await;
        assert_eq!((answer.status.as_u16(), &answer.json()["id"]), (200, &in_place["id"]));
    }
    assert_eq!(in_place["spec"]["robot"]["model"], robot["description"]);

    let mut streamed = simulation(&json!({"robot": robot["id"]}));
    streamed.as_object_mut().unwrap().remove("trajectories");
    let streamed = json!({"stream": streamed});
    let mut training = small_training(&streamed);
    training["context"] = json!(20);
    let pipeline = json!({"kind": "pipeline", "name": "p", "jobs": {
        "data": simulation(&json!({"digest": robot["digest"]})), "train": training,
    }});
    let answer = server.submit(&pipeline).await;
    assert!(answer.status.is_success(), "{answer:?}");
    let pipeline = answer.json();
    assert_eq!(pipeline["members"][0]["job"], in_place["id"]);
    let train = server.json(&format!("/v1/jobs/{}", pipeline["members"][1]["job"])).await;
    let model = &train["spec"]["data"]["stream"]["robot"]["model"];
    assert_eq!(model, &robot["description"]);
}

#[tokio::test]
async fn a_robot_that_is_not_there_is_named_with_its_field_and_with_those_that_are() {
    let server = Server::start().await;
    let violation = async |model: Value| {
        let problem = server.submit(&simulation(&model)).await.problem(422);
        assert_eq!(problem["violations"].as_array().unwrap().len(), 1, "{problem}");
        problem["violations"][0].clone()
    };
    let none = violation(json!({"robot": 7})).await;
    let expected = json!({
        "field": "robot.model.robot", "value": "7",
        "allowed": "the id of a robot; there is none yet",
    });
    assert_eq!(none, expected);
    let robot = added(&server).await;
    let some = violation(json!({"robot": 7})).await;
    let newest = format!("the id of a robot, the newest are {}", robot["id"]);
    assert_eq!(some["allowed"], newest);
    let digest = Digest::of(b"other");
    let other = violation(json!({"digest": digest})).await;
    assert_eq!(other["field"], "robot.model.digest");
    assert!(other["allowed"].as_str().unwrap().contains(robot["digest"].as_str().unwrap()));
    let wrong = violation(json!({"robot": "lamp"})).await;
    assert_eq!(
        (&wrong["field"], &wrong["value"]),
        (&json!("robot.model.robot"), &json!("\"lamp\""))
    );
}

#[tokio::test]
async fn a_deleted_robot_is_gone_and_its_jobs_keep_their_copies() {
    let server = Server::start().await;
    let robot = added(&server).await;
    let job = server.submitted(&simulation(&json!({"robot": robot["id"]}))).await;
    let path = format!("/v1/robots/{}", robot["id"]);
    let removed = server.request(Method::DELETE, &path, &[]).await;
    assert_eq!(removed.json(), json!({"id": robot["id"], "digest": robot["digest"]}));
    for gone in [path.clone(), format!("{path}/arm.urdf")] {
        let problem = server.get(&gone).await.problem(404);
        assert_eq!(problem["detail"], format!("there is no robot {}", robot["id"]));
    }
    server.request(Method::DELETE, &path, &[]).await.problem(404);
    server.submit(&simulation(&json!({"robot": robot["id"]}))).await.problem(422);
    let job = server.json(&format!("/v1/jobs/{}", job["id"])).await;
    assert_eq!(job["spec"]["robot"]["model"], robot["description"]);
    let again = added(&server).await;
    assert_ne!(again["id"], robot["id"]);
    assert_eq!(again["digest"], robot["digest"]);
}

#[tokio::test]
async fn robots_are_listed_without_their_descriptions() {
    let server = Server::start().await;
    added(&server).await;
    send(&server, "/v1/robots?lock=slide=0&name=Other", "application/xml", URDF).await;
    let listed = server.json("/v1/robots?sort=name").await;
    let names: Vec<&str> =
        listed["robots"].as_array().unwrap().iter().map(|r| r["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["Other", "my lamp"]);
    assert!(listed["robots"][0].get("description").is_none(), "{listed}");
    let first = server.json("/v1/robots?limit=1").await;
    assert_eq!(first["robots"][0]["name"], "Other");
    let next = first["next"].as_str().unwrap();
    let second = server.json(&format!("/v1/robots?limit=1&cursor={next}")).await;
    assert_eq!(second["robots"][0]["name"], "my lamp");
    assert_eq!(server.json("/v1/robots?text=LAMP").await["robots"].as_array().unwrap().len(), 1);
    let problem = server.get("/v1/robots?tag=a").await.problem(400);
    assert!(problem["detail"].as_str().unwrap().contains("query parameter is \"tag\""));
}

#[tokio::test]
async fn the_page_takes_a_urdf_and_a_description() {
    let server = Server::start().await;
    let send_form = async |lock: &str, file: &str, content: &[u8]| {
        let head = format!("; filename=\"{file}\"\r\nContent-Type: application/octet-stream");
        let parts = [
            ("name", "", &b""[..]),
            ("lock", "", lock.as_bytes()),
            ("nearest_physical", "", b""),
            ("file", &head, content),
        ];
        let request = Request::post("/robots").header(HOST, "127.0.0.1:7070");
        server.send(request.header(CONTENT_TYPE, FORM).body(form(&parts)).unwrap()).await
    };
    let answer = send_form("slide=0.05", "lamp.urdf", URDF.as_bytes()).await;
    assert_eq!((answer.status.as_u16(), answer.header("location")), (303, "/robots/1"));
    let robot = server.json("/v1/robots/1").await;
    assert_eq!((&robot["name"], &robot["joints"]), (&json!("lamp"), &json!(2)));
    let mut described = robot["description"].clone();
    described["name"] = json!("another lamp");
    let answer = send_form("", "lamp.JSON", described.to_string().as_bytes()).await;
    assert_eq!(answer.header("location"), "/robots/2", "{answer:?}");

    let refused = send_form("slide", "lamp.urdf", URDF.as_bytes()).await;
    assert_eq!(refused.status, 400, "{refused:?}");
    assert!(refused.text().contains("value=\"slide\""), "{}", refused.text());
    let refused = send_form("", "lamp.urdf", b"<robot").await;
    assert_eq!(refused.status, 422, "{refused:?}");
    let large = " ".repeat(urdf::MAX_BYTES + 1);
    let refused = send_form("", "lamp.urdf", large.as_bytes()).await;
    assert_eq!(refused.status, 413, "{refused:?}");
    assert_eq!(server.json("/v1/robots").await["robots"].as_array().unwrap().len(), 2);
}

#[tokio::test]
async fn the_pages_of_robots_show_them_and_delete_them() {
    let server = Server::start().await;
    assert!(server.get("/robots").await.text().contains("torqued robot add arm.urdf"));
    let robot = added(&server).await;
    let list = server.get("/robots").await;
    assert!(list.text().contains("my lamp") && !list.text().contains("Tags"), "{}", list.text());
    let path = format!("/robots/{}", robot["id"]);
    let page = server.get(&path).await;
    for words in [
        "my lamp",
        "From link foot to link finger.",
        "Joint slide locked at 0.05.",
        "zero-pose.svg",
        "<h2>Joints</h2>",
        "<h2>Links</h2>",
        "head, finger",
        "joint `neck`",
        "arm.urdf",
        "&quot;robot&quot;",
    ] {
        let found =
            page.text().contains(words) || page.text().contains(&words.replace("&quot;", "&#34;"));
        assert!(found, "{words}: {}", page.text());
    }
    let deleted = server.post(&format!("{path}/delete")).await;
    assert_eq!((deleted.status.as_u16(), deleted.header("location")), (303, "/robots"));
    assert_eq!(server.get(&path).await.status, 404);
}
