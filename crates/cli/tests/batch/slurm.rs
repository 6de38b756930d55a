//! A real Slurm: controller and node daemon on this machine, a job array of ten shards over 200
//! recordings, some of them killed and submitted again.
//!
//! Slurm is looked for in `GEARWATCH_SLURM`, a folder that Debian's packages were unpacked into,
//! else where they are installed:
//!
//! ```sh
//! apt-get download slurmctld slurmd slurm-client slurm-wlm-basic-plugins libhwloc15 libmunge2 liblua5.1-0
//! for package in *.deb; do dpkg -x "$package" slurm; done
//! GEARWATCH_SLURM=$PWD/slurm cargo test -p gearwatch --test batch -- --nocapture slurm
//! ```

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::archive::{Archive, difference, duckdb, names, python};
use crate::fixture::{gearwatch, stderr, stdout, text};

const SHARDS: usize = 10;
const RECORDINGS: usize = 200;
const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/slurm/batch.sbatch");

/// Controller and node daemon; ended with the value.
struct Slurm {
    root: PathBuf,
    conf: PathBuf,
    daemons: Vec<Child>,
}

impl Slurm {
    /// `None`, said, where there is none.
    fn start(folder: &Path) -> Option<Self> {
        let root = PathBuf::from(std::env::var_os("GEARWATCH_SLURM").unwrap_or_else(|| "/".into()));
        if !root.join("usr/sbin/slurmctld-wlm").is_file() || !root.join("usr/sbin/slurmd-wlm").is_file() {
            eprintln!(
                "skipped: no Slurm in {} (GEARWATCH_SLURM names the folder that it was unpacked into)",
                root.display()
            );
            return None;
        }
        for name in ["state", "spool"] {
            std::fs::create_dir_all(folder.join(name)).unwrap();
        }
        let host = stdout(&Command::new("hostname").arg("-s").output().unwrap()).trim().to_owned();
        let user = stdout(&Command::new("id").arg("-un").output().unwrap()).trim().to_owned();
        let (controller, node) = (free_port(), free_port());
        let (here, plugins) = (text(folder), root.join("usr/lib/x86_64-linux-gnu/slurm-wlm"));
        // No authentication: this cluster is one machine for a minute.
        let conf = format!(
            "ClusterName=test\nSlurmctldHost={host}(127.0.0.1)\nAuthType=auth/none\nCredType=cred/none\nSlurmUser={user}\n\
             SlurmdUser={user}\nProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSwitchType=switch/none\nMpiDefault=none\n\
             PluginDir={}\nSlurmctldPort={controller}\nSlurmdPort={node}\nStateSaveLocation={here}/state\nSlurmdSpoolDir={here}/spool\n\
             SlurmctldPidFile={here}/slurmctld.pid\nSlurmdPidFile={here}/slurmd.pid\nSlurmctldLogFile={here}/slurmctld.log\n\
             SlurmdLogFile={here}/slurmd.log\nReturnToService=2\nSelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\n\
             SchedulerParameters=sched_interval=1,batch_sched_delay=0\nKillWait=1\nSlurmdParameters=config_overrides\nNodeName={host} NodeAddr=127.0.0.1 CPUs=4 State=UNKNOWN\n\
             PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE OverSubscribe=NO State=UP\n",
            text(&plugins)
        );
        let path = folder.join("slurm.conf");
        std::fs::write(&path, conf).unwrap();
        let mut slurm = Self { root, conf: path, daemons: Vec::new() };
        let stepd = slurm.root.join("usr/sbin/slurmstepd-wlm");
        slurm.daemon("sbin/slurmctld-wlm", &["-D"]);
        slurm.daemon("sbin/slurmd-wlm", &["-D", "-d", text(&stepd)]);
        let idle = || stdout(&slurm.call("sinfo", &["-h", "-o", "%T"], folder)).trim() == "idle";
        assert!(wait(Duration::from_secs(60), idle), "the node does not come up: see {here}/slurmd.log");
        Some(slurm)
    }

    fn command(&self, program: &str) -> Command {
        let libraries = self.root.join("usr/lib/x86_64-linux-gnu");
        let libraries = format!("{0}:{0}/slurm-wlm", text(&libraries));
        let mut command = Command::new(self.root.join("usr").join(program));
        command.env("SLURM_CONF", &self.conf).env("LD_LIBRARY_PATH", libraries);
        command
    }

    fn daemon(&mut self, program: &str, args: &[&str]) {
        let child = self.command(program).args(args).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        self.daemons.push(child.unwrap());
    }

    fn call(&self, program: &str, args: &[&str], folder: &Path) -> Output {
        self.command(&format!("bin/{program}")).args(args).current_dir(folder).output().unwrap()
    }

    /// Submits the job script that gearwatch ships.
    fn submit(&self, args: &[&str], folder: &Path) -> String {
        let program = gearwatch(&[]).get_program().to_owned();
        let mut command = self.command("bin/sbatch");
        command.args(["--parsable"]).args(args).arg(SCRIPT).current_dir(folder).env("GEARWATCH", program);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        stdout(&output).trim().to_owned()
    }

    /// Tasks that wait or run.
    fn queue(&self, folder: &Path) -> String {
        stdout(&self.call("squeue", &["-h", "-r", "-o", "%i %T"], folder))
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        for mut daemon in self.daemons.drain(..).rev() {
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
    }
}

fn free_port() -> u16 {
    std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

fn wait(limit: Duration, mut done: impl FnMut() -> bool) -> bool {
    let begin = Instant::now();
    while begin.elapsed() < limit {
        if done() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    false
}

/// Shards that have some pieces and no part: they are in the middle of their work.
fn under_way(out: &Path) -> Vec<usize> {
    if !out.is_dir() {
        return Vec::new();
    }
    let all = names(out);
    let pieces = |shard: usize| {
        let own = format!(".part-{shard:05}-of-");
        let folder = all.iter().find(|name| name.starts_with(&own))?;
        // It may be done and gone by now.
        let entries = std::fs::read_dir(out.join(folder)).ok()?;
        Some(entries.filter_map(Result::ok).filter(|e| !e.file_name().to_string_lossy().starts_with('.')).count())
    };
    (1..=SHARDS)
        .filter(|&shard| pieces(shard).is_some_and(|count| (1..RECORDINGS / SHARDS / 2).contains(&count)))
        .collect()
}

#[test]
fn conform_slurm_runs_an_array_of_shards_and_killed_ones_again() {
    let scratch = tempfile::tempdir().unwrap();
    let Some(slurm) = Slurm::start(scratch.path()) else { return };
    if python("duckdb").is_none() {
        return;
    }
    let archive = Archive::new(RECORDINGS, 20.0);
    let folder = archive.bench.path("");
    let whole = archive.batch("whole", &[]).output().unwrap();
    assert!(whole.status.success(), "{}", stderr(&whole));

    let job = slurm.submit(&[], &folder);
    let mut killed: Vec<usize> = Vec::new();
    let out = archive.bench.path("ranks");
    let ended = wait(Duration::from_secs(300), || {
        for shard in under_way(&out) {
            if killed.len() < 3 && !killed.contains(&shard) {
                let task = format!("{job}_{shard}");
                if slurm.call("scancel", &["--signal=KILL", &task], &folder).status.success() {
                    killed.push(shard);
                }
            }
        }
        slurm.queue(&folder).trim().is_empty()
    });
    assert!(ended, "still in the queue:\n{}", slurm.queue(&folder));
    let parts = || names(&out).into_iter().filter(|name| name.ends_with(".parquet")).count();
    killed.retain(|shard| !out.join(format!("part-{shard:05}-of-00010.parquet")).exists());
    killed.sort_unstable();
    assert!(!killed.is_empty(), "no shard could be killed in the middle of its work");
    assert_eq!(parts(), SHARDS - killed.len(), "{:?}", names(&out));

    let tasks: Vec<String> = killed.iter().map(ToString::to_string).collect();
    let again = slurm.submit(&[&format!("--array={}", tasks.join(","))], &folder);
    assert!(wait(Duration::from_secs(300), || slurm.queue(&folder).trim().is_empty()), "{}", slurm.queue(&folder));
    assert_eq!(names(&out).len(), SHARDS, "{:?}", names(&out));
    let mut known = Vec::new();
    for shard in &killed {
        let log = std::fs::read_to_string(folder.join(format!("gearwatch-{again}-{shard}.log"))).unwrap();
        assert!(!log.contains(" 0 known from before"), "shard {shard} began anew: {log}");
        known.push(log.split(", ").find_map(|words| words.strip_suffix(" known from before")).unwrap().to_owned());
    }
    let (different, rows) = difference(&out, &archive.bench.path("whole")).unwrap();
    assert_eq!(different, "0", "rows that only the shards or only the single run have");
    // 20 s in windows of 1 s, every half second: 39 windows of two channels.
    assert_eq!(rows, (RECORDINGS * 39 * 2).to_string());
    let faulty = duckdb(&format!(
        "select count(distinct file) from '{}/*.parquet' where level_2x = 5",
        text(&archive.bench.path("ranks"))
    ));
    eprintln!(
        "{RECORDINGS} recordings in {SHARDS} shards; shards {killed:?} killed and submitted again, {} recordings known to them; {rows} rows, \
         {different} that differ from one run; {} recordings with a rank V",
        known.join(" + "),
        faulty.unwrap().trim()
    );
}
