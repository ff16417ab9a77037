//! Edit access levels: what each part asks for, and that no row of allowed edits gets around one.

mod common;
use common::{program_of, says};
use expect_test::{Expect, expect};
use proptest::prelude::*;
use std::collections::BTreeMap;
use stepnc::edit::{Insert, ProgramEdits, Target};
use stepnc::levels::{DEFAULT, Levels, SetLevel, needed, reclassified};
use stepnc::select::Part;
use stepnc::{ExecutableKind, Program};

/// A program as it is written here.
#[derive(Clone, Debug)]
enum Node {
    Plan(&'static str, Vec<Node>),
    Step(&'static str),
    /// `4`, `4 workplan`, `off`, `off workplan`, anything else cannot be read.
    Set(&'static str),
    Disabled(Box<Node>),
    /// The part of that name once more.
    Again(&'static str),
}
use Node::{Again, Plan, Set, Step};

fn disabled(node: Node) -> Node {
    Node::Disabled(Box::new(node))
}

struct Writer {
    text: String,
    next: u64,
    known: BTreeMap<String, u64>,
}

impl Writer {
    fn node(&mut self, node: &Node) -> u64 {
        let id = self.next;
        self.next += 20;
        match node {
            Plan(name, children) => {
                self.text.push_str(&format!("#{id}=MACHINING_WORKPLAN('{name}','','','');\n"));
                self.known.insert((*name).to_owned(), id);
                for (n, child) in children.iter().enumerate() {
                    let child = self.node(child);
                    let link = self.next;
                    self.next += 1;
                    self.text.push_str(&format!(
                        "#{link}=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{id},#{child},{}.);\n",
                        n + 1
                    ));
                }
            }
            Step(name) => {
                self.known.insert((*name).to_owned(), id);
                self.text.push_str(&format!(
                    "#{id}=MACHINING_WORKINGSTEP('{name}','machining','','');\n\
                     #{r}=MACHINING_OPERATION_RELATIONSHIP('','machining',#{id},#{op});\n\
                     #{op}=FREEFORM_MILLING_OPERATION('{name} op','finishing','','');\n",
                    r = id + 1,
                    op = id + 2
                ));
            }
            Set(text) => {
                self.text.push_str(&format!(
                    "#{id}=MACHINING_NC_FUNCTION('set {text}','extended function','','');\n"
                ));
                self.text.push_str(&says(id + 1, id, "description", &format!("level {text}")));
            }
            Node::Disabled(inner) => {
                let inner = self.node(inner);
                let at = self.next;
                self.next += 10;
                self.text.push_str(&says(at, inner, "enabled", "disabled"));
                return inner;
            }
            Again(name) => return self.known[*name],
        }
        id
    }
}

fn program(root: &Node, more: &str) -> Program {
    let mut writer = Writer {
        text: String::new(),
        next: 1000,
        known: BTreeMap::new(),
    };
    writer.node(root);
    program_of(&format!("{}{more}", writer.text))
}

fn read(text: &str) -> Option<Result<SetLevel, String>> {
    let words: Vec<&str> = text.strip_prefix("level ")?.split_whitespace().collect();
    let workplan_only = words.get(1) == Some(&"workplan");
    let set = |level| Some(Ok(SetLevel { level, workplan_only }));
    match words[0] {
        "off" => set(None),
        number => match number.parse::<u8>() {
            Ok(level @ 1..=10) => set(Some(level)),
            _ => Some(Err(format!("{number} is no level"))),
        },
    }
}

fn levels(program: &Program) -> Levels {
    Levels::of(program, &read)
}

/// Name and level of every part, in order.
fn told(program: &Program) -> String {
    let levels = levels(program);
    let mut text = String::new();
    for project in program.projects() {
        program.walk(project.main_workplan, &mut |executable, _| {
            let level = levels.executable(executable.id).level;
            text.push_str(&format!("{} {level}\n", executable.name));
        });
    }
    text
}

#[track_caller]
fn check(root: Vec<Node>, expected: Expect) {
    expected.assert_eq(&told(&program(&Plan("main", root), "")));
}

#[test]
fn a_level_holds_for_the_rest_of_the_program_until_the_next_one() {
    check(
        vec![
            Step("a"),
            Plan("inner", vec![Step("b"), Set("4"), Step("c")]),
            Step("d"),
            Set("7"),
            Step("e"),
            Set("off"),
            Step("f"),
        ],
        expect![[r#"
            main 10
            a 10
            inner 10
            b 10
            set 4 4
            c 4
            d 4
            set 7 4
            e 7
            set off 7
            f 10
        "#]],
    );
}

#[test]
fn a_level_of_a_workplan_ends_with_it_and_the_outer_one_returns() {
    check(
        vec![
            Set("8"),
            Plan(
                "inner",
                vec![
                    Step("a"),
                    Set("3 workplan"),
                    Step("b"),
                    Plan("nested", vec![Step("c"), Set("2 workplan"), Step("d")]),
                    Step("e"),
                    Set("off workplan"),
                    Step("f"),
                ],
            ),
            Step("g"),
        ],
        expect![[r#"
            main 10
            set 8 8
            inner 8
            a 8
            set 3 workplan 3
            b 3
            nested 3
            c 3
            set 2 workplan 2
            d 2
            e 3
            set off workplan 3
            f 10
            g 8
        "#]],
    );
}

#[test]
fn what_is_disabled_sets_nothing_but_guards_what_is_disabled_with_it() {
    check(
        vec![
            disabled(Set("2")),
            Step("a"),
            disabled(Plan("off", vec![Set("3"), Step("b")])),
            Step("c"),
        ],
        expect![[r#"
            main 10
            set 2 2
            a 10
            off 10
            set 3 3
            b 3
            c 10
        "#]],
    );
}

#[test]
fn a_part_that_is_executed_twice_asks_for_the_stronger_of_its_places() {
    check(
        vec![Step("a"), Plan("p", vec![Step("b")]), Set("5"), Again("a"), Again("p")],
        expect![[r#"
            main 10
            a 5
            p 5
            b 5
            set 5 5
        "#]],
    );
}

#[test]
fn a_level_that_cannot_be_read_is_the_strongest() {
    let program = program(&Plan("main", vec![Set("four"), Step("a")]), "");
    assert_eq!(levels(&program).unreadable().len(), 1);
    assert_eq!(levels(&program).strongest().0, 1);
    expect![[r#"
        main 10
        set four 1
        a 1
    "#]]
    .assert_eq(&told(&program));
}

#[test]
fn the_stronger_of_place_and_classification_counts() {
    let root = Plan("main", vec![Step("a"), Set("5"), Step("b"), Step("c")]);
    // 1020 is a, 1081 is c with its operation 1083.
    let bare = program(&root, "");
    let id = |name: &str| stepnc::select::select(&bare, name).expect(name).id();
    let class = |at: u64, level: &str, items: &str| {
        format!(
            "#{at}=SECURITY_CLASSIFICATION_LEVEL('{level}');\n#{b}=SECURITY_CLASSIFICATION('Edit access level','',#{at});\n\
             #{c}=APPLIED_SECURITY_CLASSIFICATION_ASSIGNMENT(#{b},({items}));\n",
            b = at + 1,
            c = at + 2
        )
    };
    let (a, b, c) = (id("a"), id("b"), id("c"));
    let more = [
        class(9000, "3", &format!("#{a},#{b}")),
        class(9010, "8", &format!("#{c}")),
        class(9020, "secret", &format!("#{}", c + 2)),
        "#9030=SECURITY_CLASSIFICATION_LEVEL('1');\n#9031=SECURITY_CLASSIFICATION('confidential','',#9030);\n".to_owned(),
        format!("#9032=APPLIED_SECURITY_CLASSIFICATION_ASSIGNMENT(#9031,(#{c}));\n"),
    ];
    let program = program(&root, &more.concat());
    let levels = levels(&program);
    assert_eq!([a, b, c].map(|id| levels.executable(id).level), [3, 3, 5]);
    // An operation with a level that cannot be read: what is done to its workingstep does it to the operation too.
    assert_eq!(levels.strongest_below(&program, Part::Executable(c)), (1, c + 2));
}

#[test]
fn a_workplan_that_stands_in_itself_is_come_to_an_end_with() {
    let root = Plan("main", vec![Set("4"), Plan("p", vec![Step("a")])]);
    let p = stepnc::select::select(&program(&root, ""), "p").expect("p").id();
    let more = format!("#9000=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{p},#{p},5.);\n");
    assert_eq!(levels(&program(&root, &more)).executable(p).level, 4);
}

// -- no way around

fn nodes() -> impl Strategy<Value = Vec<Node>> {
    const STEPS: [&str; 8] = ["s0", "s1", "s2", "s3", "s4", "s5", "s6", "s7"];
    const PLANS: [&str; 4] = ["p0", "p1", "p2", "p3"];
    const SETS: [&str; 9] = ["2", "4", "6", "9", "off", "3 workplan", "5 workplan", "off workplan", "odd"];
    let leaf = prop_oneof![
        3 => proptest::sample::select(&STEPS[..]).prop_map(Step),
        2 => proptest::sample::select(&SETS[..]).prop_map(Set),
    ];
    let maybe_off = |strategy: BoxedStrategy<Node>| {
        (strategy, proptest::bool::weighted(0.15)).prop_map(|(node, off)| if off { disabled(node) } else { node })
    };
    let inner = maybe_off(leaf.boxed()).prop_recursive(3, 20, 5, move |inner| {
        (proptest::sample::select(&PLANS[..]), proptest::collection::vec(inner, 1..5))
            .prop_map(|(name, children)| Plan(name, children))
    });
    proptest::collection::vec(inner, 2..7)
}

/// Kind of edit, which part, where to, and what for.
type Asked = (u8, usize, usize, usize);

/// What an edit names, and whether what is below it counts too.
type Touched = Vec<(Part, bool)>;

/// Tries an edit; `None` when it cannot be made.
fn edited(before: &Program, asked: Asked) -> Option<(Vec<u8>, Touched)> {
    let mut all = Vec::new();
    before.walk(before.projects().first()?.main_workplan, &mut |executable, _| {
        all.push(executable.id)
    });
    let at = |n: usize| Part::Executable(all[n % all.len()]);
    let (part, other) = (at(asked.1), at(asked.2));
    let texts = [
        "level 1",
        "level 5",
        "level 8",
        "level 10",
        "level off",
        "level off workplan",
        "level 9 workplan",
        "note",
    ];
    let mut edits = ProgramEdits::new(before);
    let touched = match asked.0 % 6 {
        0 => edits.delete(part).ok().map(|()| vec![(part, true)]),
        1 => edits.move_before(part, other).ok().map(|()| vec![(part, true)]),
        2 => edits
            .enable(part, asked.3.is_multiple_of(2))
            .ok()
            .map(|()| vec![(part, true)]),
        3 => edits.rename(part, "renamed").ok().map(|()| vec![(part, false)]),
        4 => edits
            .move_to(
                match part {
                    Part::Executable(_) => stepnc::select::Spot::from(part),
                    other => other.into(),
                },
                Target::EndOf(other),
            )
            .ok()
            .map(|()| vec![(part, true)]),
        _ => {
            let what = Insert::Function(texts[asked.3 % texts.len()].to_owned());
            edits
                .insert(Target::Before(part.into()), "new", &what)
                .ok()
                .map(|_| Vec::new())
        }
    }?;
    Some((edits.save().ok()?.bytes, touched))
}

/// What has a level stronger than `own`: the level, the name, whether it is enabled, and what it says.
fn guarded(program: &Program, own: u8) -> BTreeMap<u64, (u8, String, bool, String)> {
    let levels = levels(program);
    let mut found = BTreeMap::new();
    program.walk(program.projects()[0].main_workplan, &mut |executable, _| {
        let level = levels.executable(executable.id).level;
        if level < own {
            let says = match &executable.kind {
                ExecutableKind::Function(function) => function.text.clone(),
                _ => String::new(),
            };
            found.insert(executable.id, (level, executable.name.clone(), executable.enabled, says));
        }
    });
    found
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    /// Whatever row of edits an operator is allowed to make: what had a stronger level is there after it as it was, with that level.
    #[test]
    fn no_row_of_allowed_edits_gets_around_a_level(
        root in nodes(),
        own in 1u8..=10,
        row in proptest::collection::vec((0u8..6, 0usize..40, 0usize..40, 0usize..8), 1..12),
    ) {
        let mut now = program(&Plan("main", root), "");
        let before = guarded(&now, own);
        for asked in row {
            let Some((bytes, touched)) = edited(&now, asked) else { continue };
            let after = Program::read("own.stpnc", bytes).expect("it was written by us");
            let old = levels(&now);
            let mut classes = ProgramEdits::new(&after);
            classes.classify(&reclassified(&old, &levels(&after))).expect("classified");
            let after = Program::read("own.stpnc", classes.save().expect("saved").bytes).expect("it was written by us");
            if needed((&now, &old), (&after, &levels(&after)), &touched).level < own {
                continue;
            }
            now = after;
            prop_assert_eq!(&guarded(&now, own), &before, "{:?}", asked);
        }
        prop_assert!(own < DEFAULT || !now.projects().is_empty());
    }
}
