//! What the system grants a thread that must not be late, and what it refuses.

use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::Write;

/// Above everything of the shell and below the kernel's own threads, as `cyclictest` is usually run.
pub const PRIORITY: i32 = 80;

/// What was asked for and whether it was given.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Privilege {
    /// What.
    pub name: &'static str,
    /// Why not; `None` when it was given.
    pub refused: Option<String>,
    /// What a person can do about it.
    #[serde(skip)]
    pub remedy: &'static str,
}

/// What the realtime thread has. It runs with less as well, later now and then: that is counted, and said at its start.
#[derive(Debug, Default, Serialize)]
pub struct Privileges {
    /// Each one.
    pub asked: Vec<Privilege>,
    /// Kept open: as long as it is, the processors do not go to sleep deeply.
    #[serde(skip)]
    _awake: Option<File>,
}

impl Privileges {
    /// Asks for all of them, for the calling thread: scheduling before everything else, memory that is never paged out, a processor of its
    /// own, and a timer without slack. What the thread uses has to be there already: memory that comes later is not locked.
    pub fn take() -> Privileges {
        let mut asked = vec![
            Privilege {
                name: "SCHED_FIFO",
                refused: system::first_come_first_served(PRIORITY).err(),
                remedy: "run as root, or give the program CAP_SYS_NICE or the user an rtprio limit",
            },
            Privilege {
                name: "mlockall",
                refused: system::lock_memory().err(),
                remedy: "run as root, or give the program CAP_IPC_LOCK or the user a larger memlock limit",
            },
            Privilege {
                name: "affinity",
                refused: system::stay_on_one_processor().err(),
                remedy: "allow the process more than one processor (taskset, cpuset)",
            },
        ];
        if let Err(why) = system::no_timer_slack() {
            asked.push(Privilege {
                name: "timer slack",
                refused: Some(why),
                remedy: "the kernel refuses what it grants to everyone: look for a seccomp filter",
            });
        }
        // As `cyclictest` does. Where the file is not there, there is no deep sleep to forbid, or no right to: either way the lateness shows it.
        let awake = OpenOptions::new().write(true).open("/dev/cpu_dma_latency");
        let _awake = awake.ok().filter(|mut file| file.write_all(&0i32.to_ne_bytes()).is_ok());
        Privileges { asked, _awake }
    }

    /// True when nothing was refused.
    pub fn complete(&self) -> bool {
        self.asked.iter().all(|one| one.refused.is_none())
    }

    /// What was refused and what to do about it, a line each.
    pub fn lacks(&self) -> Vec<String> {
        let refused = |one: &Privilege| {
            let why = one.refused.as_ref()?;
            Some(format!("without {}: {why}; {}", one.name, one.remedy))
        };
        self.asked.iter().filter_map(refused).collect()
    }
}

impl fmt::Display for Privileges {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let had: Vec<&str> = self
            .asked
            .iter()
            .filter(|one| one.refused.is_none())
            .map(|one| one.name)
            .collect();
        match had.as_slice() {
            [] => write!(f, "an ordinary thread"),
            had => write!(f, "{}", had.join(", ")),
        }
    }
}

/// How often devices have interrupted each processor, from the text of `/proc/interrupts`: a line for each interrupt, the numbered ones are
/// devices', and a column for each processor that is on.
#[cfg_attr(not(target_os = "linux"), allow(dead_code, reason = "there is no such text elsewhere"))]
fn interrupts_of_devices(text: &str) -> BTreeMap<usize, u64> {
    let mut lines = text.lines();
    let head = lines.next().unwrap_or_default();
    let processors: Vec<usize> = head
        .split_whitespace()
        .filter_map(|word| word.strip_prefix("CPU")?.parse().ok())
        .collect();
    let mut all: BTreeMap<usize, u64> = processors.iter().map(|cpu| (*cpu, 0)).collect();
    for line in lines {
        let Some((name, counts)) = line.split_once(':') else {
            continue;
        };
        if name.trim().parse::<u32>().is_err() {
            continue;
        }
        for (cpu, count) in processors.iter().zip(counts.split_whitespace()) {
            if let (Some(sum), Ok(count)) = (all.get_mut(cpu), count.parse::<u64>()) {
                *sum += count;
            }
        }
    }
    all
}

#[cfg(target_os = "linux")]
mod system {
    use rustix::mm::{MlockAllFlags, mlockall};
    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity, set_current_timer_slack};
    use std::num::NonZeroU64;

    /// SCHED_FIFO for the calling thread.
    pub fn first_come_first_served(priority: i32) -> Result<(), String> {
        let parameter = libc::sched_param {
            sched_priority: priority,
        };
        #[expect(unsafe_code, reason = "no safe wrapper of it exists in a crate that is in the house")]
        // SAFETY: 0 is the calling thread, the parameter is read during the call only and lives longer.
        let answer = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameter) };
        if answer == 0 {
            return Ok(());
        }
        Err(std::io::Error::last_os_error().to_string())
    }

    /// All that is mapped now stays in memory. Not what comes later: with a limit of locked memory every later allocation of the whole
    /// process could fail, and the realtime thread has all it needs.
    pub fn lock_memory() -> Result<(), String> {
        mlockall(MlockAllFlags::CURRENT).map_err(|e| e.to_string())
    }

    /// The processor, of those that are allowed, that devices have interrupted least since the system began: an interrupt goes before
    /// everything, and where the disk's are a thread is twice as late as elsewhere.
    pub fn stay_on_one_processor() -> Result<(), String> {
        let allowed = sched_getaffinity(None).map_err(|e| e.to_string())?;
        let all: Vec<usize> = (0..CpuSet::MAX_CPU).filter(|cpu| allowed.is_set(*cpu)).collect();
        if all.len() < 2 {
            return Err("there is one processor for everything".to_owned());
        }
        let interrupts = super::interrupts_of_devices(&std::fs::read_to_string("/proc/interrupts").unwrap_or_default());
        // Where nothing is known of it, the last: most of the system's own work is on the first.
        let Some(quietest) = all.iter().rev().min_by_key(|cpu| interrupts.get(cpu)) else {
            return Err("there is no processor to stay on".to_owned());
        };
        let mut one = CpuSet::new();
        one.set(*quietest);
        sched_setaffinity(None, &one).map_err(|e| e.to_string())
    }

    /// The kernel may wake an ordinary thread 50 us late to wake several at once.
    pub fn no_timer_slack() -> Result<(), String> {
        set_current_timer_slack(NonZeroU64::new(1)).map_err(|e| e.to_string())
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    const NOT_HERE: &str = "this is asked for on Linux only";
    pub fn first_come_first_served(_priority: i32) -> Result<(), String> {
        Err(NOT_HERE.to_owned())
    }
    pub fn lock_memory() -> Result<(), String> {
        Err(NOT_HERE.to_owned())
    }
    pub fn stay_on_one_processor() -> Result<(), String> {
        Err(NOT_HERE.to_owned())
    }
    pub fn no_timer_slack() -> Result<(), String> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interrupts_of_devices_are_summed_for_each_processor_that_is_on() {
        let text = "           CPU0       CPU2\n 36:          0    6827716 PCI-MSIX 1-edge      virtio1-req.0\n 41:      19876          5 PCI-MSIX\n\
                    LOC:   12138556   15668428   Local timer interrupts\nERR:          0\n 99:\n";
        let found = interrupts_of_devices(text);
        assert_eq!(found, BTreeMap::from([(0, 19_876), (2, 6_827_721)]));
        assert!(interrupts_of_devices("").is_empty());
        assert_eq!(interrupts_of_devices("no such\n1: 2 3\n"), BTreeMap::new());
    }
}
