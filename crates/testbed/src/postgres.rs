//! A private PostgreSQL, run by the programs of Debian's package.

use std::fs::File;
use std::io;
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use tempfile::TempDir;

/// Time for a server to answer after its start.
const READY_WITHIN: Duration = Duration::from_secs(60);

/// Seconds that a shared cluster outlives its last user.
const LINGER_SECONDS: u32 = 10;

/// Whether a commit survives a power cut. Tests have no power cuts. Benchmarks measure what users
/// get.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// It survives, as for a user: the server syncs every commit to disk.
    Full,
    /// It does not: nothing is synced.
    None,
}

/// A database cluster and the server that runs it.
#[derive(Debug)]
pub struct Cluster {
    folder: PathBuf,
    /// Keeps the cluster alive.
    _keep: Keep,
}

#[derive(Debug)]
#[expect(dead_code, reason = "both are held to be dropped")]
enum Keep {
    /// A private cluster with its folder.
    Own(Server, TempDir),
    /// The lock that all users of a shared cluster hold.
    Shared(File),
}

/// A running server, which ends when it is dropped.
#[derive(Debug)]
struct Server(Child);

/// An empty database. Dropping this drops the database.
#[derive(Debug)]
pub struct TestDatabase {
    cluster: Arc<Cluster>,
    name: String,
}

impl Cluster {
    /// Starts a cluster for this caller only.
    ///
    /// # Panics
    /// If PostgreSQL is not installed or does not start.
    pub fn start(durability: Durability) -> Self {
        let folder = TempDir::with_prefix("torqued-postgres-").expect("a temporary folder");
        let path = folder.path().to_owned();
        init(&path).expect("a database cluster");
        let server = Server(postgres(&path, durability).spawn().expect("a server"));
        wait_until_ready(&path);
        Self { folder: path, _keep: Keep::Own(server, folder) }
    }

    /// The cluster that all tests of this user share. The first one starts it. It ends a while
    /// after the last one.
    ///
    /// # Panics
    /// If PostgreSQL is not installed or does not start.
    pub fn shared() -> Arc<Self> {
        let user = std::fs::metadata("/proc/self").map_or(0, |metadata| metadata.uid());
        let folder = std::env::temp_dir().join(format!("torqued-shared-postgres-{user}"));
        std::fs::create_dir_all(&folder).expect("a folder");
        let users = lock_file(&folder, "users");
        // The lock for starting or stopping the server.
        let turn = lock_file(&folder, "turn");
        turn.lock().expect("a lock");
        users.lock_shared().expect("a lock");
        if !is_ready(&folder) {
            let data = folder.join("data");
            if data.exists() {
                std::fs::remove_dir_all(data).expect("an old cluster to go");
            }
            init(&folder).expect("a database cluster");
            assert!(
                supervised(&folder).status().is_ok_and(|status| status.success()),
                "a server starts"
            );
            wait_until_ready(&folder);
        }
        drop(turn);
        Arc::new(Self { folder, _keep: Keep::Shared(users) })
    }

    /// Creates an empty database.
    ///
    /// # Panics
    /// If the server fails.
    pub fn database(self: &Arc<Self>) -> TestDatabase {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("test_{}_{number}", std::process::id());
        self.psql("postgres", &format!("CREATE DATABASE {name}"));
        TestDatabase { cluster: Arc::clone(self), name }
    }

    /// Executes statements as the superuser.
    ///
    /// # Panics
    /// If they fail.
    pub fn psql(&self, database: &str, statements: &str) -> String {
        let output = program("psql")
            .args([
                "--no-psqlrc",
                "--quiet",
                "--tuples-only",
                "--no-align",
                "--set=ON_ERROR_STOP=1",
            ])
            .args(["--username=postgres", "--dbname", database, "--command", statements])
            .arg("--host")
            .arg(&self.folder)
            .output()
            .expect("psql, of Debian's package postgresql");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{statements}: {error}");
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    }

    /// Stops the server like a crash.
    ///
    /// # Panics
    /// If the cluster is shared.
    pub fn crash(&mut self) {
        let Keep::Own(server, _) = &mut self._keep else { panic!("others use this cluster") };
        let immediately = ["--mode=immediate", "stop", "--pgdata"];
        let stopped =
            as_postgres("pg_ctl").args(immediately).arg(self.folder.join("data")).output();
        assert!(stopped.is_ok_and(|output| output.status.success()), "the server stops");
        server.0.wait().expect("its end");
    }

    /// Starts the server again after a [`Cluster::crash`].
    ///
    /// # Panics
    /// If the cluster is shared, or the server does not start.
    pub fn restart(&mut self) {
        let Keep::Own(server, _) = &mut self._keep else { panic!("others use this cluster") };
        server.0 = postgres(&self.folder, Durability::None).spawn().expect("a server");
        wait_until_ready(&self.folder);
    }

    /// The server's process; `None` for a shared cluster, which another process started.
    pub fn process(&self) -> Option<u32> {
        match &self._keep {
            Keep::Own(server, _) => Some(server.0.id()),
            Keep::Shared(_) => None,
        }
    }

    /// The URL of a database for a role.
    pub fn url(&self, role: &str, database: &str) -> String {
        format!("postgres://{role}@localhost/{database}?host={}", self.folder.display())
    }
}

impl TestDatabase {
    /// The URL for the superuser.
    pub fn url(&self) -> String {
        self.cluster.url("postgres", &self.name)
    }

    /// The name within its cluster, which no other test uses.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for TestDatabase {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.cluster.psql("postgres", &format!("DROP DATABASE {} WITH (FORCE)", self.name));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // SIGINT asks for a fast shutdown.
        let _ = Command::new("kill").args(["-INT", &self.0.id().to_string()]).status();
        let _ = self.0.wait();
    }
}

/// Creates an empty cluster in `folder`.
fn init(folder: &Path) -> io::Result<()> {
    // Other users connect through the socket in it.
    std::fs::set_permissions(folder, PermissionsExt::from_mode(0o755))?;
    if let Some((user, group)) = other_user() {
        chown(folder, Some(user), Some(group))?;
    }
    let output = as_postgres("initdb")
        .args(["--username=postgres", "--auth=trust", "--encoding=UTF8", "--locale=C.UTF-8"])
        .args(["--no-sync", "--pgdata"])
        .arg(folder.join("data"))
        .output()?;
    if !output.status.success() {
        return Err(io::Error::other(String::from_utf8_lossy(&output.stderr).into_owned()));
    }
    // This role needs its password, as in a lab.
    let rules = folder.join("data/pg_hba.conf");
    let usual = std::fs::read_to_string(&rules)?;
    std::fs::write(rules, format!("local all lab scram-sha-256\n{usual}"))
}

fn postgres(folder: &Path, durability: Durability) -> Command {
    let mut command = as_postgres("postgres");
    command.args(options(folder, durability)).stdout(Stdio::null()).stderr(log(folder));
    command
}

/// A server that ends when its users have not held their lock for a while.
fn supervised(folder: &Path) -> Command {
    const SCRIPT: &str = r#"
        program=$1 folder=$2 linger=$3; shift 3
        "$program" "$@" & server=$!
        while kill -0 $server 2>/dev/null; do
            sleep "$linger"
            flock "$folder/turn" sh -c '
                flock --nonblock "$1/users" kill -INT "$2" || exit
                while [ -e "$1/data/postmaster.pid" ]; do sleep 0.1; done
            ' sh "$folder" $server
        done"#;
    let mut command = as_postgres("setsid");
    command
        .args(["--fork", "sh", "-c", SCRIPT, "sh"])
        .arg(path_of("postgres"))
        .arg(folder)
        .arg(LINGER_SECONDS.to_string())
        .args(options(folder, Durability::None))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(log(folder));
    command
}

fn options(folder: &Path, durability: Durability) -> Vec<String> {
    let mut options = vec![
        "-D".to_owned(),
        folder.join("data").display().to_string(),
        "-k".to_owned(),
        folder.display().to_string(),
    ];
    let mut set = |setting: &str| options.extend(["-c".to_owned(), setting.to_owned()]);
    set("listen_addresses=");
    set("max_connections=400");
    if durability == Durability::None {
        set("fsync=off");
        set("full_page_writes=off");
    }
    options
}

fn log(folder: &Path) -> Stdio {
    let log = File::options().append(true).create(true).open(folder.join("log"));
    log.map_or_else(|_| Stdio::null(), Stdio::from)
}

fn wait_until_ready(folder: &Path) {
    let began = Instant::now();
    while !is_ready(folder) {
        if began.elapsed() > READY_WITHIN {
            let log = std::fs::read_to_string(folder.join("log")).unwrap_or_default();
            panic!("PostgreSQL does not start: {log}");
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn is_ready(folder: &Path) -> bool {
    let asked = program("pg_isready").args(["--quiet", "--host"]).arg(folder).status();
    asked.expect("pg_isready, of Debian's package postgresql").success()
}

/// A lock that processes of both users may open.
fn lock_file(folder: &Path, name: &str) -> File {
    let path = folder.join(name);
    let file =
        File::options().read(true).append(true).create(true).open(&path).expect("a lock file");
    let _ = std::fs::set_permissions(path, PermissionsExt::from_mode(0o666));
    file
}

fn program(name: &str) -> Command {
    Command::new(path_of(name))
}

/// Debian keeps the programs of each version in a separate folder.
fn path_of(name: &str) -> PathBuf {
    let versions = std::fs::read_dir("/usr/lib/postgresql").into_iter().flatten().flatten();
    let newest = versions.map(|version| version.path().join("bin").join(name));
    newest.filter(|path| path.exists()).max().unwrap_or_else(|| PathBuf::from(name))
}

/// The server refuses to run as root.
fn as_postgres(name: &str) -> Command {
    let mut command = program(name);
    if let Some((user, group)) = other_user() {
        command.uid(user).gid(group).current_dir("/");
    }
    command
}

/// The user that the package creates, for a process of root.
fn other_user() -> Option<(u32, u32)> {
    let own = std::fs::metadata("/proc/self").ok()?;
    if own.uid() != 0 {
        return None;
    }
    let users = std::fs::read_to_string("/etc/passwd").ok()?;
    let line = users.lines().find(|line| line.starts_with("postgres:"))?;
    let mut fields = line.split(':').skip(2);
    Some((fields.next()?.parse().ok()?, fields.next()?.parse().ok()?))
}
