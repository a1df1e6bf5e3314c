//! Pages of lists.

use crate::StoreError;
use spec::ValidationMetric;

use crate::database::Reading;
use crate::database::query::{Query, Row, sql};
use crate::results::datasets::standing;
use crate::{Direction, ItemKind, Key, Listing, Position, Sort};

impl Reading<'_> {
    /// The positions of the rows of a page, and of one more row if there is one.
    pub async fn places(
        &mut self,
        item: ItemKind,
        listing: &Listing,
    ) -> Result<Vec<Position>, StoreError> {
        self.positions(page("", item, listing), listing).await
    }

    /// The positions of the rows that `query` finds, from its columns `id` and `sort_key`.
    pub async fn positions(
        &mut self,
        query: Query,
        listing: &Listing,
    ) -> Result<Vec<Position>, StoreError> {
        let rows = query.rows(self).await?;
        let place = |row: &Row| {
            let key = match listing.sort {
                Sort::Name => Key::Text(row.get("sort_key")?),
                Sort::Rmse => Key::Number(row.get("sort_key")?),
                _ => Key::Integer(row.get("sort_key")?),
            };
            Ok(Position { key, id: row.get("id")? })
        };
        rows.iter().map(place).collect()
    }
}

/// The statement that finds a page. `start` may put EXPLAIN before it.
pub(crate) fn page(start: &str, item: ItemKind, listing: &Listing) -> Query {
    let table = item.as_str();
    let key = key(item, listing);
    // A scan that needs nothing of jobs reads a third of the pages without them.
    let is_of_jobs = listing.kind.is_some()
        || listing.state.is_some()
        || listing.words().is_some()
        || key.contains("job.");
    let join = match item {
        ItemKind::Run | ItemKind::Dataset | ItemKind::Checkpoint if is_of_jobs => {
            format!(" JOIN job ON job.id = {table}.job")
        }
        _ => String::new(),
    };
    let select = format!(
        "{start}SELECT {table}.id AS id, {key} AS sort_key FROM {table}{join} WHERE {table}.deleted_at IS NULL"
    );
    let mut query = sql(select);
    filter(&mut query, item, listing);
    begin_and_order(&mut query, table, &key, listing);
    query
}

/// Adds the beginning of the page, its order by `key` and its length.
pub(crate) fn begin_and_order(query: &mut Query, table: &str, key: &str, listing: &Listing) {
    let (beyond, direction) = match listing.direction {
        Direction::Ascending => (">", "ASC"),
        Direction::Descending => ("<", "DESC"),
    };
    if let Some(Position { key: last, id }) = &listing.after {
        if listing.sort == Sort::Created {
            query.push(format!(" AND {table}.id {beyond} ")).push_bind(*id);
        } else {
            // An index of the key answers the first condition.
            query.push(format!(" AND {key} {beyond}= "));
            push_key(query, last);
            query.push(format!(" AND ({key} {beyond} "));
            push_key(query, last);
            query.push(format!(" OR {table}.id {beyond} ")).push_bind(*id).push(")");
        }
    }
    query.push(format!(" ORDER BY {key} {direction}, {table}.id {direction} LIMIT "));
    query.push_bind(i64::from(listing.limit()) + 1);
}

/// The SQL expression of a sort key. If there is an index of the key, it must be the same.
fn key(item: ItemKind, listing: &Listing) -> String {
    let table = item.as_str();
    match (listing.sort, item) {
        (Sort::Created, _) => format!("{table}.id"),
        (Sort::Finished, _) => "COALESCE(job.finished_at, 9223372036854775807)".to_owned(),
        (Sort::Name, ItemKind::Job) => "COALESCE(job.given_name, job.name){by_bytes}".to_owned(),
        (Sort::Name, _) => {
            format!("COALESCE({table}.given_name, job.given_name, job.name){{by_bytes}}")
        }
        (Sort::Priority, _) => "job.priority".to_owned(),
        (Sort::Trajectories, ItemKind::Dataset) => "dataset.trajectories".to_owned(),
        (Sort::Step, ItemKind::Checkpoint) => "checkpoint.step".to_owned(),
        (Sort::Trajectories | Sort::Step, _) => format!("{table}.id"),
        (Sort::Rmse, _) => missing_last(&rmse(item), listing.direction),
    }
}

/// The error of an item in degrees; `NULL` if it has none. No index has it: a page reads the error
/// of every item that the filters leave.
fn rmse(item: ItemKind) -> String {
    let validation = ValidationMetric::RmseDeg.key();
    match item {
        // The result of an evaluation's last task is a `wire::EvaluationResult`.
        ItemKind::Job => "(SELECT {number result headline best 0 rmse_deg} FROM task \
                        WHERE task.job = job.id ORDER BY stage DESC, ordinal DESC LIMIT 1)"
            .to_owned(),
        ItemKind::Run => format!(
            "(SELECT value FROM metric_latest WHERE metric_latest.run = run.id AND key = '{validation}')"
        ),
        ItemKind::Checkpoint => format!("{{number checkpoint.metrics {validation}}}"),
        ItemKind::Dataset => "NULL".to_owned(),
    }
}

/// A number of at least 0 as a sort key. `NULL` and infinity, which a cursor cannot hold, come last
/// in both directions.
fn missing_last(number: &str, direction: Direction) -> String {
    let last = match direction {
        Direction::Ascending => "1e308",
        Direction::Descending => "-1.0",
    };
    format!(
        "COALESCE(CASE WHEN {number} < 1e308 THEN {number} END, CAST({last} AS DOUBLE PRECISION))"
    )
}

fn push_key(query: &mut Query, key: &Key) {
    match key {
        Key::Integer(number) => query.push_bind(*number),
        Key::Number(number) => query.push_bind(*number),
        Key::Text(text) => query.push_bind(text.clone()),
    };
}

fn filter(query: &mut Query, item: ItemKind, listing: &Listing) {
    let table = item.as_str();
    if listing.experiments_alone {
        query.push(" AND ").push("{is_experiment}");
    }
    if let Some(kind) = &listing.kind {
        query.push(" AND job.kind = ").push_bind(kind.clone());
    }
    if let Some(state) = &listing.state {
        let of_item = if item == ItemKind::Dataset { standing!() } else { "job.state" };
        query.push(format!(" AND {of_item} = ")).push_bind(state.clone());
    }
    for tag in &listing.tags {
        let having = format!(" AND ({table}.id IN (SELECT {table} FROM {table}_tag WHERE tag = ");
        query.push(having).push_bind(tag.clone()).push(")");
        if item != ItemKind::Job {
            query.push(format!(" OR {table}.job IN (SELECT job FROM job_tag WHERE tag = "));
            query.push_bind(tag.clone()).push(")");
        }
        if item == ItemKind::Checkpoint {
            query.push(
                " OR checkpoint.id IN (SELECT checkpoint FROM checkpoint_alias WHERE alias = ",
            );
            query.push_bind(tag.clone()).push(")");
        }
        query.push(")");
    }
    if let Some(words) = listing.words() {
        find(query, item, &words);
    }
    if let Some(data) = listing.data {
        let job = if item == ItemKind::Job { "id" } else { "job" };
        query.push(format!(
            " AND {table}.{job} IN (SELECT job_input.job FROM job_input \
             JOIN dataset AS source ON source.digest = job_input.digest WHERE source.id = "
        ));
        query.push_bind(data).push(")");
    }
    filter_moments(query, table, listing);
}

/// Adds the search for words: in names and notes, in the model that a job trains, in the names of a pipeline's members,
/// and for digests that begin with them.
fn find(query: &mut Query, item: ItemKind, words: &str) {
    const LEAST_OF_DIGEST: usize = 6;

    let own = format!("{}.searched", item.as_str());
    let mut places = vec![own.as_str(), "{field job.spec 'model'}"];
    if item != ItemKind::Job {
        places.push("job.searched");
    }
    query.push(" AND (");
    for place in places {
        query.push(format!("{{find}}({place}, ")).push_bind(words.to_owned()).push(") > 0 OR ");
    }
    if item == ItemKind::Job {
        query.push(
            "job.id IN (SELECT pipeline FROM pipeline_member WHERE {find}(LOWER(pipeline_member.name), ",
        );
        query.push_bind(words.to_owned()).push(") > 0) OR ");
    }
    let is_digest = words.len() >= LEAST_OF_DIGEST && words.chars().all(|c| c.is_ascii_hexdigit());
    if is_digest {
        query.push("{find}(job.digest, ").push_bind(words.to_owned()).push(") = 1)");
    } else {
        query.push("1 = 0)");
    }
}

/// Adds the filters that every list has.
pub(crate) fn filter_moments(query: &mut Query, table: &str, listing: &Listing) {
    if let Some(since) = listing.since {
        query.push(format!(" AND {table}.created_at >= ")).push_bind(since);
    }
    if let Some(until) = listing.until {
        query.push(format!(" AND {table}.created_at < ")).push_bind(until);
    }
    // Without this condition, SQLite would also read an index of experiments alone from its end.
    if let Some(before) = listing.before {
        query.push(format!(" AND {table}.id < ")).push_bind(before);
    }
}
