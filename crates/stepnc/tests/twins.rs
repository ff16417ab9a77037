//! As-executed models: what is written into a file is found again, and the plan stays as it was.

mod common;
use common::{one_path, outline, sample};
use expect_test::expect;
use plan::executed::{AsExecuted, Deviation, ExecutedPoint, ExecutedToolpath, ExecutedWorkingstep, PathKind, ResultValue};
use stepnc::inspect::inspect;
use stepnc::twin::{self, Placement, TwinOptions, TwinRun, WriteError};
use stepnc::{ExecutableKind, Program, ToolpathKind};
use units::{Millimetres, MmPerSec, Point, Seconds, Timestamp, ToolNumber};

/// 2026-11-21T10:30:00Z.
const START: Timestamp = Timestamp(1_795_257_000_000_000_000);

fn deviation(max: f64) -> Option<Deviation> {
    Some(Deviation {
        max: Millimetres(max),
        p95: Millimetres(max / 2.0),
        rms: Millimetres(max / 4.0),
        samples: 12,
    })
}

/// A run of the plan in `program`: every enabled toolpath, 0.01 mm beside its planned one, 10 mm/s.
fn run_of(program: &Program) -> AsExecuted {
    let main = program.plan().expect("the file has a plan").main_workplan;
    let mut clock = START;
    let mut workingsteps = Vec::new();
    let mut steps = Vec::new();
    program.walk(main, &mut |executable, enabled| {
        if let (
            ExecutableKind::Workingstep {
                operation: Some(operation),
                ..
            },
            true,
        ) = (&executable.kind, enabled)
        {
            steps.push((executable.id, executable.name.clone(), *operation));
        }
    });
    for (id, name, operation) in steps {
        let start = clock;
        let mut toolpaths = Vec::new();
        for &path in &program.operation(operation).expect("it was read").toolpaths {
            let planned = program.toolpath(path);
            let begin = clock;
            let mut points = Vec::new();
            for piece in program.path(&planned).map_while(Result::ok) {
                piece.flatten(0.01, 1000, |u, place| {
                    if u > 0.0 || points.is_empty() {
                        clock = Timestamp(clock.0 + 100_000_000);
                        let [x, y, z] = place.xyz;
                        points.push(ExecutedPoint {
                            at: clock,
                            position: Point::new(x + 0.01, y, z),
                        });
                    }
                });
            }
            clock = Timestamp(clock.0 + 250_000_000);
            toolpaths.push(ExecutedToolpath {
                name: planned.name.clone(),
                plan: Some(path),
                kind: match planned.kind {
                    ToolpathKind::Rapid => PathKind::Rapid,
                    ToolpathKind::Feed => PathKind::Feed,
                    ToolpathKind::Dwell => PathKind::Dwell,
                },
                start: begin,
                end: clock,
                points,
                speed: if planned.kind == ToolpathKind::Feed {
                    MmPerSec(10.0)
                } else {
                    MmPerSec::ZERO
                },
                deviation: deviation(0.01),
            });
        }
        workingsteps.push(ExecutedWorkingstep {
            name,
            plan: Some(id),
            within: vec![("main".into(), Some(main))],
            start,
            end: clock,
            worktime: Seconds(2.5),
            planned: Some(Seconds(3.25)),
            exception: None,
            tool: program.tool_of(operation).and_then(|tool| tool.number),
            deviation: deviation(0.02),
            toolpaths,
            results: vec![ResultValue {
                name: "X.LOAD maximum".into(),
                value: 71.5,
                unit: "PERCENT".into(),
                quality: "measured".into(),
                at: clock,
            }],
        });
    }
    AsExecuted {
        name: "run 1".into(),
        source: "SIMULATED sim-mill, seed 1".into(),
        simulated: true,
        start: START,
        end: clock,
        worktime: Seconds(7.5),
        exception: Some("stopped by the operator's hand".into()),
        plan: Some(main),
        workingsteps,
    }
}

fn options() -> TwinOptions {
    TwinOptions {
        machine: Some(("SN-1".into(), "mill".into())),
        operator: Some("Erika".into()),
        ..TwinOptions::at(Timestamp(START.0 + 3_600_000_000_000))
    }
}

/// Everything but the times of single points, which no file holds, and points to the nanometre.
fn comparable(run: &AsExecuted) -> AsExecuted {
    let mut run = run.clone();
    for step in &mut run.workingsteps {
        step.within = Vec::new();
        for path in &mut step.toolpaths {
            for point in &mut path.points {
                point.at = Timestamp(0);
                point.position.xyz = point.position.xyz.map(|c| (c * 1e6).round() / 1e6 + 0.0);
            }
            if path.kind != PathKind::Feed {
                path.speed = MmPerSec::ZERO;
            }
        }
    }
    run
}

#[track_caller]
fn check_round_trip(program: &Program, options: &TwinOptions) -> Program {
    let run = run_of(program);
    let saved = twin::append(program, &run, options).expect("it fits");
    assert_eq!(
        saved.bytes,
        twin::append(program, &run, options).expect("it fits").bytes,
        "same run, same bytes"
    );
    let written = Program::read(program.name(), saved.bytes).expect("it is a Part 21 file");
    assert_eq!(written.file().problems(), program.file().problems());
    for row in program.file().rows() {
        let id = program.file().id(row);
        let again = written.file().row(id).expect("nothing of the plan is lost");
        assert_eq!(
            program.file().bytes()[program.file().span(row)],
            written.file().bytes()[written.file().span(again)],
            "#{id}"
        );
    }
    let found = twin::read(&written, &written);
    let TwinRun {
        run: read,
        external_plan,
        ..
    } = found.last().expect("the twin is there");
    assert_eq!(*external_plan, None);
    assert_eq!(comparable(read), comparable(&run));
    written
}

const LINE: &str =
    "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,0.5));\n#202=CARTESIAN_POINT('',(1.,0.,0.5));\n";

#[test]
fn a_run_is_written_in_the_unit_of_its_planned_path_and_read_back() {
    let written = check_round_trip(&one_path(LINE, 10), &options());
    let bytes = String::from_utf8_lossy(written.file().bytes()).into_owned();
    // 0.01 mm beside a path in inches.
    assert!(bytes.contains("CARTESIAN_POINT('',(1.000393701,0.,0.5))"), "{bytes}");
    assert!(
        bytes.contains("FILE_NAME('own','2026-11-21T11:30:00Z',(''),(''),'toolmark','','');")
            && bytes.contains("LOCAL_TIME(10,30,0.,"),
        "{bytes}"
    );
    expect![[r#"
        step-nc MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA inch
        Summary { workingsteps_enabled: 1, workingsteps_disabled: 0, toolpaths: 1, rapids: 0, dwells: 0, tools: 1, nc_functions: 0 }
        #100 workplan 'main' of project 'main'
          #101 workingstep 'step' Number(1)
            #110 feed 'path' 25.400 mm, 10.000 mm/s, 1500.000 rpm cw
        #217 workplan 'main / run 1' of project 'main run 1' twin of Some(100)
          #271 workingstep 'step as executed' twin of Some(101) Number(1)
            #221 feed 'path' 25.400 mm, - mm/s, - rpm -
        Remark 31:1 no-project x1: #100: the file has no machining project of a plan: workplans that nobody executes stand for it
    "#]].assert_eq(&outline(&inspect(&written)));
}

#[test]
fn the_same_plate_with_a_run_of_ours_counts_as_before() {
    let Some(plate) = sample("ap238/plate_mm_e3.stpnc") else {
        return;
    };
    let before = inspect(&plate).summary;
    let written = check_round_trip(&plate, &options());
    let after = inspect(&written);
    assert_eq!(after.summary, before);
    assert_eq!(after.tree.len(), 2);
    assert!(after.tree[1].twin && after.tree[1].children.len() == 3);
    let paths: usize = after.tree[1].children.iter().map(|step| step.toolpaths.len()).sum();
    assert_eq!(paths, 28);
    assert_eq!(after.problems, []);
    // A second run beside the first.
    let twice = check_round_trip(&written, &options());
    assert_eq!(twin::read(&twice, &twice).len(), 2);
}

#[test]
fn a_run_may_be_a_disabled_workplan_of_its_plan() {
    let options = TwinOptions {
        placement: Placement::Workplan,
        ..options()
    };
    let written = check_round_trip(&one_path(LINE, 7), &options);
    let tree = inspect(&written);
    assert_eq!((tree.tree.len(), tree.summary.toolpaths), (1, 1));
    assert!(tree.tree[0].children[1].twin && !tree.tree[0].children[1].enabled);
}

#[test]
fn nested_workplans_of_the_plan_are_nested_in_the_run() {
    let Some(block) = sample("ap238/block_inch_nested_e1.stpnc") else {
        return;
    };
    let mut run = run_of(&block);
    for (step, within) in run
        .workingsteps
        .iter_mut()
        .zip([&[405, 392][..], &[405, 392], &[405], &[405], &[]])
    {
        step.within = within.iter().map(|&id| (format!("wp {id}"), Some(id))).collect();
    }
    let saved = twin::append(&block, &run, &options()).expect("it fits");
    assert!(
        saved.notices.iter().any(|notice| notice.contains("edition")),
        "{:?}",
        saved.notices
    );
    let written = Program::read("block.stpnc", saved.bytes).expect("a Part 21 file");
    let tree = inspect(&written);
    let shape = |node: &stepnc::inspect::Node| {
        fn text(node: &stepnc::inspect::Node) -> String {
            let inner: Vec<String> = node.children.iter().map(text).collect();
            format!("{}({})", node.twin_of.unwrap_or(0), inner.join(" "))
        }
        text(node)
    };
    assert_eq!(shape(&tree.tree[1]), "418(405(392(191() 240()) 289() 338()) 387())");
    assert!(tree.tree[1].children[0].twin);
}

#[test]
fn a_run_without_a_plan_is_a_file_of_its_own() {
    let mut run = run_of(&one_path(LINE, 10));
    run.plan = None;
    for step in &mut run.workingsteps {
        step.plan = None;
        step.within.clear();
        step.results.clear();
        for path in &mut step.toolpaths {
            path.plan = None;
        }
    }
    let bytes = stepnc::write_new(&run, &options()).expect("it can be written");
    assert_eq!(
        bytes,
        stepnc::write_new(&run, &options()).expect("it can be written"),
        "same run, same bytes"
    );
    let written = Program::read("new.stpnc", bytes).expect("a Part 21 file");
    assert_eq!(written.file().problems(), []);
    let found = twin::read(&written, &written);
    let (found, run) = (comparable(&found[0].run), comparable(&run));
    assert_eq!(
        found.workingsteps[0].toolpaths[0].points,
        run.workingsteps[0].toolpaths[0].points
    );
    assert_eq!(
        (found.plan, found.workingsteps[0].tool, found.start),
        (None, Some(ToolNumber(1)), run.start)
    );
    expect![[r#"
        step-nc MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA mm
        Summary { workingsteps_enabled: 1, workingsteps_disabled: 0, toolpaths: 1, rapids: 0, dwells: 0, tools: 1, nc_functions: 0 }
        #31 workplan 'run 1' of project 'run 1' twin of None
          #89 workingstep 'step as executed' twin of None Number(1)
            #39 feed 'path' 25.400 mm, 10.000 mm/s, - rpm -
    "#]].assert_eq(&outline(&inspect(&written)));
}

#[test]
fn runs_of_others_are_read_with_their_links() {
    let Some(program) = sample("ap238/plate_plan_and_twin_e3.stpnc") else {
        return;
    };
    let found = twin::read(&program, &program);
    assert_eq!(found.len(), 1);
    let run = &found[0].run;
    assert_eq!(
        (run.plan, run.name.as_str(), run.worktime),
        (Some(703), "run 0001", Seconds(59.4))
    );
    assert_eq!(run.exception.as_deref(), Some("stopped by operator after hole 2"));
    let links: Vec<_> = run
        .workingsteps
        .iter()
        .map(|step| {
            (
                step.plan,
                step.toolpaths
                    .iter()
                    .map(|path| (path.plan, path.points.len()))
                    .collect::<Vec<_>>(),
            )
        })
        .collect();
    assert_eq!(
        links,
        [
            (Some(194), vec![(Some(120), 12), (Some(137), 12), (Some(157), 12)]),
            (Some(649), vec![(Some(437), 12), (Some(490), 12)])
        ]
    );
    assert_eq!(
        run.workingsteps[0].deviation.map(|deviation| deviation.max),
        Some(Millimetres(0.0063))
    );
    assert_eq!(run.workingsteps[0].start, Timestamp(START.0 + 1_250_000_000));
}

#[test]
fn a_run_in_another_file_finds_its_plan_by_anchors() {
    let (Some(plan), Some(external)) = (
        sample("ap238/plate_anchored_p21e3.stpnc"),
        sample("ap238/plate_twin_external_p21e3.stpnc"),
    ) else {
        return;
    };
    let found = twin::read(&external, &plan);
    assert_eq!(
        found[0].external_plan.as_deref(),
        Some("plate_anchored_p21e3.stpnc#main_workplan")
    );
    let step = &found[0].run.workingsteps[0];
    assert_eq!(
        (found[0].run.plan, step.plan, step.toolpaths[0].plan),
        (Some(703), Some(194), Some(120))
    );
}

#[test]
fn a_run_that_does_not_fit_its_file_is_refused() {
    let program = one_path(LINE, 7);
    let mut run = run_of(&program);
    run.workingsteps[0].plan = Some(4711);
    let error = twin::append(&program, &run, &options()).expect_err("there is no #4711");
    assert_eq!(
        error.to_string(),
        "the run says that 'step' is a run of #4711, which is not in own.stpnc: is this the plan it was made from?"
    );
    let mut run = run_of(&program);
    run.workingsteps[0].toolpaths[0].points[0].position.xyz[1] = f64::NAN;
    assert_eq!(
        twin::append(&program, &run, &options()),
        Err(WriteError::NotFinite("path".into()))
    );
}
