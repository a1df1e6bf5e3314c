//! A Slurm cluster of one node on loopback, with its own daemons, keys and folders.

use std::ffi::OsString;
use std::fmt::Write as _;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use testbed::TestDatabase;

use crate::product::{PATIENCE, Product, torqued};

/// A cluster whose daemons and jobs end when it is dropped.
pub struct Cluster {
    /// The database of the servers that ask it for workers.
    database: TestDatabase,
    folder: tempfile::TempDir,
    munged: Option<Child>,
    slurmctld: Option<Child>,
    slurmd: Option<Child>,
}

/// The programs of a cluster, and their packages in Debian.
const PROGRAMS: [(&str, &str); 4] = [
    ("munged", "munge"),
    ("slurmctld", "slurm-wlm"),
    ("slurmd", "slurm-wlm"),
    ("sbatch", "slurm-wlm"),
];

impl Cluster {
    /// The reason why this machine can have no cluster.
    pub fn obstacle() -> Option<String> {
        let missing = PROGRAMS.iter().find(|(program, _)| find(program).is_none());
        missing.map(|(program, package)| {
            format!("{program} of the package {package} is not installed")
        })
    }

    /// A node of 8 processors in the partitions `low` and `high`. The machine may have fewer, since
    /// no job is bound to one. Jobs of `high` preempt those of `low` after a grace time of 20 s.
    pub fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        // Munge refuses a socket in a folder that other users cannot read.
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
        for name in ["state", "spool"] {
            std::fs::create_dir(folder.path().join(name)).unwrap();
        }
        let key = folder.path().join("munge.key");
        std::fs::write(&key, [7; 1024]).unwrap();
        std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o400)).unwrap();
        let database = testbed::Cluster::shared().database();
        let cluster = Self { database, folder, munged: None, slurmctld: None, slurmd: None };
        std::fs::write(cluster.path("slurm.conf"), cluster.configuration()).unwrap();
        cluster.begin()
    }

    fn begin(mut self) -> Self {
        let file = |name: &str| self.path(name).display().to_string();
        let munged = [
            "--foreground".to_owned(),
            "--force".to_owned(),
            format!("--key-file={}", file("munge.key")),
            format!("--socket={}", file("munge.socket")),
            format!("--pid-file={}", file("munged.pid")),
            format!("--seed-file={}", file("munge.seed")),
            format!("--log-file={}", file("munged.log")),
        ];
        self.munged = Some(self.daemon("munged", &munged));
        wait_until("munged listens", || self.path("munge.socket").exists());
        self.start_controller();
        let node = ["-D".to_owned(), "-N".to_owned(), "n1".to_owned()];
        self.slurmd = Some(self.daemon("slurmd", &node));
        wait_until("the node is idle", || {
            self.run("sinfo", &["--noheader", "--format=%T"]).contains("idle")
        });
        self
    }

    fn configuration(&self) -> String {
        let user = output(Command::new("id").arg("-un"));
        let host = output(Command::new("uname").arg("-n"));
        let [controller, node] = free_ports();
        let mut text = String::new();
        for (key, value) in [
            ("ClusterName", "torqued".to_owned()),
            ("SlurmctldHost", format!("{host}(127.0.0.1)")),
            ("SlurmctldPort", controller.to_string()),
            ("SlurmdPort", node.to_string()),
            ("SlurmUser", user.clone()),
            ("SlurmdUser", user),
            ("AuthType", "auth/munge".to_owned()),
            ("AuthInfo", format!("socket={}", self.path("munge.socket").display())),
            ("CredType", "cred/munge".to_owned()),
            ("StateSaveLocation", self.path("state").display().to_string()),
            ("SlurmdSpoolDir", self.path("spool").display().to_string()),
            ("SlurmctldPidFile", self.path("slurmctld.pid").display().to_string()),
            ("SlurmdPidFile", self.path("slurmd.pid").display().to_string()),
            ("SlurmctldLogFile", self.path("slurmctld.log").display().to_string()),
            ("SlurmdLogFile", self.path("slurmd.log").display().to_string()),
            // Not every machine has control groups and accounting.
            ("ProctrackType", "proctrack/linuxproc".to_owned()),
            ("TaskPlugin", "task/none".to_owned()),
            ("SwitchType", "switch/none".to_owned()),
            ("MpiDefault", "none".to_owned()),
            ("AccountingStorageType", "accounting_storage/none".to_owned()),
            ("JobAcctGatherType", "jobacct_gather/none".to_owned()),
            ("JobCompType", "jobcomp/none".to_owned()),
            ("SelectType", "select/cons_tres".to_owned()),
            ("SelectTypeParameters", "CR_CPU_Memory".to_owned()),
            ("SlurmdParameters", "config_overrides".to_owned()),
            // A node that a test takes down stays down until the test resumes it.
            ("ReturnToService", "1".to_owned()),
            ("KillWait", "30".to_owned()),
            (
                "SchedulerParameters",
                "batch_sched_delay=0,sched_interval=1,bf_interval=1".to_owned(),
            ),
            ("PreemptType", "preempt/partition_prio".to_owned()),
            ("PreemptMode", "CANCEL".to_owned()),
        ] {
            writeln!(text, "{key}={value}").unwrap();
        }
        writeln!(
            text,
            "NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={node} CPUs=8 RealMemory=16000 Feature=fast \
             State=UNKNOWN\n\
             PartitionName=low Nodes=n1 Default=YES State=UP PriorityTier=1 PreemptMode=CANCEL GraceTime=20\n\
             PartitionName=high Nodes=n1 State=UP PriorityTier=10 PreemptMode=OFF"
        )
        .unwrap();
        text
    }

    /// Starts the controller with the state of the one before.
    pub fn start_controller(&mut self) {
        self.slurmctld = Some(self.daemon("slurmctld", &["-D".to_owned(), "-i".to_owned()]));
        wait_until("the controller answers", || {
            self.command("scontrol", &["ping"])
                .output()
                .is_ok_and(|output| String::from_utf8_lossy(&output.stdout).contains("is UP"))
        });
    }

    /// Kills the controller. Jobs continue.
    pub fn kill_controller(&mut self) {
        end(&mut self.slurmctld);
    }

    /// Serves `data` with workers of this cluster that have one processor each.
    pub fn serve(&self, data: &Path, arguments: &[&str]) -> Product {
        let usual = ["--look-every", "1", "--worker-threads", "1", "--worker-memory-gb", "1"];
        let arguments = [&["--executor", "slurm"], &usual[..], arguments].concat();
        self.serve_with(data, &arguments)
    }

    /// Serves `data` with the database of this cluster.
    pub fn serve_with(&self, data: &Path, arguments: &[&str]) -> Product {
        let mut command = torqued(&["serve", "--listen", "127.0.0.1:0"]);
        command.arg("--data").arg(data).args(arguments).envs(self.variables());
        Product::spawn(&mut command)
    }

    fn variables(&self) -> [(&'static str, OsString); 2] {
        let configuration = self.path("slurm.conf").into_os_string();
        [("SLURM_CONF", configuration), ("TORQUED_DATABASE", self.database.url().into())]
    }

    /// The name of the workers' database.
    pub fn database(&self) -> &str {
        self.database.name()
    }

    /// Runs a command of Slurm that must succeed, and gives its output.
    pub fn run(&self, program: &str, arguments: &[&str]) -> String {
        let Output { status, stdout, stderr } = self.command(program, arguments).output().unwrap();
        let said = String::from_utf8_lossy(&stderr).into_owned();
        assert!(status.success(), "{program} {arguments:?}: {said}");
        String::from_utf8(stdout).unwrap()
    }

    /// States of the jobs, by number.
    pub fn jobs(&self, states: &str) -> Vec<(String, String)> {
        let states = format!("--states={states}");
        let printed = self.run("squeue", &["--noheader", &states, "--format=%i %T"]);
        let lines = printed.lines().filter_map(|line| line.split_once(' '));
        lines.map(|(number, state)| (number.to_owned(), state.to_owned())).collect()
    }

    fn command(&self, program: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(find(program).unwrap());
        command.args(arguments).envs(self.variables()).stdin(Stdio::null());
        command
    }

    /// Starts a program that ends with this process in all cases.
    fn daemon(&self, program: &str, arguments: &[String]) -> Child {
        let log = std::fs::File::create(self.path(&format!("{program}.out"))).unwrap();
        Command::new("setpriv")
            .args(["--pdeathsig", "KILL"])
            .arg(find(program).unwrap())
            .args(arguments)
            .env("SLURM_CONF", self.path("slurm.conf"))
            .stdin(Stdio::null())
            .stdout(log.try_clone().unwrap())
            .stderr(log)
            .spawn()
            .unwrap()
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        // Jobs outlive the daemons.
        let _ = self.command("scancel", &["--me"]).output();
        let began = Instant::now();
        while began.elapsed() < Duration::from_secs(40) {
            let left = self.command("squeue", &["--noheader"]).output();
            if left.is_ok_and(|output| !output.status.success() || output.stdout.is_empty()) {
                break;
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        for daemon in [&mut self.slurmd, &mut self.slurmctld, &mut self.munged] {
            end(daemon);
        }
    }
}

fn end(daemon: &mut Option<Child>) {
    if let Some(mut daemon) = daemon.take() {
        let _ = daemon.kill();
        let _ = daemon.wait();
    }
}

/// Finds a program on the PATH or in the folders of daemons.
fn find(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders =
        std::env::split_paths(&path).chain(["/usr/sbin".into(), "/usr/local/sbin".into()]);
    folders.map(|folder| folder.join(program)).find(|file| file.is_file())
}

fn output(command: &mut Command) -> String {
    String::from_utf8(command.output().unwrap().stdout).unwrap().trim().to_owned()
}

fn free_ports() -> [u16; 2] {
    let listeners = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    listeners.map(|listener| listener.local_addr().unwrap().port())
}

fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "still waiting: {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}
