//! The loop: damaged inputs into every reader, for a number of seconds. `cargo xtask fuzz` calls it.
//!
//! Each target runs in a process of its own, with its memory limited, that writes down each input before it tries it. So a panic, an
//! abort, a full stack, a hang and a memory hog are all found by the same parent, and the input is at hand.

use fuzz::mutate::{LONGEST, Random, damaged, dictionary};
use fuzz::{CORPUS, TARGETS, Target};
use std::fs::{self, File};
use std::io::{Read, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// An input that takes longer is a find; also on a machine that is busy with other things.
const TOO_LONG: Duration = Duration::from_secs(10);
/// Address space of a target's process, in KiB.
const MEMORY: u64 = 2 << 20;
/// How a target's process says that an input hung.
const HUNG: u8 = 97;

struct Asked {
    names: Vec<String>,
    seconds: f64,
    seed: u64,
    input: Option<PathBuf>,
    child: bool,
}

fn main() -> ExitCode {
    let asked = match asked(std::env::args().skip(1)) {
        Ok(asked) => asked,
        Err(message) => {
            let names: Vec<&str> = TARGETS.iter().map(|t| t.0).collect();
            eprintln!(
                "{message}\nusage: cargo xtask fuzz NAME|all [--seconds N] [--seed N] [--input FILE]\ntargets: {}",
                names.join(", ")
            );
            return ExitCode::from(2);
        }
    };
    let chosen: Vec<&Target> = TARGETS
        .iter()
        .filter(|t| asked.names.iter().any(|n| n == "all" || n == t.0))
        .collect();
    if let Some(file) = &asked.input {
        return once(chosen[0], file);
    }
    if asked.child {
        return feed(chosen[0], &asked);
    }
    let share = asked.seconds / chosen.len() as f64;
    let mut finds = 0;
    for target in &chosen {
        finds += usize::from(!watched(target, share, asked.seed));
    }
    println!("fuzz: {} targets, {finds} finds", chosen.len());
    ExitCode::from(u8::from(finds > 0))
}

fn asked(mut words: impl Iterator<Item = String>) -> Result<Asked, String> {
    let mut asked = Asked {
        names: Vec::new(),
        seconds: 20.0,
        seed: 1,
        input: None,
        child: false,
    };
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value"));
        match word.as_str() {
            "--seconds" => asked.seconds = value()?.parse().map_err(|_| "--seconds: a number was expected")?,
            "--seed" => asked.seed = value()?.parse().map_err(|_| "--seed: a whole number was expected")?,
            "--input" => asked.input = Some(value()?.into()),
            "--child" => asked.child = true,
            name if name == "all" || TARGETS.iter().any(|t| t.0 == name) => asked.names.push(word),
            name => return Err(format!("there is no target '{name}'")),
        }
    }
    if asked.names.is_empty() {
        return Err("no target was named".to_owned());
    }
    Ok(asked)
}

/// Runs a target in a process of its own; false when something was found.
fn watched(target: &Target, seconds: f64, seed: u64) -> bool {
    let folder = folder_of(target.0);
    let program = std::env::current_exe().expect("a running program has a file");
    // The shell sets the limit: Rust's library has no call for it.
    let script = format!("ulimit -v {MEMORY} 2>/dev/null; exec \"$0\" \"$@\"");
    let status = Command::new("sh")
        .args(["-c", &script])
        .arg(&program)
        .args([
            target.0,
            "--child",
            "--seconds",
            &seconds.to_string(),
            "--seed",
            &seed.to_string(),
        ])
        .status();
    let status = match status {
        Ok(status) => status,
        Err(error) => {
            println!("fuzz: {} could not be started: {error}", target.0);
            return false;
        }
    };
    if status.success() {
        return true;
    }
    let what = match status.code() {
        Some(code) if code == i32::from(HUNG) => "hang",
        Some(101) => "panic",
        _ => "abort",
    };
    let input = last_input(&folder.join("current")).unwrap_or_default();
    let kept = folder.join(format!("{what}-{:016x}", hash_of(&input)));
    match fs::write(&kept, &input) {
        Ok(()) => println!(
            "fuzz: {}: {what} ({status}) on {} bytes, kept as {}\n  again: cargo xtask fuzz {} --input {}",
            target.0,
            input.len(),
            kept.display(),
            target.0,
            kept.display()
        ),
        Err(error) => println!("fuzz: {}: {what}; its input could not be kept: {error}", target.0),
    }
    false
}

/// Feeds one target until its time is over. A panic ends the process: the parent knows what to do.
fn feed(target: &Target, asked: &Asked) -> ExitCode {
    let (name, run) = *target;
    let (seeds, words) = (seeds_of(name), words_of(name));
    let current = File::create(folder_of(name).join("current")).expect("target/fuzz can be written");
    // Executions so far, so that the watch sees one that does not end.
    let executions = Arc::new(AtomicU64::new(0));
    watch(Arc::clone(&executions));
    let mut random = Random(asked.seed ^ hash_of(name.as_bytes()));
    let end = Instant::now() + Duration::from_secs_f64(asked.seconds);
    let mut tried = 0u64;
    while Instant::now() < end {
        // The seeds themselves first: a target that fails on good input is not worth feeding.
        let input = match seeds.get(usize::try_from(tried).unwrap_or(usize::MAX)) {
            Some(seed) => seed.clone(),
            None => damaged(&mut random, &seeds, &words),
        };
        note(&current, &input);
        run(&input);
        tried += 1;
        executions.store(tried, Ordering::Relaxed);
    }
    println!("fuzz: {name}: {tried} executions from {} seeds, nothing found", seeds.len());
    ExitCode::SUCCESS
}

/// Ends the process when one execution takes too long.
fn watch(executions: Arc<AtomicU64>) {
    std::thread::spawn(move || {
        let (mut seen, mut since) = (0, Instant::now());
        loop {
            std::thread::sleep(Duration::from_millis(200));
            let now = executions.load(Ordering::Relaxed);
            if now != seen {
                (seen, since) = (now, Instant::now());
            } else if since.elapsed() > TOO_LONG {
                std::process::exit(i32::from(HUNG));
            }
        }
    });
}

/// Tries one kept input.
fn once(target: &Target, file: &Path) -> ExitCode {
    let bytes = match fs::read(file) {
        Ok(bytes) => bytes,
        Err(error) => {
            eprintln!("{}: {error}", file.display());
            return ExitCode::from(2);
        }
    };
    let began = Instant::now();
    (target.1)(&bytes);
    println!("fuzz: {}: came back after {:.3} s", target.0, began.elapsed().as_secs_f64());
    ExitCode::SUCCESS
}

/// Writes the input down before it is tried: its length, then its bytes. Survives the death of the process, not of the machine.
fn note(file: &File, input: &[u8]) {
    let mut record = (input.len() as u64).to_le_bytes().to_vec();
    record.extend_from_slice(input);
    file.write_all_at(&record, 0).expect("target/fuzz can be written");
}

fn last_input(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let mut length = [0; 8];
    file.read_exact(&mut length)?;
    let mut input = Vec::new();
    file.take(u64::from_le_bytes(length).min(2 * LONGEST as u64))
        .read_to_end(&mut input)?;
    Ok(input)
}

fn folder_of(name: &str) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| PathBuf::from("target"), PathBuf::from);
    let folder = target.join("fuzz").join(name);
    fs::create_dir_all(&folder).expect("target/fuzz can be written");
    folder
}

/// The target's own seeds, and what of the corpus is its kind.
fn seeds_of(name: &str) -> Vec<Vec<u8>> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = files_in(&here.join("seeds").join(name));
    files.retain(|f| f.file_name().is_some_and(|n| n != "dictionary"));
    for (target, ending) in CORPUS {
        if *target == name {
            let mut more = files_in(&here.join("../corpus"));
            more.retain(|f| f.extension().is_some_and(|e| e == *ending));
            files.extend(more);
        }
    }
    let mut seeds: Vec<Vec<u8>> = files.iter().filter_map(|f| fs::read(f).ok()).collect();
    seeds.retain(|s| s.len() <= LONGEST);
    if seeds.is_empty() {
        let _ = writeln!(
            std::io::stderr(),
            "note: {name} has no seeds: put small good inputs into fuzz/seeds/{name}"
        );
        seeds.push(Vec::new());
    }
    seeds
}

fn words_of(name: &str) -> Vec<Vec<u8>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("seeds")
        .join(name)
        .join("dictionary");
    fs::read_to_string(file).map(|text| dictionary(&text)).unwrap_or_default()
}

fn files_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|e| e.path()).filter(|p| p.is_file()).collect();
    files.sort();
    files
}

/// FNV-1a: a short name for an input.
fn hash_of(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}
