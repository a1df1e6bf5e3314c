//! Databases of before the first release, whose schema came from many files, run the files of after it
//! alone, and have the same schema as new ones then. `sqlite_16.sql` and `postgres_13.sql` are dumps of such databases
//! with one job.

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, PgConnection, SqliteConnection};
use store::{Access, JobId, Location, Store};
use tempfile::TempDir;
use testbed::Cluster;

const SQLITE: &str = include_str!("sqlite_16.sql");
const POSTGRES: &str = include_str!("postgres_13.sql");

/// A folder with the mark of both stores among their objects.
fn marked_folder() -> TempDir {
    const MARK: &str = r#"{"store": "84d8c1ad539f4bd3b5d3400a9d5f839f"}"#;
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("objects")).unwrap();
    std::fs::write(folder.path().join("objects/store.json"), MARK).unwrap();
    folder
}

/// Version and checksum of each row of the bookkeeping.
type Applied = Vec<(i64, Vec<u8>)>;

const SELECT_APPLIED: &str = "SELECT version, checksum FROM _sqlx_migrations ORDER BY version";

/// The versions of the rows that came later.
fn versions_behind(before: &Applied, after: &Applied) -> Vec<i64> {
    after[before.len()..].iter().map(|(version, _)| *version).collect()
}

#[tokio::test]
async fn a_data_folder_from_before_the_release_opens_and_has_the_schema_of_a_new_one() {
    let (old, new) = (marked_folder(), tempfile::tempdir().unwrap());
    let connect = async |folder: &TempDir| {
        let file = folder.path().join("torqued.sqlite");
        SqliteConnectOptions::new().filename(file).create_if_missing(true).connect().await.unwrap()
    };
    let mut connection = connect(&old).await;
    sqlx::raw_sql(SQLITE).execute(&mut connection).await.unwrap();
    let before: Applied = sqlx::query_as(SELECT_APPLIED).fetch_all(&mut connection).await.unwrap();
    assert_eq!(before.len(), 15);
    connection.close().await.unwrap();

    for access in [Access::Server, Access::Worker] {
        let store = Store::open(old.path(), access).await.unwrap();
        assert_eq!(store.job(JobId(1)).await.unwrap().name, "old");
        store.close().await;
    }
    Store::open(new.path(), Access::Server).await.unwrap().close().await;
    let (mut old, mut new) = (connect(&old).await, connect(&new).await);
    let after: Applied = sqlx::query_as(SELECT_APPLIED).fetch_all(&mut old).await.unwrap();
    assert_eq!(before, after[..before.len()], "nothing ran again");
    assert_eq!(versions_behind(&before, &after), [17, 18]);
    assert_eq!(sqlite_schema(&mut old).await, sqlite_schema(&mut new).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_postgresql_from_before_the_release_opens_and_has_the_schema_of_a_new_one() {
    let [old, new] = [(); 2].map(|()| Cluster::shared().database());
    let dir = marked_folder();
    let at = |url: String| Location {
        database: Some(url.parse().unwrap()),
        ..Location::in_folder(dir.path())
    };
    let mut connection = PgConnection::connect(&old.url()).await.unwrap();
    sqlx::raw_sql(POSTGRES).execute(&mut connection).await.unwrap();
    let before: Applied = sqlx::query_as(SELECT_APPLIED).fetch_all(&mut connection).await.unwrap();
    assert_eq!(before.len(), 12);

    for access in [Access::Server, Access::Worker] {
        let store = Store::open_at(&at(old.url()), access).await.unwrap();
        assert_eq!(store.job(JobId(1)).await.unwrap().name, "old");
        store.close().await;
    }
    let after: Applied = sqlx::query_as(SELECT_APPLIED).fetch_all(&mut connection).await.unwrap();
    assert_eq!(before, after[..before.len()], "nothing ran again");
    assert_eq!(versions_behind(&before, &after), [14, 15]);

    let elsewhere = tempfile::tempdir().unwrap();
    let new_store = Location { folder: elsewhere.path().to_owned(), ..at(new.url()) };
    Store::open_at(&new_store, Access::Server).await.unwrap().close().await;
    let mut new = PgConnection::connect(&new.url()).await.unwrap();
    assert_eq!(postgres_schema(&mut connection).await, postgres_schema(&mut new).await);
}

/// Every table, index and trigger of a data folder. SQLite keeps the text of each statement that made
/// one, so comments, line breaks and the order of columns are taken out. Plans of queries depend on
/// the order of a table's indexes.
async fn sqlite_schema(connection: &mut SqliteConnection) -> Vec<String> {
    let statements: Vec<String> = sqlx::query_scalar(
        "SELECT sql FROM sqlite_schema WHERE sql IS NOT NULL AND name <> '_sqlx_migrations' \
         AND name NOT LIKE 'sqlite%' \
         ORDER BY type, tbl_name, CASE type WHEN 'index' THEN rowid END, name",
    )
    .fetch_all(connection)
    .await
    .unwrap();
    assert!(statements.len() > 80, "{statements:?}");
    statements.iter().map(|statement| canonical(statement)).collect()
}

fn canonical(statement: &str) -> String {
    let code = statement.lines().map(|line| line.split("--").next().unwrap_or_default());
    let words: Vec<&str> = code.flat_map(str::split_whitespace).collect();
    let statement = words.join(" ").replace('"', "").replace(" ,", ",");
    if !statement.starts_with("CREATE TABLE") {
        return statement;
    }
    let (name, rest) = statement.split_once('(').unwrap();
    let (definitions, kind) = rest.rsplit_once(')').unwrap();
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for letter in definitions.chars() {
        depth += i32::from(letter == '(') - i32::from(letter == ')');
        if letter == ',' && depth == 0 {
            parts.push(String::new());
        } else {
            parts.last_mut().unwrap().push(letter);
        }
    }
    let mut parts: Vec<&str> = parts.iter().map(|part| part.trim()).collect();
    parts.sort_unstable();
    format!("{} ({}){kind}", name.trim(), parts.join(", "))
}

/// Every column, constraint, index, trigger, function and sequence of a database.
async fn postgres_schema(connection: &mut PgConnection) -> Vec<String> {
    let lines: Vec<String> = sqlx::query_scalar(
        "SELECT concat_ws(' ', 'column', table_name, column_name, data_type, is_nullable, \
         column_default, collation_name, identity_generation, identity_start) AS line \
         FROM information_schema.columns WHERE table_schema = 'public' \
         UNION ALL SELECT concat_ws(' ', 'constraint', CAST(conrelid AS regclass), conname, \
         pg_get_constraintdef(oid)) FROM pg_constraint \
         WHERE connamespace = CAST('public' AS regnamespace) \
         UNION ALL SELECT indexdef FROM pg_indexes WHERE schemaname = 'public' \
         UNION ALL SELECT pg_get_triggerdef(oid) FROM pg_trigger WHERE NOT tgisinternal \
         UNION ALL SELECT pg_get_functiondef(oid) FROM pg_proc \
         WHERE pronamespace = CAST('public' AS regnamespace) \
         UNION ALL SELECT concat_ws(' ', 'sequence', sequencename, start_value, increment_by) \
         FROM pg_sequences WHERE schemaname = 'public' ORDER BY line",
    )
    .fetch_all(connection)
    .await
    .unwrap();
    assert!(lines.len() > 400, "{lines:?}");
    lines
}
