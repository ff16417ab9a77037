//! Real and hand-made files: every one opens or says why not, every instance can be asked for, and an unchanged save is the same bytes.

use part21::{Edits, File};
use std::path::{Path, PathBuf};

const SAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/samples/stepnc");

fn files() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in ["p21", "step-models", "ap238", "iso14649"] {
        let Ok(entries) = Path::new(SAMPLES).join(folder).read_dir() else {
            continue;
        };
        found.extend(entries.flatten().map(|entry| entry.path()));
    }
    found.sort();
    if found.is_empty() {
        println!("skipped: no sample files at {SAMPLES}");
    }
    found
}

#[expect(
    clippy::disallowed_methods,
    reason = "tests read sample files; the crate itself opens nothing"
)]
fn bytes_of(path: &Path) -> Vec<u8> {
    std::fs::read(path).expect("listed a moment ago")
}

#[test]
fn every_sample_saves_to_its_own_bytes() {
    for path in files() {
        let bytes = bytes_of(&path);
        let Ok(file) = File::read(bytes.clone()) else {
            assert!(!path.to_string_lossy().ends_with("p21"), "{path:?} does not open");
            continue;
        };
        for row in file.rows() {
            let id = file.id(row);
            assert_eq!(file.row(id), Some(row));
            let instance = file.instance(row);
            assert!(instance.is_ok(), "{path:?}: {instance:?}");
            assert!(bytes[file.span(row)].ends_with(b";"));
            for &user in file.users(row) {
                let text = String::from_utf8_lossy(&bytes[file.span(user)]).into_owned();
                assert!(text.contains(&format!("#{id}")), "{path:?}: {text}");
            }
        }
        assert_eq!(Edits::new(&file).save().expect("nothing to refuse").bytes, bytes, "{path:?}");
    }
}

#[test]
fn good_samples_have_no_problems() {
    for path in files() {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Ok(file) = File::read(bytes_of(&path)) else { continue };
        let codes: Vec<_> = file.problems().iter().map(|problem| problem.code).collect();
        let expected: &[&str] = match name.as_str() {
            "broken_truncated.p21" => &["truncated-instance", "truncated"],
            "broken_unterminated_string.p21" => &["unterminated-string"],
            // STEPcode's tests of parsers refer to instances that are not there.
            _ if name.contains("stepcode") || name == "nist_ex1.stp" => continue,
            _ => &[],
        };
        assert_eq!(codes, expected, "{name}: {:?}", file.problems());
    }
}
