//! Tools and offsets as people set them.

use super::*;

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
