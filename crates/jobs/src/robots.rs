//! The robots of the server that a spec names. Their descriptions take the place of their names before
//! the spec is read, so that its digest covers their numbers, and a stored spec names none.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use serde_json::Value;
use spec::{JobSpec, NamedRobot, RobotReference, SpecError};
use store::{Robot, RobotId, Store, StoreError};

use crate::SubmissionError;
use crate::references::{newest, no_such};

/// Bytes of all descriptions that take the place of names in one spec, as JSON.
const MAX_DESCRIPTION_BYTES: usize = 4 << 20;

/// A spec as it was sent.
#[derive(Debug)]
pub struct SentSpec {
    /// Its JSON.
    pub value: Value,
    /// Bytes of its text, with the descriptions that were put into it.
    pub bytes: usize,
}

impl SentSpec {
    /// Reads the JSON of a spec. It takes the longer the larger the text is, so an asynchronous
    /// caller gives it a thread that may block.
    ///
    /// # Errors
    /// [`SubmissionError::Json`] when it is none.
    pub fn read(text: &[u8]) -> Result<Self, SubmissionError> {
        let value = spec::read_json(text).map_err(SubmissionError::Json)?;
        Ok(Self { value, bytes: text.len() })
    }

    /// The spec with the descriptions of the robots that it names.
    ///
    /// # Errors
    /// [`SubmissionError::Spec`] when there is no such robot, or the descriptions are too large
    /// together.
    pub async fn with_robots(mut self, store: &Store) -> Result<Self, SubmissionError> {
        let mut known: BTreeMap<RobotReference, (Value, usize)> = BTreeMap::new();
        let mut added = 0;
        for NamedRobot { field, robot, place } in spec::named_robots(&mut self.value)? {
            let (description, bytes) = match known.entry(robot) {
                Entry::Occupied(found) => found.into_mut(),
                Entry::Vacant(place) => {
                    let description = find(store, robot, &field).await?.description;
                    let bytes = description.to_string().len();
                    place.insert((description, bytes))
                }
            };
            added += *bytes;
            if added > MAX_DESCRIPTION_BYTES {
                let mebibytes = MAX_DESCRIPTION_BYTES >> 20;
                let allowed = format!(
                    "robots whose descriptions have {mebibytes} MiB together, counted once for each \
                     place; split the spec"
                );
                return Err(SpecError::one(field, robot.to_string(), allowed).into());
            }
            *place = description.clone();
        }
        self.bytes += added;
        Ok(self)
    }

    /// Reads the spec. Like [`Self::read`], it takes the longer the larger the text is.
    ///
    /// # Errors
    /// [`SubmissionError::Spec`] when it is refused.
    pub fn parse(self) -> Result<JobSpec, SubmissionError> {
        Ok(spec::parse_json(self.value)?)
    }
}

async fn find(store: &Store, robot: RobotReference, field: &str) -> Result<Robot, SubmissionError> {
    match robot {
        RobotReference::Id(id) => match store.robot(RobotId(id)).await {
            Err(StoreError::NotFound { .. }) => {
                let newest = store.robots(newest()).await?;
                Err(no_such(field, id, "robot", newest.iter().map(|robot| robot.id.0)))
            }
            found => Ok(found?),
        },
        RobotReference::Digest(digest) => {
            if let Some(found) = store.robot_by_digest(digest).await? {
                return Ok(found);
            }
            let newest = store.robots(newest()).await?;
            let digests: Vec<String> =
                newest.iter().map(|robot| robot.digest.to_string()).collect();
            let allowed = match digests.as_slice() {
                [] => "the digest of a robot of this server; there is none yet".to_owned(),
                digests => {
                    format!("the digest of a robot, those of the newest are {}", digests.join(", "))
                }
            };
            Err(SpecError::one(field, digest.to_string(), allowed).into())
        }
    }
}
