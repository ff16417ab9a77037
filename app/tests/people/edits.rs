//! Edit access levels, and edits made outside.

use super::*;

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
