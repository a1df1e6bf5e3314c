//! Robots: descriptions that specs name by an id or a digest. Each description is kept once, under its
//! digest, with the URDF that it came from.
//!
//! Jobs keep a copy of the description that they use. A robot can therefore be deleted at any time.

use serde_json::Value;
use spec::{Digest, RobotDescription};

use crate::database::column::json;
use crate::database::patience::patiently;
use crate::database::query::{Query, from_row, sql};
use crate::database::{Scope, Transaction};
use crate::lists::labels::folded;
use crate::lists::listing::{FoundRows, LISTING, Listed};
use crate::lists::statements::listing::{begin_and_order, filter_moments};
use crate::queue::task_end::Completion;
use crate::{Fence, JobId, Listing, Page, RobotId, Sort, Store, StoreError, Timestamp, boxed};

macro_rules! select_robot {
    ($rest:expr) => {
        concat!(
            "SELECT id, name, digest, description, options, doubts, job, added_by, created_at \
             FROM robot ",
            $rest
        )
    };
}

/// A robot, without the text of its URDF.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Its id.
    pub id: RobotId,
    /// The name that it was added with.
    pub name: String,
    /// The digest of the description's canonical JSON.
    pub digest: Digest,
    /// A [`RobotDescription`]. Another version of torqued may have written it.
    pub description: Value,
    /// How its URDF was read; `None` if it came as a description.
    pub options: Option<Value>,
    /// The doubts of reading.
    pub doubts: Vec<String>,
    /// The job that identified it.
    pub job: Option<JobId>,
    /// Who added it; `None` if a job did.
    pub added_by: Option<String>,
    /// When it was first added.
    pub created_at: Timestamp,
}

/// A robot to keep.
#[derive(Clone, Debug)]
pub struct NewRobot {
    /// A name in one line.
    pub name: String,
    /// A description that was checked.
    pub description: RobotDescription,
    /// The URDF that it came from.
    pub source: Option<RobotSource>,
    /// The doubts of reading.
    pub doubts: Vec<String>,
    /// The job that identified it.
    pub job: Option<JobId>,
    /// Who adds it; `None` if a job does.
    pub added_by: Option<String>,
}

/// A URDF, and how it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotSource {
    /// The text. PostgreSQL keeps no NUL.
    pub urdf: String,
    /// The options as JSON.
    pub options: Value,
}

/// The outcome of adding a robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AddedRobot {
    /// The robot with this description.
    pub id: RobotId,
    /// Whether it is new.
    pub created: bool,
}

impl Store {
    /// Keeps a robot. If its description is known, the answer is the robot that has it; it gets the
    /// URDF if it has none.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn add_robot(&self, new: &NewRobot) -> Result<AddedRobot, StoreError> {
        let mut tx = self.begin(Scope::Rows, "adding a robot").await?;
        let added = tx.add_robot(new).await?;
        tx.commit().await?;
        Ok(added)
    }

    /// Ends the task that identified an arm, and keeps the arm, in one transaction.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn commit_robot(
        &self,
        fence: Fence,
        new: &NewRobot,
        result: &Value,
    ) -> Result<(), StoreError> {
        patiently!({
            let mut completion =
                Completion::begin(self, fence, "keeping an identified arm").await?;
            completion.tx.add_robot(new).await?;
            completion.end(Some(result)).await
        })
    }

    /// # Errors
    /// When there is no such robot.
    #[boxed]
    pub async fn robot(&self, id: RobotId) -> Result<Robot, StoreError> {
        sql(select_robot!("WHERE id = $1"))
            .bind(id)
            .optional(&mut self.read("reading a robot"))
            .await?
            .ok_or_else(|| missing(id))
    }

    /// The robot whose description has this digest.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn robot_by_digest(&self, digest: Digest) -> Result<Option<Robot>, StoreError> {
        sql(select_robot!("WHERE digest = $1"))
            .bind(digest)
            .optional(&mut self.read("reading a robot"))
            .await
    }

    /// The URDF that a robot was read from; `None` if it came as a description.
    ///
    /// # Errors
    /// When there is no such robot.
    #[boxed]
    pub async fn robot_source(&self, id: RobotId) -> Result<Option<RobotSource>, StoreError> {
        let row = sql("SELECT source, options FROM robot WHERE id = $1")
            .bind(id)
            .optional_row(&mut self.read("reading the URDF of a robot"))
            .await?
            .ok_or_else(|| missing(id))?;
        let (urdf, options): (Option<String>, Option<Value>) =
            (row.get("source")?, row.get("options")?);
        Ok(urdf.zip(options).map(|(urdf, options)| RobotSource { urdf, options }))
    }

    /// A page of the list of robots. It can be filtered by text and moments, and sorted by
    /// [`Sort::Created`] and [`Sort::Name`].
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_robots(&self, listing: &Listing) -> Result<Listed<Robot>, StoreError> {
        let places = self.read(LISTING).positions(page(listing), listing).await?;
        let found = FoundRows::of(places, listing);
        let rows = sql(select_robot!("WHERE id IN {ids $1}"))
            .bind(json(&found.ids))
            .all(&mut self.read(LISTING))
            .await?;
        Ok(found.with(rows, |robot: &Robot| robot.id.0))
    }

    /// Robots, newest first.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn robots(&self, page: Page) -> Result<Vec<Robot>, StoreError> {
        Ok(self.list_robots(&page.into()).await?.items)
    }

    /// Forgets a robot. Jobs keep their copies of its description.
    ///
    /// # Errors
    /// When there is no such robot.
    #[boxed]
    pub async fn remove_robot(&self, id: RobotId) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "deleting a robot").await?;
        let removed = sql("DELETE FROM robot WHERE id = $1").bind(id).changed(&mut tx).await?;
        if removed == 0 {
            return Err(missing(id));
        }
        tx.commit().await
    }
}

fn missing(id: RobotId) -> StoreError {
    StoreError::not_found("robot", id.to_string())
}

/// The statement that finds a page.
fn page(listing: &Listing) -> Query {
    let key = if listing.sort == Sort::Name { "robot.name{by_bytes}" } else { "robot.id" };
    let mut query = sql(format!("SELECT robot.id AS id, {key} AS sort_key FROM robot WHERE "));
    let words = listing.words().unwrap_or_default();
    query.push("({find}(robot.searched, ").push_bind(words).push(") > 0)");
    filter_moments(&mut query, "robot", listing);
    begin_and_order(&mut query, "robot", key, listing);
    query
}

impl Transaction {
    /// Like [`Store::add_robot`], as a part of this transaction.
    pub async fn add_robot(&mut self, new: &NewRobot) -> Result<AddedRobot, StoreError> {
        // Numbers and texts can always be written.
        let description = serde_json::to_value(&new.description).unwrap_or_default();
        let digest = Digest::of_json(&description);
        if let Some(id) = self.robot_with(digest).await? {
            self.complete_robot(id, new).await?;
            return Ok(AddedRobot { id, created: false });
        }
        let (source, options) =
            new.source.as_ref().map(|source| (source.urdf.as_str(), &source.options)).unzip();
        let created: Option<RobotId> = sql(
            "INSERT INTO robot (name, searched, digest, description, source, options, doubts, \
             job, added_by, created_at) VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, {now}) \
             ON CONFLICT (digest) DO NOTHING RETURNING id",
        )
        .bind(&new.name)
        .bind(folded(&new.name))
        .bind(digest)
        .bind(description)
        .bind(source)
        .bind(options)
        .bind(Value::from(new.doubts.as_slice()))
        .bind(new.job)
        .bind(&new.added_by)
        .optional(self)
        .await?;
        match created {
            Some(id) => Ok(AddedRobot { id, created: true }),
            // Somebody else has added it meanwhile.
            None => {
                let id = self.robot_with(digest).await?;
                let id = id.ok_or_else(|| StoreError::not_found("robot", digest.to_string()))?;
                self.complete_robot(id, new).await?;
                Ok(AddedRobot { id, created: false })
            }
        }
    }

    async fn robot_with(&mut self, digest: Digest) -> Result<Option<RobotId>, StoreError> {
        sql("SELECT id FROM robot WHERE digest = $1").bind(digest).optional(self).await
    }

    /// Gives a robot the URDF that it lacks.
    async fn complete_robot(&mut self, id: RobotId, new: &NewRobot) -> Result<(), StoreError> {
        let Some(source) = &new.source else { return Ok(()) };
        sql("UPDATE robot SET source = $1, options = $2, doubts = $3 WHERE id = $4 \
             AND source IS NULL")
        .bind(&source.urdf)
        .bind(&source.options)
        .bind(Value::from(new.doubts.as_slice()))
        .bind(id)
        .run(self)
        .await
    }
}

from_row!(Robot {
    id, name, digest, description, options, job, added_by, created_at,
    ..row =>
    doubts: row.json("doubts")?,
});
