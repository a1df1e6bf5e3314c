use std::time::Duration;

use serde_json::{Value, json};
use spec::{Digest, RobotDescription, RobotModel};
use store::{
    AddedRobot, DeletionOrder, Direction, Listing, NewRobot, Page, Respect, Ripe, Robot, RobotId,
    RobotSource, Sort, StoreError,
};

use super::texts::UNUSUAL;
use super::{Fixture, simulate};

/// The Panda with another load.
fn description(mass_kg: f64) -> RobotDescription {
    let mut description = RobotModel::panda().description().clone();
    description.joints[6].link.mass_kg = mass_kg;
    description
}

fn described(name: &str, mass_kg: f64) -> NewRobot {
    NewRobot {
        name: name.to_owned(),
        description: description(mass_kg),
        source: None,
        doubts: Vec::new(),
        job: None,
        added_by: Some("ana".to_owned()),
    }
}

fn source() -> RobotSource {
    RobotSource { urdf: UNUSUAL.to_owned(), options: json!({"tip": "tool0", "locks": {"a": 0.1}}) }
}

async fn names(f: &Fixture, listing: Listing) -> Vec<String> {
    let listed = f.store.list_robots(&listing).await.unwrap();
    listed.items.into_iter().map(|robot| robot.name).collect()
}

pub async fn a_robot_comes_back_as_it_was_added(f: Fixture) {
    let doubts = vec!["joint `a`: no limit".to_owned(), UNUSUAL.to_owned()];
    let new = NewRobot { source: Some(source()), doubts, ..described(UNUSUAL, 1.0 / 3.0) };
    let AddedRobot { id, created } = f.store.add_robot(&new).await.unwrap();
    assert!(created);
    let robot = f.store.robot(id).await.unwrap();
    let json = serde_json::to_value(&new.description).unwrap();
    let expected = Robot {
        id,
        name: UNUSUAL.to_owned(),
        digest: Digest::of_json(&json),
        description: json,
        options: Some(source().options),
        doubts: new.doubts,
        job: None,
        added_by: Some("ana".to_owned()),
        created_at: robot.created_at,
    };
    assert_eq!(robot, expected);
    let now = f.store.now().await.unwrap();
    assert!(robot.created_at <= now, "{} and {now}", robot.created_at);
    assert_eq!(f.store.robot_source(id).await.unwrap(), Some(source()));
    assert_eq!(f.store.robot_by_digest(robot.digest).await.unwrap(), Some(robot));
    assert_eq!(f.store.robot_by_digest(Digest::of(b"other")).await.unwrap(), None);
}

pub async fn a_description_is_kept_once_and_gets_the_urdf_that_it_lacks(f: Fixture) {
    let first = f.store.add_robot(&described("first", 1.0)).await.unwrap();
    let again = f.store.add_robot(&described("again", 1.0)).await.unwrap();
    assert_eq!(again, AddedRobot { id: first.id, created: false });
    assert_eq!(f.store.robot_source(first.id).await.unwrap(), None);
    let doubts = vec!["a doubt".to_owned()];
    let with_urdf = NewRobot { source: Some(source()), doubts, ..described("third", 1.0) };
    assert_eq!(f.store.add_robot(&with_urdf).await.unwrap(), again);
    let robot = f.store.robot(first.id).await.unwrap();
    assert_eq!((robot.name.as_str(), robot.options), ("first", Some(source().options)));
    assert_eq!(robot.doubts, ["a doubt"]);
    // The first URDF stays.
    let other = RobotSource { urdf: "<robot/>".to_owned(), options: Value::Null };
    f.store.add_robot(&NewRobot { source: Some(other), ..with_urdf }).await.unwrap();
    assert_eq!(f.store.robot_source(first.id).await.unwrap(), Some(source()));
    assert_eq!(f.store.robots(Page::default()).await.unwrap().len(), 1);
}

pub async fn of_many_who_add_one_description_one_makes_it(f: Fixture) {
    let adding = (0..8).map(|_| {
        let store = f.store.clone();
        tokio::spawn(async move { store.add_robot(&described("arm", 1.0)).await.unwrap() })
    });
    let adding: Vec<_> = adding.collect();
    let mut added = Vec::new();
    for task in adding {
        added.push(task.await.unwrap());
    }
    assert!(added.iter().all(|one| one.id == added[0].id), "{added:?}");
    assert_eq!(added.iter().filter(|one| one.created).count(), 1);
}

pub async fn robots_are_listed_in_pages_and_found_by_their_names(f: Fixture) {
    for (mass_kg, name) in (1_u8..).zip(["b", "A lift", "c", "a", "Left arm"]) {
        f.store.add_robot(&described(name, f64::from(mass_kg))).await.unwrap();
    }
    let newest = ["Left arm", "a", "c", "A lift", "b"];
    assert_eq!(names(&f, Listing::default()).await, newest);
    for (sort, direction, expected) in [
        (Sort::Created, Direction::Descending, newest),
        (Sort::Created, Direction::Ascending, ["b", "A lift", "c", "a", "Left arm"]),
        (Sort::Name, Direction::Ascending, ["A lift", "Left arm", "a", "b", "c"]),
        (Sort::Name, Direction::Descending, ["c", "b", "a", "Left arm", "A lift"]),
    ] {
        let mut listing = Listing { sort, direction, limit: 2, ..Listing::default() };
        let mut found = Vec::new();
        loop {
            let page = f.store.list_robots(&listing).await.unwrap();
            found.extend(page.items.into_iter().map(|robot| robot.name));
            listing.after = page.end;
            if listing.after.is_none() {
                break;
            }
        }
        assert_eq!(found, expected, "{sort:?} {direction:?}");
    }
    let text = |text: &str| Listing { text: Some(text.to_owned()), ..Listing::default() };
    assert_eq!(names(&f, text("LEFT")).await, ["Left arm"]);
    assert_eq!(names(&f, text("l")).await, ["Left arm", "A lift"]);
    assert!(names(&f, text("%")).await.is_empty());
    let before = Listing { before: Some(3), ..Listing::default() };
    assert_eq!(names(&f, before).await, ["A lift", "b"]);
}

pub async fn a_robot_that_was_removed_is_gone_and_can_be_added_again(f: Fixture) {
    let AddedRobot { id, .. } = f.store.add_robot(&described("arm", 1.0)).await.unwrap();
    f.store.remove_robot(id).await.unwrap();
    for error in [
        f.store.robot(id).await.unwrap_err(),
        f.store.robot_source(id).await.unwrap_err(),
        f.store.remove_robot(id).await.unwrap_err(),
    ] {
        assert!(matches!(error, StoreError::NotFound { .. }), "{error}");
        assert_eq!(error.to_string(), format!("there is no robot {id}"));
    }
    let again = f.store.add_robot(&described("arm", 1.0)).await.unwrap();
    assert!(again.created && again.id > id, "no id is used twice");
}

pub async fn a_robot_outlives_the_job_that_identified_it(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let new = NewRobot { job: Some(job), added_by: None, ..described("arm", 1.0) };
    let id: RobotId = f.store.add_robot(&new).await.unwrap().id;
    assert_eq!(f.store.robot(id).await.unwrap().job, Some(job));
    f.store.cancel(job).await.unwrap();
    let order = DeletionOrder { respect: Respect::All, keep: Duration::ZERO, reason: None };
    f.store.delete(job.into(), &order).await.unwrap();
    f.store.purge(Ripe::After(Duration::ZERO)).await.unwrap();
    let robot = f.store.robot(id).await.unwrap();
    assert_eq!((robot.job, robot.added_by), (None, None));
}
