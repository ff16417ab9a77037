//! Operators, rights, edit access levels, and the tables that people set, as their users call them and as they would break them.

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

// -- operators

#[test]
fn the_first_operator_has_level_one_and_only_levels_one_and_two_give_levels() {
    let shop = Shop::new();
    assert_eq!(shop.json(&["operator", "list"])["local"], true);
    shop.refused(
        2,
        &["operator", "add", "Maria", "--level", "4"],
        "the first operator has level 1",
    );
    shop.refused(
        2,
        &["operator", "add", "Maria", "--qualified-until", "2099-01-01"],
        "without an end",
    );
    let made = shop.json(&["operator", "add", "Maria"]);
    assert_eq!((&made["operator"]["level"], &made["by"]["local"]), (&1.into(), &true.into()));
    assert!(
        made["operator"]["assigned_by"]
            .as_str()
            .is_some_and(|by| by.starts_with("local")),
        "{made}"
    );

    shop.refused(1, &["operator", "add", "Jo"], "nobody is signed in");
    shop.refused(
        2,
        &["operator", "add", "Jo", "--operator", "Eve"],
        "Eve is no operator here; operators are Maria",
    );
    let jo = shop.json(&["operator", "add", "Jo", "--operator", "Maria"]);
    assert_eq!(jo["operator"]["level"], 10);
    shop.good(&["operator", "change", "Jo", "--level", "2", "--operator", "Maria"]);
    shop.good(&["operator", "add", "Ann", "--level", "3", "--operator", "Jo"]);
    shop.refused(
        1,
        &["operator", "add", "Tom", "--operator", "Ann"],
        "takes level 2 or better, and this is level 3",
    );
    shop.refused(
        1,
        &["operator", "change", "Maria", "--level", "9", "--operator", "Jo"],
        "level 1 is stronger than level 2",
    );
    shop.refused(
        1,
        &["operator", "remove", "Maria", "--operator", "Maria"],
        "the last operator of level 1",
    );
    assert_eq!(shop.events("refused").len(), 5);
    shop.verifies();
}

#[test]
fn odd_names_are_names_and_names_that_deceive_are_refused() {
    let shop = Shop::new();
    shop.good(&["operator", "add", "Maria"]);
    let odd = [
        "Robert'); DROP TABLE operators;--",
        "李 小龙",
        "O'Brien / \"Obi\" 100%",
        "Zoë 👷",
        "-x",
        "../..",
        "$(id)",
    ];
    for name in odd {
        shop.good(&["operator", "add", "--level", "5", "--operator", "Maria", "--", name]);
        let (who, why) = (format!("--operator={name}"), format!("--reason={name}"));
        shop.good(&["tool", "set", "5", "--wear-z", "-0.01", &why, &who]);
        shop.good(&["tool", "set", "5", "--wear-z", "0", &why, &who]);
    }
    assert_eq!(
        shop.json(&["operator", "list"])["operators"].as_array().map(Vec::len),
        Some(odd.len() + 1)
    );
    let long = "x".repeat(81);
    for (name, because) in [
        ("", "needs a name"),
        ("  ", "needs a name"),
        ("MARIA", "looks the same"),
        ("Maria\u{200b}", "nobody can see"),
        ("Ma\nria", "nobody can see"),
        ("local", "the program itself writes"),
        ("root (authenticated by the system)", "the program itself writes"),
        (long.as_str(), "81 characters"),
    ] {
        shop.refused(2, &["operator", "add", name, "--operator", "Maria"], because);
    }
    for level in ["0", "11", "-1", "one", "1.5", "256"] {
        shop.refused(
            2,
            &["operator", "add", "Tom", "--operator", "Maria", &format!("--level={level}")],
            "--level",
        );
    }
    shop.verifies();
}

#[test]
fn a_lapsed_qualification_counts_as_ten_and_cannot_be_dated_back() {
    let shop = Shop::with_people();
    for odd in ["tomorrow", "2026-02-30", "31.12.2026", ""] {
        shop.refused(
            2,
            &["operator", "change", "Jo", "--qualified-until", odd, "--operator", "Maria"],
            "was expected",
        );
    }
    shop.good(&[
        "operator",
        "change",
        "Jo",
        "--level",
        "2",
        "--qualified-until",
        "2020-12-31",
        "--operator",
        "Maria",
    ]);
    let told = shop.json(&["operator", "list"]);
    let jo = told["operators"]
        .as_array()
        .and_then(|all| all.iter().find(|o| o["name"] == "Jo"))
        .expect("Jo")
        .clone();
    assert_eq!(
        (&jo["level"], &jo["level_in_force"], &jo["lapsed"]),
        (&2.into(), &10.into(), &true.into())
    );
    let add = ["operator", "add", "Tom", "--operator", "Jo"];
    shop.refused(
        1,
        &add,
        "the qualification of Jo ended 2021-01-01T00:00:00Z and counts as level 10",
    );
    shop.refused(
        1,
        &[&add[..], &["--start", "2019-01-01T00:00:00Z"]].concat(),
        "counts as level 10",
    );
    shop.good(&[
        "operator",
        "change",
        "Jo",
        "--qualified-until",
        "never",
        "--operator",
        "Maria",
    ]);
    shop.good(&add);
    // Still good today, over at the time of a run that is dated later.
    shop.good(&[
        "operator",
        "change",
        "Jo",
        "--qualified-until",
        "2200-01-01",
        "--operator",
        "Maria",
    ]);
    shop.refused(
        1,
        &[
            "operator",
            "remove",
            "Tom",
            "--operator",
            "Jo",
            "--start",
            "2201-01-01T00:00:00Z",
        ],
        "level 10",
    );
}

#[test]
fn what_was_done_to_an_operator_is_taken_back_while_nothing_was_done_under_the_name() {
    let shop = Shop::with_people();
    let change = shop.json(&["operator", "change", "Jo", "--level", "3", "--operator", "Maria"]);
    let event = change["event"].to_string();
    shop.refused(2, &["operator", "undo", &event, "--operator", "Maria"], "needs a reason");
    let undone = shop.json(&["operator", "undo", &event, "--operator", "Maria", "--reason", "wrong person"]);
    assert_eq!(undone["operator"]["level"], 6);
    shop.refused(
        1,
        &["operator", "undo", &event, "--operator", "Maria", "--reason", "again"],
        "take that one back first",
    );
    shop.refused(
        2,
        &["operator", "undo", "1", "--operator", "Maria", "--reason", "x"],
        "made or changed no operator",
    );
    shop.refused(
        2,
        &["operator", "undo", "99999", "--operator", "Maria", "--reason", "x"],
        "made or changed no operator",
    );

    let again = shop.json(&["operator", "change", "Jo", "--level", "5", "--operator", "Maria"]);
    shop.good(&[
        "tool",
        "set",
        "5",
        "--wear-z",
        "-0.01",
        "--operator",
        "Jo",
        "--reason",
        "deep",
    ]);
    let event = again["event"].to_string();
    shop.refused(
        1,
        &["operator", "undo", &event, "--operator", "Maria", "--reason", "x"],
        "Jo has acted since",
    );
    shop.good(&["operator", "remove", "Ann", "--operator", "Maria", "--reason", "left"]);
    shop.refused(2, &["run", PLATE, "--fast", "--operator", "Ann"], "Ann is no operator here");
    shop.good(&[
        "operator",
        "add",
        "Ann",
        "--level",
        "8",
        "--operator",
        "Maria",
        "--reason",
        "came back",
    ]);
    shop.verifies();
}

#[test]
fn two_processes_at_once_make_every_operator_once() {
    let shop = Shop::new();
    shop.good(&["operator", "add", "Maria"]);
    let names: Vec<String> = (0..6).map(|n| format!("P{n}")).collect();
    let running: Vec<_> = (names.iter().chain(&names))
        .map(|name| {
            let mut command = shop.command(&["operator", "add", name, "--level", "4", "--operator", "Maria"]);
            command
                .stdout(std::process::Stdio::null())
                .stderr(std::process::Stdio::null());
            command.spawn().expect("starts")
        })
        .collect();
    let exits: Vec<Option<i32>> = running
        .into_iter()
        .map(|mut child| child.wait().expect("ends").code())
        .collect();
    // One of each pair makes it, the other one is told; on a slow computer some may have waited too long for the lock.
    assert!(exits.iter().all(|exit| matches!(exit, Some(0 | 2 | 4))), "{exits:?}");
    let made = exits.iter().filter(|exit| **exit == Some(0)).count();
    assert_eq!(
        shop.json(&["operator", "list"])["operators"].as_array().map(Vec::len),
        Some(made + 1)
    );
    assert_eq!(shop.events("operator-assigned").len(), made + 1);
    shop.verifies();
}

#[test]
fn who_is_not_signed_in_looks_and_changes_nothing() {
    let shop = Shop::with_people();
    shop.good(&["check", PLATE]);
    shop.good(&["tool", "list"]);
    shop.good(&["offset", "list"]);
    shop.good(&["machine", "show"]);
    shop.good(&["operator", "rights"]);
    shop.good(&["trace", "list"]);
    for words in [
        &["run", PLATE, "--fast"][..],
        &["tool", "set", "5", "--wear-z", "0.01", "--reason", "x"],
        &["offset", "set", "G54", "--x", "1", "--reason", "x"],
        &["machine", "init"],
        &["edit", BRACKET, "--out", "a.stpnc", "--disable", "face top", "--reason", "x"],
        &["operator", "remove", "Jo"],
        &["hold", "1", "--reason", "x"],
        &["size", "undo", "5", "--reason", "x"],
        &["size", "new-tool", "--offset", "5"],
        &["size", "enter", "--dimension", "D", "1"],
    ] {
        shop.refused(1, words, "nobody is signed in");
    }
    assert!(!shop.path("a.stpnc").exists() && !shop.path("data/machine.toml").exists());
    assert_eq!(shop.events("refused").len(), 10);
    shop.good(&["run", PLATE, "--fast", "--operator", "Ann"]);
    shop.verifies();
}

#[test]
fn a_name_that_is_only_given_is_marked_as_claimed_in_log_and_answers() {
    let shop = Shop::with_people();
    let told = shop.json(&["run", PLATE, "--fast", "--operator", "Jo"]);
    assert_eq!((&told["by"]["name"], &told["by"]["claimed"]), (&"Jo".into(), &true.into()));
    // Whoever the system signed in claims nothing; without operators it is enough.
    let alone = Shop::new();
    let told = alone.json(&["run", PLATE, "--fast"]);
    assert_eq!(
        (&told["by"]["authenticated_by"], &told["by"]["claimed"]),
        (&"system".into(), &false.into())
    );
    shop.refused(1, &["operator", "add", "Eve", "--operator", "Ann"], "level 2 or better");
    let refused = shop.events("refused");
    let detail = refused.last().expect("a refusal");
    assert_eq!(
        (&detail["who"], &detail["claimed"]),
        (&"Ann".into(), &true.into()),
        "{refused:#?}"
    );
    // What takes no right says the same of the name in its manifest.
    let to = shop.path("backup").display().to_string();
    shop.good(&["backup", &to, "--operator", "Maria"]);
    assert_eq!(shop.events("backup-begun")[0]["who"], "Maria (claimed)");
}

#[test]
fn recording_an_agent_takes_an_operator_and_a_backup_takes_nobody() {
    let shop = Shop::with_people();
    // Refused before anything is asked of the address: nobody listens there.
    shop.refused(1, &["record", "http://127.0.0.1:9/"], "takes an operator who is signed in");
    assert_eq!(shop.events("refused").last().expect("told")["action"], "record");
    shop.good(&["backup", &shop.path("backup").display().to_string()]);
    let table = shop.good(&["operator", "rights"]);
    assert!(table.contains("one that waits for a person is not made"), "{table}");
}

#[test]
fn a_large_step_of_a_size_takes_a_level_three_and_nobody_claims_more_than_the_own_level() {
    let shop = Shop::with_people();
    shop.good(&["operator", "add", "Kim", "--level", "3", "--operator", "Maria"]);
    let job = "name = \"EXAMPLE\"\nnumber = 200\nunit = \"inch\"\n\n[[dimension]]\nname = \"DIM A\"\nkind = \"outside diameter\"\n\
               nominal = 3.2342\ntolerance = 0.001\ntarget = 3.2342\nwindow = [3.22, 3.245]\nlargest_step = 0.005\ntool = 5\n";
    std::fs::write(shop.path("job.toml"), job).expect("written");
    shop.refused(
        1,
        &["size", "job", "job.toml", "--operator", "Jo"],
        "to say which sizes are entered takes level 3",
    );
    shop.good(&["size", "job", "job.toml", "--operator", "Kim"]);
    let enter = |who: &str, second: u32, more: &[&str]| {
        let start = format!("2026-11-21T08:00:{second:02}Z");
        let words = [
            "size",
            "enter",
            "--dimension",
            "DIM A",
            "3.2442",
            "--operator",
            who,
            "--start",
            &start,
        ];
        shop.said(&[&words[..], more].concat())
    };
    // The level 3 person's slip of the finger is one as well.
    for (n, who) in ["Ann", "Jo", "Kim", "Maria"].into_iter().enumerate() {
        let (exit, said) = enter(who, 5 * n as u32, &[]);
        assert!(
            exit == 1 && said.contains("a person of level 3 or better must enter it"),
            "{who}: {said}"
        );
    }
    let (exit, said) = enter("Jo", 30, &["--level", "3"]);
    assert!(
        exit == 1 && said.contains("takes level 3 or better, and this is level 6"),
        "{said}"
    );
    let (exit, said) = enter("Kim", 40, &["--level", "3"]);
    assert_eq!(exit, 0, "{said}");
    shop.verifies();
}

// -- tools and offsets

#[test]
fn a_tool_is_set_with_before_after_who_and_why_and_the_next_run_uses_it() {
    let shop = Shop::with_people();
    let set = [
        "tool",
        "set",
        "5",
        "--wear-z",
        "-0.025",
        "--operator",
        "Maria",
        "--reason",
        "measured 0.025 deep",
    ];
    let done = shop.json(&set);
    let change = &done["changes"][0];
    assert_eq!(change["register"], "sim-mill/tool/5/wear/z_mm");
    assert_eq!((&change["before"], &change["after"]), (&Value::Null, &(-0.025).into()));
    let list = shop.json(&["tool", "list"]);
    let five = &list["tools"][4];
    assert_eq!(
        (&five["number"], &five["wear_mm"]["z"], &five["geometry_mm"]["z"]),
        (&5.into(), &(-0.025).into(), &100.0.into())
    );
    assert_eq!(
        (&five["changed"]["who"], &five["changed"]["why"]),
        (&"Maria".into(), &"measured 0.025 deep".into())
    );
    assert_eq!(list["tools"][0]["changed"], Value::Null);
    let again = shop.json(&set);
    assert_eq!(again["changes"].as_array().map(Vec::len), Some(0));
    // In inches, all or none.
    shop.refused(
        2,
        &[
            "tool",
            "set",
            "5",
            "--wear-z",
            "0.001",
            "--diameter",
            "-1",
            "--units",
            "inch",
            "--operator",
            "Maria",
            "--reason",
            "x",
        ],
        "above 0",
    );
    assert_eq!(shop.json(&["tool", "list"])["tools"][4]["wear_mm"]["z"], -0.025);
    shop.good(&[
        "tool",
        "set",
        "5",
        "--wear-z",
        "0.001",
        "--units",
        "inch",
        "--operator",
        "Maria",
        "--reason",
        "x",
    ]);
    assert_eq!(shop.json(&["tool", "list"])["tools"][4]["wear_mm"]["z"], 0.0254);
    shop.verifies();
}

#[test]
fn numbers_that_cannot_be_are_refused_and_change_nothing() {
    let shop = Shop::new();
    for (option, value, because) in [
        ("--wear-z", "nan", "is not a number"),
        ("--wear-z", "inf", "is not a number"),
        ("--wear-z", "1e-3", "is not a number"),
        ("--wear-z", "", "no size was entered"),
        ("--wear-z", "1,234.5", "has both"),
        ("--wear-z", "1,234", "may mean"),
        ("--wear-z", "11", "more is no wear"),
        ("--wear-z", "-10.001", "more is no wear"),
        ("--length", "1300", "not longer than the travel of Z"),
        ("--diameter", "0", "above 0"),
        ("--diameter", "1001", "no tool is thicker"),
        ("--radius", "-0.1", "none is thinner than 0"),
        ("--tip-direction", "10", "0 to 9"),
        ("--tip-direction", "2.5", "0 to 9"),
    ] {
        shop.refused(2, &["tool", "set", "5", option, value, "--reason", "x"], because);
    }
    shop.refused(2, &["tool", "set", "5", "--reason", "x"], "nothing was given");
    shop.refused(2, &["tool", "set", "5", "--wear-z", "0.1"], "needs a reason");
    shop.refused(
        2,
        &["tool", "set", "5", "--wear-z", "0.1", "--reason", "  "],
        "needs a reason",
    );
    shop.refused(
        2,
        &["tool", "set", "55", "--wear-z", "0.1", "--reason", "x"],
        "has no tool 55",
    );
    shop.refused(
        2,
        &["tool", "set", "5", "--new", "--wear-z", "0.1", "--reason", "x"],
        "has tool 5 already",
    );
    for number in ["0", "10000", "x", "-1"] {
        shop.refused(2, &["tool", "set", number, "--wear-z", "0.1", "--reason", "x"], "");
    }
    for (name, axis, value, because) in [
        ("G54", "--x", "9000", "can be"),
        ("G54", "--x", "abc", "is not a number"),
        ("G45", "--x", "1", "no work offset"),
        ("G54.1 P301", "--x", "1", "no work offset"),
        ("", "--x", "1", "no work offset"),
    ] {
        shop.refused(2, &["offset", "set", name, axis, value, "--reason", "x"], because);
    }
    assert!(!shop.path("data/toolmark.sqlite").exists(), "nothing was even begun");
    shop.good(&["tool", "set", "55", "--new", "--length", "88,5", "--reason", "new"]);
    shop.good(&["offset", "set", "G54.1P12", "--z", "-1.5", "--reason", "new"]);
    shop.good(&["offset", "set", "Vice/left 50%", "--new", "--z", "-1.5", "--reason", "new"]);
    let offsets = shop.json(&["offset", "list"]);
    let names: Vec<&str> = offsets["offsets"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|o| o["name"].as_str())
        .collect();
    assert_eq!(names, ["G54", "G54.1 P12", "Vice/left 50%"]);
    shop.verifies();
}

#[test]
fn x_of_a_lathe_is_a_diameter_in_list_and_set() {
    let shop = Shop::new();
    let lathe = ["--machine", "sim-lathe"];
    let list = shop.json(&[&["tool", "list"][..], &lathe].concat());
    assert_eq!(list["diameters"], serde_json::json!(["x"]));
    assert_eq!(list["tools"][4]["geometry_mm"], serde_json::json!({ "x": 80.0, "z": 38.0 }));
    let said = shop.good(
        &[
            &["tool", "set", "5", "--wear-x", "-0.04", "--reason", "too large"][..],
            &lathe,
        ]
        .concat(),
    );
    assert!(said.contains("sim-lathe/tool/5/wear/x_mm (diameter)"), "{said}");
    // 0.5 mm of the tip is 1 mm of the diameter: a level 5 may go so far at once, and no further.
    shop.good(&["operator", "add", "Maria"]);
    shop.good(&["operator", "add", "Eva", "--level", "5", "--operator", "Maria"]);
    let set = |to: &str| {
        shop.said(&[
            "tool",
            "set",
            "5",
            "--wear-x",
            to,
            "--reason",
            "x",
            "--operator",
            "Eva",
            "--machine",
            "sim-lathe",
        ])
    };
    assert_eq!(set("0.95").0, 0);
    let (exit, said) = set("-0.2");
    assert!(exit == 1 && said.contains("so much at once takes level 3"), "{said}");
    shop.refused(
        1,
        &[
            "tool",
            "set",
            "5",
            "--radius",
            "0.2",
            "--reason",
            "x",
            "--operator",
            "Eva",
            "--machine",
            "sim-lathe",
        ],
        "geometry",
    );
    shop.refused(
        2,
        &[
            "offset",
            "set",
            "G54",
            "--y",
            "1",
            "--reason",
            "x",
            "--operator",
            "Eva",
            "--machine",
            "sim-lathe",
        ],
        "no axis Y",
    );
    shop.good(&[
        "offset",
        "set",
        "G54",
        "--x",
        "-480.5",
        "--reason",
        "x",
        "--operator",
        "Eva",
        "--machine",
        "sim-lathe",
    ]);
}

#[test]
fn a_change_is_taken_back_until_a_program_has_run_with_it() {
    let shop = Shop::new();
    let set = |to: &str| shop.json(&["tool", "set", "5", "--wear-z", to, "--reason", "x"])["changes"][0]["event"].to_string();
    let (one, two) = (set("-0.1"), set("-0.2"));
    shop.refused(1, &["tool", "undo", &one, "--reason", "x"], "a later change built on it");
    shop.refused(2, &["tool", "undo", &two], "needs a reason");
    shop.refused(2, &["offset", "undo", &two, "--reason", "x"], "changed no offset");
    shop.refused(
        2,
        &["tool", "undo", &two, "--reason", "x", "--machine", "sim-lathe"],
        "changed no tool of sim-lathe",
    );
    shop.good(&["tool", "undo", &two, "--reason", "slip"]);
    assert_eq!(shop.json(&["tool", "list"])["tools"][4]["wear_mm"]["z"], -0.1);
    // What was never there has nothing to go back to, and a diameter of 0 is none.
    let lathe = ["--machine", "sim-lathe"];
    let made = shop.json(&[&["tool", "set", "4", "--diameter", "30", "--reason", "x"][..], &lathe].concat());
    let made = made["changes"][0]["event"].to_string();
    shop.refused(
        1,
        &[&["tool", "undo", &made, "--reason", "x"][..], &lathe].concat(),
        "was not set before",
    );
    shop.good(&[&["tool", "list"][..], &lathe].concat());
    let three = set("-0.3");
    shop.good(&["run", PLATE, "--fast"]);
    shop.refused(
        1,
        &["tool", "undo", &three, "--reason", "slip"],
        "a program has run on sim-mill since",
    );
    shop.verifies();
}

// -- the machine file

#[test]
fn a_machine_file_is_made_and_is_the_machine_from_then_on() {
    let shop = Shop::with_people();
    shop.refused(1, &["machine", "init", "--operator", "Jo"], "takes level 2 or better");
    for name in ["a/b", "", "x\ny"] {
        shop.refused(2, &["machine", "init", "--operator", "Maria", "--name", name], "the name");
    }
    shop.good(&["machine", "init", "sim-lathe", "--operator", "Maria", "--name", "lathe 7"]);
    shop.refused(2, &["machine", "init", "--operator", "Maria"], "is there already");
    assert_eq!(shop.json(&["machine", "show"])["machine"], "lathe 7");
    assert_eq!(shop.json(&["tool", "list"])["kind"], "lathe");
    assert_eq!(shop.json(&["tool", "list", "--machine", "sim-mill"])["kind"], "mill");
    shop.good(&[
        "tool",
        "set",
        "5",
        "--geometry-x",
        "80.5",
        "--operator",
        "Maria",
        "--reason",
        "touched off",
    ]);
    let shown = shop.json(&["machine", "show"]);
    let value = |key: &str| {
        let all = shown["values"].as_array().expect("a list");
        all.iter()
            .find(|v| v["key"] == key)
            .unwrap_or_else(|| panic!("{key}"))
            .clone()
    };
    let changed = value("tools[5].geometry_x_mm");
    assert_eq!(changed["value"], "80.5");
    assert!(
        changed["from"].as_str().is_some_and(|f| f.contains("Maria: touched off")),
        "{changed}"
    );
    assert!(
        changed["in_file"].as_str().is_some_and(|f| f.starts_with("80.0 in line")),
        "{changed}"
    );
    assert_eq!(value("axes.x.diameter")["value"], "true");
    assert_eq!(value("store.quota_bytes")["from"], "default");

    let path = shop.path("data/machine.toml");
    let good = std::fs::read_to_string(&path).expect("reads");
    let line = |of: &str| 1 + good[..good.find(of).expect(of)].matches('\n').count();
    for (from, to, because) in [
        ("v_max_mm_s = 400.0", "v_max_mm_s = -4", "-4 cannot be"),
        ("v_max_mm_s = 400.0", "v_max_m_s = 4", "unknown field"),
        ("travel_max_mm = 0.0", "travel_max_mm = \"far\"", "invalid type"),
        ("max_rpm = 4500.0", "max_rpm = inf", "cannot be"),
        ("edited_outside = \"warn\"", "edited_outside = \"ask\"", "unknown variant"),
    ] {
        std::fs::write(&path, good.replacen(from, to, 1)).expect("written");
        for words in [
            &["machine", "show"][..],
            &["tool", "list"],
            &["run", PLATE, "--operator", "Maria"],
        ] {
            shop.refused(3, words, because);
            shop.refused(3, words, &format!("machine.toml:{}:", line(from)));
        }
    }
    std::fs::write(&path, good).expect("written");
    shop.verifies();
}

#[test]
fn a_machine_file_elsewhere_is_used_by_its_path() {
    let shop = Shop::new();
    shop.good(&["machine", "init", "--out", "mill-3.toml", "--name", "mill-3"]);
    shop.refused(2, &["machine", "init", "--out", "mill-3.toml"], "is there already");
    assert_eq!(
        shop.json(&["machine", "show", "--machine", "mill-3.toml"])["machine"],
        "mill-3"
    );
    assert_eq!(shop.json(&["machine", "show"])["machine"], "sim-mill");
    shop.refused(3, &["machine", "show", "--machine", "none.toml"], "none.toml");
    shop.good(&["run", PLATE, "--fast", "--machine", "mill-3.toml"]);
}

// -- edit access levels

/// The bracket with `round pocket` and what follows it in OP10 at level 4, and what follows in OP20 back at 10.
fn guarded(shop: &Shop) -> String {
    let words = [
        "edit",
        BRACKET,
        "--out",
        "guarded.stpnc",
        "--operator",
        "Maria",
        "--reason",
        "released",
        "--insert",
    ];
    let set = "trace:1 set_edit_access_level its_level=4 its_scope=workplan";
    shop.good(&[&words[..], &["round pocket", set]].concat());
    "guarded.stpnc".to_owned()
}

#[test]
fn an_edit_is_refused_by_level_and_recorded_by_name() {
    let shop = Shop::with_people();
    let file = guarded(&shop);
    let bytes = std::fs::read(shop.path(&file)).expect("written");
    let text = String::from_utf8_lossy(&bytes);
    assert!(
        text.contains("SECURITY_CLASSIFICATION('edit access level','',") && text.contains("SECURITY_CLASSIFICATION_LEVEL('4')")
    );

    let edit = |who: &str, words: &[&str]| {
        let all = [
            &["edit", &file, "--out", "out.stpnc", "--operator", who, "--reason", "because"][..],
            words,
        ]
        .concat();
        shop.said(&all)
    };
    // Before the function, and behind the workplan in which it stands, the level is the default.
    for words in [
        &["--disable", "face top"][..],
        &["--feed", "drill holes=400"],
        &["--rename", "side slot=slot"],
    ] {
        let (exit, said) = edit("Ann", words);
        assert_eq!(exit, 0, "{words:?}: {said}");
    }
    std::fs::remove_file(shop.path("out.stpnc")).expect("was written");
    // Behind it, and what would raise or lower it.
    for words in [
        &["--disable", "round pocket"][..],
        &["--feed", "round pocket=400"],
        &["--feed", "wave groove=400"],
        &["--rename", "wave groove=x"],
        &["--delete", "wave groove"],
        &["--disable", "OP10 top"],
        &["--move", "wave groove=face top"],
        &["--move", "wave groove=drill holes"],
        &["--move", "drill holes=wave groove"],
        &["--insert", "wave groove", "message: hello"],
        &["--delete", "set_edit_access_level"],
        &["--disable", "set_edit_access_level"],
        &["--move", "set_edit_access_level=drill holes"],
        &["--move", "set_edit_access_level=wave groove"],
        &["--insert", "wave groove", "trace:1 set_edit_access_level its_level=6"],
        &["--insert", "wave groove", "trace:1 set_edit_access_level"],
        &["--insert", "face top", "trace:1 set_edit_access_level its_level=3"],
        &["--disable", "face top", "--disable", "round pocket"],
    ] {
        let (exit, said) = edit("Jo", words);
        assert!(
            exit == 1 && said.contains("T-11") && said.contains("this is level 6"),
            "{words:?}: {said}"
        );
        assert!(!shop.path("out.stpnc").exists(), "{words:?}");
    }
    let refused = shop.events("edit-refused");
    assert_eq!(refused.len(), 18);
    assert_eq!(
        (&refused[0]["who"], &refused[0]["code"], &refused[0]["needed"]),
        (&"Jo".into(), &"T-11".into(), &4.into())
    );

    let (exit, said) = edit("Maria", &["--feed", "round pocket=400", "--rename", "wave groove=groove"]);
    assert_eq!(exit, 0, "{said}");
    let told = shop.events("program-edited").pop().expect("told");
    assert_eq!(
        (&told["who"], &told["why"], &told["level"]),
        (&"Maria".into(), &"because".into(), &1.into())
    );
    assert_eq!(told["edits"][0]["part"]["name"], "round pocket");
    assert_eq!(told["edits"][0]["after"]["feeds_mm_min"][0], 400.0);
    assert_eq!(
        (&told["edits"][1]["before"], &told["edits"][1]["after"]),
        (&"wave groove".into(), &"groove".into())
    );
    let hash = |name: &str| ledger::Hash::of(&std::fs::read(shop.path(name)).expect("reads")).to_string();
    assert_eq!(
        (told["before_sha256"].as_str(), told["sha256"].as_str()),
        (Some(&*hash(&file)), Some(&*hash("out.stpnc")))
    );
    assert!(told["instances"]["count"].as_u64().is_some_and(|n| n >= 2), "{told}");
    // A reason is needed where there are operators.
    shop.refused(
        2,
        &[
            "edit",
            &file,
            "--out",
            "o2.stpnc",
            "--operator",
            "Maria",
            "--disable",
            "face top",
        ],
        "needs a reason",
    );
    shop.verifies();
}

#[test]
fn a_level_and_its_taking_away_give_the_same_file() {
    let shop = Shop::with_people();
    let file = guarded(&shop);
    let original = std::fs::read(BRACKET).expect("the corpus");
    assert_ne!(std::fs::read(shop.path(&file)).expect("written"), original);
    let words = [
        "edit",
        &file,
        "--out",
        "back.stpnc",
        "--operator",
        "Maria",
        "--reason",
        "x",
        "--delete",
        "set_edit_access_level",
    ];
    shop.good(&words);
    assert_eq!(std::fs::read(shop.path("back.stpnc")).expect("written"), original);
}

#[test]
fn a_classification_guards_a_part_wherever_it_stands() {
    let shop = Shop::with_people();
    let file = guarded(&shop);
    // Somebody takes the function out by a text editor: what it had classified is still guarded.
    let text = std::fs::read_to_string(shop.path(&file)).expect("text");
    let cut = text.replace("set_edit_access_level its_level=4", "get_time                         ");
    assert_ne!(cut, text);
    std::fs::write(shop.path("cut.stpnc"), cut).expect("written");
    let (exit, said) = shop.said(&[
        "edit",
        "cut.stpnc",
        "--out",
        "o.stpnc",
        "--operator",
        "Jo",
        "--reason",
        "x",
        "--feed",
        "round pocket=400",
    ]);
    assert!(exit == 1 && said.contains("T-11"), "{said}");
    shop.good(&[
        "edit",
        "cut.stpnc",
        "--out",
        "o.stpnc",
        "--operator",
        "Jo",
        "--reason",
        "x",
        "--feed",
        "face top=400",
    ]);
    // A level that cannot be read guards like the strongest.
    let odd = text
        .replace("its_level=4", "its_level=four")
        .replace("SECURITY_CLASSIFICATION_LEVEL('4')", "SECURITY_CLASSIFICATION_LEVEL('IV')");
    std::fs::write(shop.path("odd.stpnc"), odd).expect("written");
    let (exit, said) = shop.said(&[
        "edit",
        "odd.stpnc",
        "--out",
        "o2.stpnc",
        "--operator",
        "Jo",
        "--reason",
        "x",
        "--rename",
        "wave groove=x",
    ]);
    assert!(exit == 1 && said.contains("level 1"), "{said}");
}

#[test]
fn without_operators_an_edit_is_made_by_local_and_recorded() {
    let shop = Shop::new();
    let done = shop.json(&["edit", BRACKET, "--out", "a.stpnc", "--disable", "face top"]);
    assert_eq!(
        (&done["changed"], &done["by"]["local"], &done["by"]["level"]),
        (&true.into(), &true.into(), &1.into())
    );
    assert_eq!(shop.events("program-edited").len(), 1);
    let same = shop.json(&["edit", BRACKET, "--out", "b.stpnc"]);
    assert_eq!((&same["changed"], &same["event"]), (&false.into(), &Value::Null));
    assert_eq!(
        std::fs::read(shop.path("b.stpnc")).expect("written"),
        std::fs::read(BRACKET).expect("the corpus")
    );
    assert_eq!(shop.events("program-edited").len(), 1);
    shop.refused(
        4,
        &["edit", BRACKET, "--out", "no/where/a.stpnc", "--disable", "face top"],
        "cannot be written",
    );
}

// -- edits made outside

fn append(path: &Path, text: &str) {
    let mut all = std::fs::read_to_string(path).expect("reads");
    all.push_str(text);
    std::fs::write(path, all).expect("written");
}

#[test]
fn an_edit_made_outside_is_seen_at_cycle_start_and_stands_in_log_and_report() {
    let shop = Shop::with_people();
    let file = shop.copy(PLATE, "plate.nc");
    let run = |more: &[&str]| shop.said(&[&["run", &file, "--fast", "--operator", "Ann", "--out", "out"][..], more].concat());
    assert_eq!(run(&[]).0, 0);
    let (exit, said) = run(&[]);
    assert!(exit == 0 && !said.contains("edited outside"), "{said}");
    append(&shop.path(&file), "(one more line)\n");
    let (exit, said) = shop.said(&["check", &file]);
    assert!(
        exit == 0 && said.contains("was edited outside since its first run here"),
        "{said}"
    );
    let (exit, said) = run(&["--edited-outside", "refuse"]);
    assert!(exit == 1 && said.contains("--edited-outside refuses that"), "{said}");
    let (exit, said) = run(&[]);
    assert!(exit == 0 && said.contains("was edited outside"), "{said}");
    let report: Value = serde_json::from_slice(&std::fs::read(shop.path("out/report.json")).expect("reads")).expect("JSON");
    assert!(
        report["findings"].to_string().contains("was edited outside"),
        "{}",
        report["findings"]
    );
    let told = shop.events("program-changed-outside");
    assert_eq!(told.len(), 1);
    assert_ne!(told[0]["before_sha256"], told[0]["sha256"]);
    assert_eq!(shop.events("program-refused").len(), 1);
    let (exit, said) = run(&[]);
    assert!(exit == 0 && !said.contains("edited outside"), "it is known now: {said}");
    shop.verifies();
}

#[test]
fn a_machine_file_that_refuses_edits_made_outside_is_overruled_by_level_three_with_a_reason_only() {
    let shop = Shop::with_people();
    shop.good(&["machine", "init", "--operator", "Maria"]);
    let toml = shop.path("data/machine.toml");
    let text = std::fs::read_to_string(&toml).expect("reads");
    std::fs::write(
        &toml,
        text.replace("edited_outside = \"warn\"", "edited_outside = \"refuse\""),
    )
    .expect("written");
    let file = "edited.stpnc";
    shop.good(&[
        "edit",
        BRACKET,
        "--out",
        file,
        "--disable",
        "face top",
        "--operator",
        "Maria",
        "--reason",
        "x",
    ]);
    let run = |who: &str, more: &[&str]| shop.said(&[&["run", file, "--fast", "--operator", who][..], more].concat());
    assert_eq!(run("Ann", &[]).0, 0, "an edit of our own is none made outside");
    append(&shop.path(file), "/* mine */\n");
    assert_eq!(shop.said(&["check", file]).0, 1);
    let (exit, said) = run("Ann", &[]);
    assert!(
        exit == 1 && said.contains("since its last edit") && said.contains("the machine file refuses that"),
        "{said}"
    );
    let accept = ["--edited-outside", "warn"];
    let (exit, said) = run("Jo", &accept);
    assert!(exit == 1 && said.contains("takes level 3 or better"), "{said}");
    let (exit, said) = run("Maria", &accept);
    assert!(exit == 2 && said.contains("needs a reason"), "{said}");
    // An edit on top of it would hide it.
    let (exit, said) = shop.said(&[
        "edit",
        file,
        "--out",
        file,
        "--enable",
        "face top",
        "--operator",
        "Maria",
        "--reason",
        "x",
    ]);
    assert!(exit == 1 && said.contains("edited outside"), "{said}");
    let (exit, said) = run("Maria", &["--edited-outside", "warn", "--reason", "only a comment"]);
    assert_eq!(exit, 0, "{said}");
    assert_eq!(
        shop.events("program-changed-outside").pop().map(|e| e["why"].clone()),
        Some("only a comment".into())
    );
    assert_eq!(run("Ann", &[]).0, 0);
    shop.verifies();
}
