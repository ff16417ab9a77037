//! Operators, rights, edit access levels, and the tables that people set, as their users call them and as they would break them.

mod edits;
mod machine_file;
mod operators;
mod tables;

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const BRACKET: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/bracket.stpnc");
const PLATE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/plate.nc");

/// A data directory and the folder around it.
struct Shop(tempfile::TempDir);

impl Shop {
    fn new() -> Shop {
        Shop(tempfile::tempdir().expect("a folder"))
    }
    /// With Maria, level 1, Jo, level 6, and Ann, level 10.
    fn with_people() -> Shop {
        let shop = Shop::new();
        shop.good(&["operator", "add", "Maria", "--experience", "12 years, \"5 axes\""]);
        shop.good(&["operator", "add", "Jo", "--level", "6", "--operator", "Maria"]);
        shop.good(&["operator", "add", "Ann", "--operator", "Maria"]);
        shop
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
        command
            .args(words)
            .current_dir(self.0.path())
            .env("TOOLMARK_DATA", self.path("data"));
        command
    }
    fn run(&self, words: &[&str]) -> Output {
        self.command(words).output().expect("the binary starts")
    }
    /// Exit code and everything that was said.
    fn said(&self, words: &[&str]) -> (i32, String) {
        let output = self.run(words);
        (output.status.code().unwrap_or(-1), text(&output))
    }
    #[track_caller]
    fn good(&self, words: &[&str]) -> String {
        let (exit, said) = self.said(words);
        assert_eq!(exit, 0, "{words:?}: {said}");
        said
    }
    #[track_caller]
    fn refused(&self, exit: i32, words: &[&str], because: &str) {
        let (found, said) = self.said(words);
        assert_eq!(found, exit, "{words:?}: {said}");
        assert!(said.contains(because), "{words:?}: {said}");
    }
    #[track_caller]
    fn json(&self, words: &[&str]) -> Value {
        let output = self.run(&[words, &["--json"]].concat());
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{words:?}: {e}: {}", text(&output)))
    }
    /// The events of a kind, oldest first.
    fn events(&self, kind: &str) -> Vec<Value> {
        let connection = rusqlite::Connection::open(self.path("data/toolmark.sqlite")).expect("opens");
        let mut statement = connection
            .prepare("SELECT detail FROM events WHERE log = 0 AND kind = ?1 ORDER BY sequence")
            .expect("asks");
        let rows = statement.query_map([kind], |row| row.get::<_, String>(0)).expect("asks");
        rows.map(|row| serde_json::from_str(&row.expect("a row")).expect("JSON"))
            .collect()
    }
    #[track_caller]
    fn verifies(&self) {
        self.good(&["trace", "verify"]);
    }
    fn copy(&self, from: &str, name: &str) -> String {
        std::fs::copy(from, self.path(name)).expect("copied");
        name.to_owned()
    }
}

fn text(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}
