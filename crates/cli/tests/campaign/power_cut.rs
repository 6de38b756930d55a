//! The power goes while the log is written: ext4 on a loop device is shut down without writing
//! anything back, as `EXT4_IOC_SHUTDOWN` does, mounted again, and read. What was acknowledged is
//! there.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::fixture::{Bench, text};
use crate::kills::judge;
use crate::service::{Moments, configure, ended_within, figure, files, log_of, rounds, signal, start, status};
use gearwatch_testkit::log::content;

/// `ioctl(EXT4_IOC_SHUTDOWN, EXT4_GOING_FLAGS_NOLOGFLUSH)`.
const CUT: &str = "import fcntl, os, struct, sys\n\
    fcntl.ioctl(os.open(sys.argv[1], os.O_RDONLY), 0x8004587D, struct.pack('I', 2))\n";

fn run(command: &str, args: &[&str]) -> bool {
    Command::new(command).args(args).output().is_ok_and(|output| output.status.success())
}

/// A file system on a loop device; gone with the value.
struct Drive {
    image: PathBuf,
    folder: PathBuf,
}

impl Drive {
    /// `None` where there is no root, no loop device or no tool.
    fn new(bench: &Bench) -> Option<Self> {
        let drive = Self { image: bench.path("drive.img"), folder: bench.path("drive") };
        std::fs::create_dir_all(&drive.folder).ok()?;
        let file = std::fs::File::create(&drive.image).ok()?;
        file.set_len(64 << 20).ok()?;
        let made = run("mkfs.ext4", &["-q", "-F", text(&drive.image)]) && drive.mount() && run("python3", &["-c", ""]);
        made.then_some(drive)
    }

    fn mount(&self) -> bool {
        run("mount", &["-o", "loop", text(&self.image), text(&self.folder)])
    }

    fn cut(&self) -> bool {
        run("python3", &["-c", CUT, text(&self.folder)])
    }

    fn unmount(&self) -> bool {
        let begin = Instant::now();
        while begin.elapsed() < Duration::from_secs(5) {
            if run("umount", &[text(&self.folder)]) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        false
    }
}

impl Drop for Drive {
    fn drop(&mut self) {
        let _ = Command::new("umount").args(["-l", text(&self.folder)]).output();
    }
}

fn now_ns() -> i64 {
    i64::try_from(SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos()).unwrap()
}

#[test]
fn conform_power_cuts_lose_nothing_that_was_acknowledged() {
    let cuts = rounds(3);
    let bench = Bench::new();
    let Some(drive) = Drive::new(&bench) else {
        eprintln!("skipped: the power-cut loop needs root, a loop device, mkfs.ext4 and python3");
        return;
    };
    let mut moments = Moments::new(6);
    let (mut verdicts, mut tails, mut acknowledged_runs) = (0, 0, 0);
    let mut done = 0;
    while done < cuts {
        let folder = drive.folder.join(format!("log-{done}"));
        let config = configure(&bench, &folder, "100.0", "group_ms = 50\ngroup_bytes = 16384\nrotate_bytes = 65536");
        // (moment of the cut, highest number acknowledged until then)
        let mut ends: Vec<(i64, u64)> = Vec::new();
        for _ in 0..5.min(cuts - done) {
            let acknowledged = one_cut(&bench, &drive, &config, &mut moments);
            acknowledged_runs += u64::from(acknowledged > 0);
            ends.push((now_ns(), acknowledged));
            done += 1;
        }
        let mut child = start(&config);
        std::thread::sleep(Duration::from_millis(800));
        signal(&child, "TERM");
        assert_eq!(ended_within(&mut child, Duration::from_secs(10)).and_then(|status| status.code()), Some(0));
        let content = content(&files(&folder));
        let before = |t: i64| ends.iter().filter(|(cut, _)| *cut <= t).map(|&(_, seq)| seq).max().unwrap_or(0);
        let (more, gaps) = judge("power cut", &content, before);
        let last = content.groups.last().map_or(0, |group| group.seq_last);
        assert!(last >= before(i64::MAX), "the log ends at {last}, and more was acknowledged");
        verdicts += more;
        tails += gaps;
        std::fs::remove_dir_all(&folder).unwrap();
    }
    println!(
        "{cuts} power cuts, {acknowledged_runs} of them after something was acknowledged, {verdicts} verdicts, {tails} tails"
    );
    assert!(acknowledged_runs * 2 > cuts, "the cuts came too early to test anything");
}

/// Runs the service, cuts the power at some moment, and mounts the drive again. What was
/// acknowledged before the cut.
fn one_cut(bench: &Bench, drive: &Drive, config: &Path, moments: &mut Moments) -> u64 {
    let _ = std::fs::remove_file(bench.path("status.sock"));
    let mut child = start(config);
    let end = Instant::now() + moments.between(Duration::from_millis(300), Duration::from_millis(1200));
    let mut acknowledged = 0;
    while Instant::now() < end {
        let seq = status(bench).as_ref().and_then(log_of).and_then(|log| figure(log, "durable_seq"));
        acknowledged = acknowledged.max(seq.unwrap_or(0));
        std::thread::sleep(Duration::from_millis(3));
    }
    assert!(drive.cut(), "the file system cannot be shut down");
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(drive.unmount() && drive.mount(), "the drive cannot be mounted again");
    acknowledged
}
