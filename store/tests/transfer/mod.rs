//! A transfer moves a store from one place to another and back, completely or not at all.

mod backup;
mod filled;
mod interrupted;
mod refusals;

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, ConnectOptions, SqliteConnection};
use store::{
    Access, EventFilter, Location, Reaper, Store, StoreContents, StoreError, Transfer,
    TransferProgress,
};
use tempfile::TempDir;
use testbed::{Cluster, TestDatabase};

use self::filled::filled;
use crate::s3_server::S3Server;
use crate::suite::{alone, simulate};

/// Places for stores. The first one has a store.
struct Places {
    first: TempDir,
    between: TempDir,
    last: TempDir,
    database: TestDatabase,
    bucket: S3Server,
}

impl Places {
    async fn filled() -> Self {
        let folder = || tempfile::tempdir().unwrap();
        let (database, bucket) = (Cluster::shared().database(), S3Server::start());
        Self { first: filled().await, between: folder(), last: folder(), database, bucket }
    }

    fn first(&self) -> Location {
        Location::in_folder(self.first.path())
    }

    /// PostgreSQL, with objects in a folder.
    fn postgres(&self) -> Location {
        let database = Some(self.database.url().parse().unwrap());
        Location { database, ..Location::in_folder(self.between.path()) }
    }

    /// PostgreSQL, with objects in a bucket.
    fn postgres_and_s3(&self) -> Location {
        Location { objects: Some(S3Server::url("arm")), ..self.postgres() }
    }

    fn last(&self) -> Location {
        Location::in_folder(self.last.path())
    }

    async fn transfer(&self, from: &Location, to: &Location) -> Result<StoreContents, StoreError> {
        let transfer = self.prepare(from, to).await?;
        let (contents, progress) = (transfer.contents(), TransferProgress::default());
        transfer.run(&progress).await?;
        assert_eq!((progress.bytes(), progress.rows()), (contents.bytes, contents.rows));
        assert_eq!(progress.compared(), contents.rows);
        Ok(contents)
    }

    async fn prepare(&self, from: &Location, to: &Location) -> Result<Transfer, StoreError> {
        Transfer::prepare(from, to, &self.bucket.options(&[])).await
    }

    async fn open(&self, location: &Location, access: Access) -> Result<Store, StoreError> {
        match &location.objects {
            None => Store::open_at(location, access).await,
            Some(url) => {
                let objects = url.connect(&self.bucket.options(&[])).await?;
                Store::open_with_objects(location, access, objects).await
            }
        }
    }

    fn objects(&self, location: &Location) -> Vec<(String, Vec<u8>)> {
        match &location.objects {
            None => files(&location.folder.join("objects")),
            Some(_) => files(&self.bucket.file("arm")),
        }
    }

    /// Moves the first store to another place and from there to the last one.
    async fn there_and_back(&self, between: &Location) {
        let (rows, objects) = (dump(self.first.path()).await, self.objects(&self.first()));
        let contents = self.transfer(&self.first(), between).await.unwrap();
        assert_eq!(contents.objects, objects.len() as u64);
        assert_eq!(
            contents.bytes,
            objects.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>()
        );
        assert_eq!(dump(self.first.path()).await, rows, "the source is as it was");
        self.transfer(between, &self.last()).await.unwrap();
        for place in [self.first(), between.clone(), self.last()] {
            assert!(self.objects(&place) == objects, "other objects in {place}");
        }
        let found = dump(self.last.path()).await;
        for (found, expected) in found.iter().zip(&rows) {
            assert_eq!(found, expected);
        }
        assert_eq!(found.len(), rows.len());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn events_stay_where_they_happened_and_their_ids_are_of_no_others() {
    let places = Places::filled().await;
    let (from, to) = (places.first(), places.postgres());
    let store = places.open(&from, Access::Server).await.unwrap();
    let (_, newest) = store.kept_events().await.unwrap();
    store.close().await;
    drop(store);
    places.transfer(&from, &to).await.unwrap();
    let store = places.open(&to, Access::Server).await.unwrap();
    let events = store.events(&EventFilter::default(), 0, i64::MAX, 10).await.unwrap();
    assert_eq!(events, []);
    let (oldest, _) = store.kept_events().await.unwrap();
    assert!(oldest > newest, "{oldest} and {newest}");
}

async fn sqlite(folder: &Path) -> SqliteConnection {
    SqliteConnectOptions::new().filename(folder.join("torqued.sqlite")).connect().await.unwrap()
}

/// Table and name of every column of a data folder, without the store's own tables.
async fn columns(connection: &mut SqliteConnection) -> Vec<(String, String)> {
    sqlx::query_as(
        "SELECT found.name, of.name FROM sqlite_schema AS found JOIN pragma_table_info(found.name) AS of \
         WHERE found.type = 'table' AND found.name NOT LIKE 'sqlite%' AND found.name <> '_sqlx_migrations' \
         ORDER BY found.name, of.name",
    )
    .fetch_all(connection)
    .await
    .unwrap()
}

/// Tables that describe a database and do not move.
const STAYING: [&str; 5] = ["store", "probe", "server", "session", "event"];

/// Every row of every table, in SQLite's quoted form.
async fn dump(folder: &Path) -> Vec<String> {
    let mut connection = sqlite(folder).await;
    let columns = columns(&mut connection).await;
    let tables: BTreeSet<&String> = columns.iter().map(|(table, _)| table).collect();
    let mut lines = Vec::new();
    for table in tables.into_iter().filter(|table| !STAYING.contains(&table.as_str())) {
        let of_table = columns.iter().filter(|(of, _)| of == table);
        let quoted: Vec<String> = of_table.map(|(_, name)| format!("quote(\"{name}\")")).collect();
        let quoted = quoted.join(" || ', ' || ");
        let select = format!("SELECT {quoted} AS line FROM \"{table}\" ORDER BY line");
        let rows: Vec<String> =
            sqlx::query_scalar(AssertSqlSafe(select)).fetch_all(&mut connection).await.unwrap();
        lines.extend(rows.into_iter().map(|row| format!("{table}: {row}")));
    }
    lines
}

/// Path and bytes of every file below a folder, without the store's own mark.
fn files(root: &Path) -> Vec<(String, Vec<u8>)> {
    let (mut folders, mut files) = (vec![root.to_owned()], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().display().to_string();
            if path.is_dir() {
                folders.push(path);
            } else if name != "store.json" {
                files.push((name, std::fs::read(path).unwrap()));
            }
        }
    }
    files.sort();
    files
}

/// This fails for a migration that adds a table or a column to one database only, or a table that
/// is not listed here. A move refuses a data folder with an unknown table.
#[tokio::test(flavor = "multi_thread")]
async fn both_databases_have_the_same_tables_and_columns_and_a_filled_store_has_values_in_all() {
    let places = Places::filled().await;
    let mut connection = sqlite(places.first.path()).await;
    let columns = columns(&mut connection).await;
    Store::open_at(&places.postgres(), Access::Server).await.unwrap().close().await;
    let listed = Cluster::shared().psql(
        places.database.name(),
        "SELECT table_name || '.' || column_name FROM information_schema.columns \
         WHERE table_schema = 'public' AND table_name <> '_sqlx_migrations'",
    );
    let in_postgres: BTreeSet<&str> = listed.lines().collect();
    let names: Vec<String> =
        columns.iter().map(|(table, name)| format!("{table}.{name}")).collect();
    assert_eq!(names.iter().map(String::as_str).collect::<BTreeSet<_>>(), in_postgres);

    // The engine's records of a database's workers and the sessions of its users do not move.
    let moves = |table: &str| !["engine", "placement", "session"].contains(&table);
    for (table, name) in columns.into_iter().filter(|(table, _)| moves(table)) {
        let select = format!("SELECT count(\"{name}\") FROM \"{table}\"");
        let values: i64 =
            sqlx::query_scalar(AssertSqlSafe(select)).fetch_one(&mut connection).await.unwrap();
        assert!(values > 0, "nothing in {table}.{name} moves in these tests");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_store_is_the_same_row_by_row_and_byte_by_byte_after_postgresql_with_a_folder() {
    let places = Places::filled().await;
    places.there_and_back(&places.postgres()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_store_is_the_same_row_by_row_and_byte_by_byte_after_postgresql_with_a_bucket() {
    let places = Places::filled().await;
    places.there_and_back(&places.postgres_and_s3()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_store_is_the_same_row_by_row_and_byte_by_byte_after_another_folder() {
    let places = Places::filled().await;
    places.there_and_back(&Location::in_folder(places.between.path())).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ids_go_on_after_the_largest_that_the_source_gave() {
    let places = Places::filled().await;
    let mut connection = sqlite(places.first.path()).await;
    let later = "UPDATE sqlite_sequence SET seq = 1000 WHERE name = 'job'";
    sqlx::query(later).execute(&mut connection).await.unwrap();
    drop(connection);
    places.transfer(&places.first(), &places.postgres()).await.unwrap();
    let store = Store::open_at(&places.postgres(), Access::Server).await.unwrap();
    let new = store.submit(alone(simulate(77))).await.unwrap();
    assert_eq!(new.job.to_string(), "1001");
    store.close().await;
    places.transfer(&places.postgres(), &places.last()).await.unwrap();
    let store = Store::open_at(&places.last(), Access::Server).await.unwrap();
    let again = store.submit(alone(simulate(77))).await.unwrap();
    assert!(again.reused && again.job == new.job);
    let next = store.submit(alone(simulate(78))).await.unwrap();
    assert_eq!(next.job.to_string(), "1002");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_task_of_a_dead_worker_is_taken_back_where_the_store_moved_to() {
    let places = Places::filled().await;
    places.transfer(&places.first(), &places.postgres_and_s3()).await.unwrap();
    let store = places.open(&places.postgres_and_s3(), Access::Server).await.unwrap();
    let mut reaper = Reaper::new(store.clone(), Duration::from_secs(1));
    assert_eq!(reaper.look(Duration::ZERO).await.unwrap().queued, 1);
}
