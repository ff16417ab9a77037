//! The machine file as people make and name it.

use super::*;

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
