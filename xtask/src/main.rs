//! Chores of the repository: `cargo xtask licences`, `cargo xtask soak NAME` and `cargo xtask fuzz NAME`.
//!
//! A soak is a test of the ordinary suite with a larger count: the test reads its count from the environment, so that the run in CI
//! and the long one are the same code. Its table is printed ready for `docs/measurements/`.

use serde_json::Value;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

/// Licences that fit the project's own (MIT OR Apache-2.0) in a program that is given away as a whole.
const ALLOWED: &[&str] = &[
    "MIT",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
    "CC0-1.0",
    "0BSD",
    "BSL-1.0",
];

/// The long runs: name, package, file of tests or a pattern of such, test name filter, environment variable of the count, and the full count.
const SOAKS: &[(&str, &str, &str, &str, &str, u64)] = &[
    (
        "world",
        "cell",
        "*",
        "a_hundred_seeds_of_faults_break_nothing",
        "SEEDS",
        10_000,
    ),
    (
        "kill",
        "store",
        "kill",
        "a_process_killed_at_any_moment_loses_nothing_it_acknowledged",
        "KILLS",
        200,
    ),
    (
        "sizing",
        "store",
        "kill_sizing",
        "killed_between_any_two_writes_a_change_is_applied_once_or_not_at_all_and_the_log_says_which",
        "KILLS",
        200,
    ),
    (
        "recording",
        "store",
        "kill_recording",
        "a_recording_killed_at_any_moment_has_every_acknowledged_row_once",
        "KILLS",
        200,
    ),
    (
        "retention",
        "store",
        "kill_retention",
        "a_process_killed_while_it_removes_old_rows_leaves_nothing_half_removed",
        "KILLS",
        200,
    ),
    (
        "link",
        "cell",
        "link",
        "a_hundred_seeds_of_link_faults_move_nothing_wrong_and_the_part_is_finished",
        "SEEDS",
        1_000,
    ),
    (
        "text-link",
        "cell",
        "text_link_faults",
        "a_damaged_text_link_ends_in_a_defined_stop_and_what_cannot_be_noticed_is_counted",
        "SEEDS",
        1_000,
    ),
    (
        "blocks",
        "motion",
        "laws",
        "a_long_program_passes_through_a_bounded_window",
        "BLOCKS",
        10_000_000,
    ),
];

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["licences"] => licences(),
        ["soak", name] => soak(name),
        ["fuzz", ref words @ ..] => fuzz(words),
        _ => {
            eprintln!("usage: cargo xtask licences | cargo xtask soak NAME | cargo xtask fuzz NAME|all --seconds N\nsoaks:");
            for (name, package, _, test, _, count) in SOAKS {
                eprintln!("  {name:9} {package}::{test}, {count} times");
            }
            ExitCode::from(2)
        }
    }
}

/// Every crate that is built into the program has a licence that fits.
fn licences() -> ExitCode {
    let output = Command::new("cargo")
        .args(["metadata", "--format-version", "1", "--locked"])
        .stderr(Stdio::inherit())
        .output();
    let Ok(output) = output else {
        eprintln!("cargo metadata could not be started");
        return ExitCode::FAILURE;
    };
    let Ok(metadata) = serde_json::from_slice::<Value>(&output.stdout) else {
        eprintln!("cargo metadata gave no JSON");
        return ExitCode::FAILURE;
    };
    let mut bad = 0;
    let packages = metadata["packages"].as_array().map(Vec::as_slice).unwrap_or_default();
    for package in packages {
        let licence = package["license"].as_str().unwrap_or("");
        if !fits(licence) {
            bad += 1;
            eprintln!(
                "{} {}: licence '{licence}' is not on the list in xtask",
                package["name"], package["version"]
            );
        }
    }
    println!("licences: {} crates looked at, {bad} do not fit", packages.len());
    if bad == 0 && !packages.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// One alternative of an OR is enough; every part of an AND must fit. `/` is the old way to write OR.
fn fits(expression: &str) -> bool {
    let flat = expression.replace(['(', ')'], " ").replace('/', " OR ");
    flat.split(" AND ")
        .all(|part| part.split(" OR ").any(|licence| ALLOWED.contains(&licence.trim())))
}

/// The loop of `fuzz/`, built as the tests are: overflows and broken promises panic there.
fn fuzz(words: &[&str]) -> ExitCode {
    let status = Command::new("cargo")
        .args(["run", "--quiet", "--locked", "--package", "fuzz", "--"])
        .args(words)
        .status();
    match status.ok().and_then(|s| s.code()) {
        Some(code) => ExitCode::from(u8::try_from(code).unwrap_or(1)),
        None => ExitCode::FAILURE,
    }
}

fn soak(name: &str) -> ExitCode {
    let Some((_, package, file, test, variable, count)) = SOAKS.iter().find(|s| s.0 == name) else {
        eprintln!("there is no soak '{name}': cargo xtask lists them");
        return ExitCode::from(2);
    };
    let count = std::env::var(variable).ok().and_then(|v| v.parse().ok()).unwrap_or(*count);
    let commit = Command::new("git").args(["rev-parse", "--short", "HEAD"]).output();
    let commit = commit
        .map(|o| String::from_utf8_lossy(&o.stdout).trim().to_owned())
        .unwrap_or_default();
    let began = Instant::now();
    let status = Command::new("cargo")
        .args(["test", "--release", "-p", package, "--test", file, "--", test, "--nocapture"])
        .env(variable, count.to_string())
        .status();
    let good = status.is_ok_and(|s| s.success());
    println!("\n| soak | commit | count | result | seconds |\n|---|---|---|---|---|");
    println!(
        "| {name} | {commit} | {count} | {} | {:.0} |",
        if good { "all good" } else { "FAILED" },
        began.elapsed().as_secs_f64()
    );
    if good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

#[cfg(test)]
mod tests {
    use super::fits;

    #[test]
    fn one_good_alternative_is_enough_and_every_joined_part_must_fit() {
        assert!(fits("GPL-3.0 OR MIT"));
        assert!(fits("(MIT OR Apache-2.0) AND Unicode-3.0"));
        assert!(!fits("MIT AND GPL-3.0"));
        assert!(!fits(""));
    }
}
