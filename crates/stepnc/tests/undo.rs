//! A change and its opposite give the bytes from before, whatever the file; no change gives the same bytes at once.

mod common;
use common::sample;
use stepnc::Program;
use stepnc::edit::{Insert, ProgramEdits, Target};
use stepnc::model::{ExecutableKind, ToolpathKind};
use stepnc::select::{Part, Spot};
use units::MmPerSec;

const FILES: [&str; 6] = [
    "ap238/plate_mm_e3.stpnc",
    "ap238/block_inch_nested_e1.stpnc",
    "ap238/plate_plan_and_twin_e3.stpnc",
    "ap238/plate_anchored_p21e3.stpnc",
    "ap238/plate_twin_external_p21e3.stpnc",
    "ap238/plate_trace_functions_e3.stpnc",
];

/// The corpus' part, and the sample files where they are.
fn programs() -> Vec<Program> {
    let bracket = include_bytes!("../../../corpus/bracket.stpnc").to_vec();
    let mut all = vec![Program::read("bracket.stpnc", bracket).expect("a Part 21 file")];
    all.extend(FILES.iter().filter_map(|name| sample(name)));
    all
}

fn changed(program: &Program, change: impl FnOnce(&mut ProgramEdits) -> bool) -> Option<Program> {
    let mut edits = ProgramEdits::new(program);
    if !change(&mut edits) {
        return None;
    }
    let saved = edits.save().expect("it can be saved");
    let after = Program::read(program.name(), saved.bytes).expect("a Part 21 file");
    assert_eq!(after.file().problems(), program.file().problems());
    Some(after)
}

/// Every executable of the plans with the workplan it stands in, and every toolpath with its operation.
fn spots(program: &Program) -> Vec<Spot> {
    let mut found = Vec::new();
    for project in program.projects() {
        program.walk(project.main_workplan, &mut |executable, _| {
            let below: Vec<Part> = match executable.kind {
                ExecutableKind::Workplan(ref children) => children.iter().copied().map(Part::Executable).collect(),
                ExecutableKind::Workingstep { operation, .. } => {
                    let operation = operation.and_then(|id| program.operation(id));
                    let paths = operation.map(|operation| operation.toolpaths.clone()).unwrap_or_default();
                    paths.into_iter().map(Part::Toolpath).collect()
                }
                _ => Vec::new(),
            };
            let parent = match executable.kind {
                ExecutableKind::Workingstep { operation, .. } => operation,
                _ => Some(executable.id),
            };
            found.extend(below.into_iter().map(|part| Spot { part, parent, turn: 0 }));
        });
    }
    found
}

#[track_caller]
fn same(before: &Program, after: &Program, what: &str) {
    let (a, b) = (before.file().bytes(), after.file().bytes());
    let differs = a.iter().zip(b).position(|(a, b)| a != b).unwrap_or(a.len().min(b.len()));
    assert!(
        a == b,
        "{}: {what}: from byte {differs} on: {:?}",
        before.name(),
        String::from_utf8_lossy(&b[differs.saturating_sub(60)..(differs + 60).min(b.len())])
    );
}

#[test]
fn no_edit_is_the_same_bytes() {
    for program in programs() {
        let saved = ProgramEdits::new(&program).save().expect("nothing to refuse");
        assert_eq!(saved.bytes, program.file().bytes());
        assert_eq!(saved.notices, Vec::<String>::new());
    }
}

#[test]
fn enabling_and_disabling_undo_each_other_one_and_all() {
    for program in programs() {
        let executables: Vec<(Part, bool)> = spots(&program)
            .into_iter()
            .filter_map(|spot| Some((spot.part, program.executable(spot.part.id())?.enabled)))
            .collect();
        let flip = |at: &Program, part: Part, enabled: bool| {
            let after = changed(at, |edits| edits.enable(part, enabled).is_ok()).expect("executables can be disabled");
            assert_eq!(
                after.executable(part.id()).map(|executable| executable.enabled),
                Some(enabled)
            );
            after
        };
        let mut all: Vec<Program> = Vec::new();
        for &(part, enabled) in &executables {
            let there = flip(&program, part, !enabled);
            same(&program, &flip(&there, part, enabled), &format!("{part:?} and back"));
            all.push(flip(all.last().unwrap_or(&program), part, !enabled));
        }
        // One after the other, taken back from the last to the first.
        let mut back: Option<Program> = None;
        for (n, &(part, enabled)) in executables.iter().enumerate().rev() {
            back = Some(flip(back.as_ref().unwrap_or(&all[n]), part, enabled));
        }
        if let Some(back) = back {
            same(&program, &back, "all of them");
        }
    }
}

#[test]
fn a_name_comes_back_whatever_it_was_in_between() {
    let between = [
        "",
        "it's",
        "a/b\\c",
        "Fläche ☃ \u{1F600}",
        "line\nbreak",
        "#12",
        "x[2]",
        "\\X2\\0041\\X0\\",
    ];
    for program in programs() {
        for (n, spot) in spots(&program).into_iter().enumerate() {
            let name_of = |program: &Program| match spot.part {
                Part::Executable(id) => program.executable(id).map(|executable| executable.name.clone()),
                Part::Toolpath(id) => Some(program.toolpath(id).name),
            };
            let old = name_of(&program).expect("it has a name");
            let new = between[n % between.len()];
            let there = changed(&program, |edits| edits.rename(spot.part, new).is_ok()).expect("it can be renamed");
            assert_eq!(name_of(&there).as_deref(), Some(new));
            let back = changed(&there, |edits| edits.rename(spot.part, &old).is_ok()).expect("it can be renamed");
            same(&program, &back, &format!("{:?} renamed to {new:?}", spot.part));
        }
    }
}

#[test]
fn what_moved_among_its_neighbours_moves_back() {
    for program in programs() {
        let all = spots(&program);
        for (n, spot) in all.iter().enumerate() {
            let neighbours: Vec<&Spot> = all.iter().filter(|other| other.parent == spot.parent).collect();
            let next = all.get(n + 1).filter(|next| next.parent == spot.parent);
            let around = spot.parent.filter(|_| matches!(spot.part, Part::Executable(_)));
            let home = match (next, around) {
                (Some(next), _) => Target::Before(*next),
                (None, Some(around)) => Target::EndOf(Part::Executable(around)),
                (None, None) => continue, // the last toolpath: behind it there is nothing to name
            };
            for other in neighbours.into_iter().filter(|other| *other != spot) {
                let there = changed(&program, |edits| edits.move_before(*spot, *other).is_ok()).expect("it can be moved");
                let back = changed(&there, |edits| edits.move_to(*spot, home).is_ok()).expect("it can be moved back");
                same(&program, &back, &format!("{:?} before {:?} and back", spot.part, other.part));
            }
        }
    }
}

#[test]
fn what_moved_to_another_workplan_moves_back() {
    for program in programs() {
        let all: Vec<Spot> = spots(&program)
            .into_iter()
            .filter(|spot| matches!(spot.part, Part::Executable(_)))
            .collect();
        for (n, spot) in all.iter().enumerate() {
            let home = match all.get(n + 1).filter(|next| next.parent == spot.parent) {
                Some(next) => Target::Before(*next),
                None => Target::EndOf(Part::Executable(spot.parent.expect("it stands in a workplan"))),
            };
            for other in all.iter().filter(|other| other.parent != spot.parent) {
                let Some(there) = changed(&program, |edits| edits.move_before(*spot, *other).is_ok()) else {
                    continue; // into itself
                };
                let now = Spot {
                    parent: other.parent,
                    ..*spot
                };
                let back = changed(&there, |edits| edits.move_to(now, home).is_ok()).expect("it can be moved back");
                same(&program, &back, &format!("{:?} before {:?} and back", spot.part, other.part));
            }
        }
    }
}

#[test]
fn what_was_inserted_is_deleted_without_a_trace() {
    let new = [
        Insert::Function("trace:1 get_time its_label=\"it's ☃\"".into()),
        Insert::Message("clamp it".into()),
        Insert::ProgramStop,
        Insert::Workplan("HOLES".into()),
    ];
    for program in programs() {
        for (n, spot) in spots(&program).into_iter().enumerate() {
            let Part::Executable(_) = spot.part else { continue };
            let mut id = 0;
            let there = changed(&program, |edits| {
                id = edits
                    .insert(Target::Before(spot), "new", &new[n % new.len()])
                    .expect("it can be inserted");
                true
            });
            let there = there.expect("it was changed");
            assert!(there.executable(id).is_some());
            let back = changed(&there, |edits| edits.delete(Part::Executable(id)).is_ok()).expect("it can be deleted");
            same(&program, &back, &format!("inserted before {:?} and deleted", spot.part));
        }
    }
}

#[test]
fn a_feed_comes_back() {
    for program in programs() {
        let inspected = stepnc::inspect::inspect(&program);
        let mut feeds = std::collections::BTreeMap::new();
        fn collect(nodes: &[stepnc::inspect::Node], feeds: &mut std::collections::BTreeMap<u64, f64>) {
            for node in nodes {
                feeds.extend(node.toolpaths.iter().filter_map(|path| Some((path.id, path.feed_mm_s?))));
                collect(&node.children, feeds);
            }
        }
        collect(&inspected.tree, &mut feeds);
        for (id, feed) in feeds {
            if program.toolpath(id).kind != ToolpathKind::Feed {
                continue;
            }
            let set = |at: &Program, feed: f64| {
                changed(at, |edits| edits.set_feed(Part::Toolpath(id), MmPerSec(feed)).is_ok()).expect("it has a feed")
            };
            let there = set(&program, feed + 1.25);
            same(&program, &set(&there, feed), &format!("the feed of #{id}"));
        }
    }
}
