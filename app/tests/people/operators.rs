//! Operators: who gives levels, names, lapsed qualifications, who is signed in.

use super::*;

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
