//! A small file system of our own, for what a full disk does; it goes away with the process that runs on it.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Mounted where only the process sees it; what is in its folder `data` is copied off at the end.
const SCRIPT: &str = "mount -t tmpfs -o size=3m none \"$0\" && mkdir \"$0/data\" || exit 99
\"$@\" & echo $! > \"$PID_FILE\"; wait $!; code=$?; cp -r \"$0/data/.\" \"$COPY\"; exit $code";

pub struct SmallDisk {
    folder: TempDir,
    /// The disk as the process sees it.
    inside: PathBuf,
    filler: Option<File>,
    /// The process.
    pub id: u32,
}

impl SmallDisk {
    /// False, and says why, where no file system can be mounted.
    pub fn is_possible() -> bool {
        let tried = Command::new("unshare")
            .args(["-rm", "sh", "-c", "mount -t tmpfs none /tmp"])
            .output();
        let possible = tried.is_ok_and(|o| o.status.success());
        if !possible {
            println!("skipped: no file system can be mounted here; allow user namespaces, or run it as root");
        }
        possible
    }

    /// Starts the program with words that may name the disk's folder; at its end the folder's files are copied to `copy`.
    pub fn start(words: impl Fn(&Path) -> Vec<String>, copy: &Path) -> (SmallDisk, Child) {
        let folder = tempfile::tempdir().expect("a folder");
        let disk = folder.path().join("disk");
        std::fs::create_dir(&disk).expect("a folder");
        std::fs::create_dir_all(copy).expect("a folder");
        let pid_file = folder.path().join("pid");
        let child = Command::new("unshare")
            .args(["-rm", "sh", "-c", SCRIPT])
            .arg(&disk)
            .arg(env!("CARGO_BIN_EXE_toolmark"))
            .args(words(&disk.join("data")))
            .env("TOOLMARK_DATA", disk.join("data"))
            .env("PID_FILE", &pid_file)
            .env("COPY", copy)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("started");
        let began = Instant::now();
        let id = loop {
            let text = std::fs::read_to_string(&pid_file).unwrap_or_default();
            if let Ok(id) = text.trim().parse::<u32>() {
                break id;
            }
            assert!(began.elapsed() < Duration::from_secs(120), "the process never came");
            std::thread::sleep(Duration::from_millis(20));
        };
        let inside = PathBuf::from(format!("/proc/{id}/root")).join(disk.strip_prefix("/").expect("a whole path"));
        let disk = SmallDisk {
            folder,
            inside,
            filler: None,
            id,
        };
        (disk, child)
    }

    /// The folder on the disk that the program was given.
    pub fn data(&self) -> PathBuf {
        self.inside.join("data")
    }

    /// Leaves no byte free.
    pub fn fill(&mut self) {
        let mut file = File::create(self.inside.join("filler")).expect("made");
        for size in [1 << 16, 1 << 12, 1] {
            while std::io::Write::write_all(&mut file, &vec![1; size]).is_ok() {}
        }
        self.filler = Some(file);
    }

    /// Gives the space back.
    pub fn free(&mut self) {
        std::fs::remove_file(self.inside.join("filler")).expect("freed");
        self.filler = None;
        assert!(self.folder.path().exists());
    }
}
