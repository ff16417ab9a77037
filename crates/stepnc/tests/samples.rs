//! The sample files, whole: their trees, and what a stream makes of them.

mod common;
use common::{outline, sample, steps};
use expect_test::expect;
use plan::Answer;
use stepnc::inspect::{Summary, inspect};
use stepnc::{Program, StreamOptions};

fn summary(name: &str) -> Option<Summary> {
    Some(inspect(&sample(name)?).summary)
}

#[test]
fn the_plate_has_the_figures_that_its_maker_gives() {
    let Some(plate) = sample("ap238/plate_mm_e3.stpnc") else {
        return;
    };
    expect![[r#"
        step-nc MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA mm
        Summary { workingsteps_enabled: 3, workingsteps_disabled: 1, toolpaths: 28, rapids: 12, dwells: 4, tools: 3, nc_functions: 4 }
        #703 workplan 'PLATE MAIN' of project 'PLATE-120'
          #695 nc-function 'message' [display message] Clamp plate, check parallels
          #700 nc-function 'load face mill' Number(1) [load tool] 
          #194 workingstep 'WS 1 face' Number(1)
            #99 rapid 'face approach' 79.500 mm, - mm/s, 1500.000 rpm cw
            #120 feed 'face pass 1' 200.000 mm, 10.000 mm/s, 1500.000 rpm cw
            #137 feed 'face link' 40.000 mm, 20.000 mm/s, 1500.000 rpm cw
            #157 feed 'face pass 2' 200.000 mm, 10.000 mm/s, 1500.000 rpm cw
            #174 rapid 'face retract' 80.000 mm, - mm/s, 1500.000 rpm cw
          #389 workingstep 'WS 2 pocket' Number(2)
            #235 rapid 'pocket approach' 78.000 mm, - mm/s, 4000.000 rpm cw
            #250 feed 'pocket plunge' 10.000 mm, 4.000 mm/s, 4000.000 rpm cw
            #285 feed 'pocket composite' 58.265 mm, 16.000 mm/s, 4000.000 rpm cw
            #306 feed 'pocket via arcs' 93.965 mm, 16.000 mm/s, 4000.000 rpm cw
            #327 feed 'pocket full circle' 87.965 mm, 16.000 mm/s, 4000.000 rpm cw
            #346 feed 'pocket lift spline' 11.213 mm, 16.000 mm/s, 4000.000 rpm cw
            #367 rapid 'pocket retract' 84.000 mm, - mm/s, 4000.000 rpm cw
          #701 nc-function 'check pocket' [optional stop] 
          #649 workingstep 'WS 3 drill' Number(3)
            #422 rapid 'hole 1 move' 78.000 mm, - mm/s, 2200.000 rpm cw
            #437 feed 'hole 1 drill' 26.000 mm, 3.000 mm/s, 2200.000 rpm cw
            #447 dwell 'hole 1 dwell' 0.000 mm, - mm/s, 2200.000 rpm cw
            #459 rapid 'hole 1 out' 29.000 mm, - mm/s, 2200.000 rpm cw
            #475 rapid 'hole 2 move' 103.000 mm, - mm/s, 2200.000 rpm cw
            #490 feed 'hole 2 drill' 26.000 mm, 3.000 mm/s, 2200.000 rpm cw
            #500 dwell 'hole 2 dwell' 0.000 mm, - mm/s, 2200.000 rpm cw
            #512 rapid 'hole 2 out' 29.000 mm, - mm/s, 2200.000 rpm cw
            #528 rapid 'hole 3 move' 63.000 mm, - mm/s, 2200.000 rpm cw
            #543 feed 'hole 3 drill' 26.000 mm, 3.000 mm/s, 2200.000 rpm cw
            #553 dwell 'hole 3 dwell' 0.000 mm, - mm/s, 2200.000 rpm cw
            #565 rapid 'hole 3 out' 29.000 mm, - mm/s, 2200.000 rpm cw
            #581 rapid 'hole 4 move' 103.000 mm, - mm/s, 2200.000 rpm cw
            #596 feed 'hole 4 drill' 26.000 mm, 3.000 mm/s, 2200.000 rpm cw
            #606 dwell 'hole 4 dwell' 0.000 mm, - mm/s, 2200.000 rpm cw
            #618 rapid 'hole 4 out' 29.000 mm, - mm/s, 2200.000 rpm cw
          #680 workingstep 'WS 4 deburr (disabled)' disabled Number(2)
            #666 feed 'deburr' 400.000 mm, 16.000 mm/s, 4000.000 rpm cw
          #702 nc-function 'end of program' [program stop] 
    "#]].assert_eq(&outline(&inspect(&plate)));
}

#[test]
fn files_with_a_plan_and_a_run_show_both_and_count_the_plan() {
    let (Some(alone), Some(both)) = (
        summary("ap238/plate_mm_e3.stpnc"),
        sample("ap238/plate_plan_and_twin_e3.stpnc"),
    ) else {
        return;
    };
    let inspection = inspect(&both);
    assert_eq!(inspection.summary, alone);
    let roots: Vec<_> = inspection
        .tree
        .iter()
        .map(|node| (node.project.as_deref(), node.twin, node.twin_of))
        .collect();
    assert_eq!(
        roots,
        [
            (Some("PLATE-120"), false, None),
            (Some("PLATE-120 run 0001"), true, Some(703))
        ]
    );
    assert_eq!(inspection.problems, []);
}

#[test]
fn a_disabled_workplan_disables_what_is_below_it() {
    let Some(block) = sample("ap238/block_inch_nested_e1.stpnc") else {
        return;
    };
    expect![[r#"
        step-nc INTEGRATED_CNC_SCHEMA inch
        Summary { workingsteps_enabled: 5, workingsteps_disabled: 1, toolpaths: 15, rapids: 10, dwells: 0, tools: 1, nc_functions: 1 }
        #418 workplan 'BLOCK MAIN' of project 'BLOCK'
          #415 workplan 'middle'
            #405 workplan 'inner'
              #399 selective 'choose'
                #390 workplan 'fast' disabled
                  #142 workingstep 'WS 1' disabled Number(7)
                    #93 rapid 'line 1 in' 73.660 mm, - mm/s, 6000.000 rpm cw
                    #114 feed 'line 1 cut' 156.210 mm, 6.138 mm/s, 6000.000 rpm cw
                    #125 rapid 'line 1 out' 77.470 mm, - mm/s, 6000.000 rpm cw
                #392 workplan 'slow'
                  #191 workingstep 'WS 2' Number(7)
                    #148 rapid 'line 2 in' 73.660 mm, - mm/s, 6000.000 rpm cw
                    #163 feed 'line 2 cut' 156.210 mm, 6.138 mm/s, 6000.000 rpm cw
                    #174 rapid 'line 2 out' 77.470 mm, - mm/s, 6000.000 rpm cw
                  #240 workingstep 'WS 3' Number(7)
                    #197 rapid 'line 3 in' 73.660 mm, - mm/s, 6000.000 rpm cw
                    #212 feed 'line 3 cut' 156.210 mm, 6.138 mm/s, 6000.000 rpm cw
                    #223 rapid 'line 3 out' 77.470 mm, - mm/s, 6000.000 rpm cw
              #402 non-sequential 'any order'
                #289 workingstep 'WS 4' Number(7)
                  #246 rapid 'line 4 in' 73.660 mm, - mm/s, 6000.000 rpm cw
                  #261 feed 'line 4 cut' 156.210 mm, 6.138 mm/s, 6000.000 rpm cw
                  #272 rapid 'line 4 out' 77.470 mm, - mm/s, 6000.000 rpm cw
                #338 workingstep 'WS 5' Number(7)
                  #295 rapid 'line 5 in' 73.660 mm, - mm/s, 6000.000 rpm cw
                  #310 feed 'line 5 cut' 156.210 mm, 6.138 mm/s, 6000.000 rpm cw
                  #321 rapid 'line 5 out' 77.470 mm, - mm/s, 6000.000 rpm cw
            #387 workingstep 'WS 6' Number(7)
              #344 rapid 'line 6 in' 73.660 mm, - mm/s, 6000.000 rpm cw
              #359 feed 'line 6 cut' 156.210 mm, 6.138 mm/s, 6000.000 rpm cw
              #370 rapid 'line 6 out' 77.470 mm, - mm/s, 6000.000 rpm cw
          #419 nc-function 'end' [program stop] 
    "#]].assert_eq(&outline(&inspect(&block)));
}

#[test]
fn every_sample_runs_to_its_end_or_says_why_not() {
    for (name, last) in [
        ("ap238/plate_mm_e3.stpnc", "end"),
        ("ap238/plate_anchored_p21e3.stpnc", "end"),
        ("ap238/plate_plan_and_twin_e3.stpnc", "end"),
        ("ap238/block_inch_nested_e1.stpnc", "end"),
        ("ap238/plate_trace_functions_e3.stpnc", "end"),
        ("ap238/plate_twin_external_p21e3.stpnc", "error"),
        ("iso14649/nist_ex1.stp", "error"),
        ("step-models/stepnode_vise.stp", "error"),
    ] {
        let Some(program) = sample(name) else { return };
        let text = steps(program, StreamOptions::default(), 10_000, |_| Answer::Truth(true));
        let ending = text
            .lines()
            .find(|line| line.starts_with("end") || line.starts_with("error"))
            .unwrap_or("nothing");
        assert!(ending.starts_with(last), "{name}: {text}");
    }
}

#[test]
fn the_nested_block_is_run_where_set_up_and_orientation_put_it() {
    let Some(block) = sample("ap238/block_inch_nested_e1.stpnc") else {
        return;
    };
    let text = steps(block, StreamOptions::default(), 10_000, |_| Answer::Truth(true));
    let frames: Vec<&str> = text.lines().filter(|line| line.contains(" frame ")).collect();
    expect![[r#"
        10 #148 frame 'VISE' (279.4000, 139.7000, 50.8000) turned
        76 #344 frame 'VISE' (254.0000, 127.0000, 50.8000)"#]]
    .assert_eq(&frames.join("\n"));
}

#[test]
fn iso_14649_files_and_plain_models_say_what_they_are() {
    let say = |name: &str| {
        Some(
            inspect(&sample(name)?)
                .problems
                .iter()
                .map(|problem| problem.message.clone())
                .collect::<Vec<_>>()
                .join("\n"),
        )
    };
    let (Some(arm), Some(model)) = (say("iso14649/nist_ex1.stp"), say("step-models/stepnode_vise.stp")) else {
        return;
    };
    expect![[r#"
        #19: 5 of 5 workingsteps are described by features and have no toolpaths: they are shown and cannot be run; let a CAM system compute their toolpaths; none are made up here
        the file has no machining program in it (schema AUTOMOTIVE_DESIGN); a STEP-NC file has a machining project or a workplan; a plain STEP model has neither
    "#]].assert_eq(&format!("{arm}\n{model}\n"));
}

#[test]
fn the_json_of_inspect_has_the_fields_of_the_contract() {
    let program = common::one_path(
        "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,0.));\n#202=CARTESIAN_POINT('',(1.,0.,0.));\n",
        7,
    );
    let json = serde_json::to_string_pretty(&inspect(&program)).expect("plain data");
    expect![[r##"
        {
          "kind": "step-nc",
          "schema": "MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA",
          "units": "mm",
          "summary": {
            "workingsteps_enabled": 1,
            "workingsteps_disabled": 0,
            "toolpaths": 1,
            "rapids": 0,
            "dwells": 0,
            "tools": 1,
            "nc_functions": 0
          },
          "tree": [
            {
              "id": 100,
              "type": "workplan",
              "name": "main",
              "enabled": true,
              "tool": null,
              "children": [
                {
                  "id": 101,
                  "type": "workingstep",
                  "name": "step",
                  "enabled": true,
                  "tool": 1,
                  "children": [],
                  "toolpaths": [
                    {
                      "id": 110,
                      "kind": "feed",
                      "name": "path",
                      "feed_mm_s": 10.0,
                      "spindle_rpm": 1500.0,
                      "spindle_direction": "cw",
                      "length_mm": 1.0
                    }
                  ],
                  "operation": {
                    "id": 102,
                    "type": "FREEFORM_MILLING_OPERATION",
                    "name": "op",
                    "variant": "finishing"
                  }
                }
              ],
              "toolpaths": [],
              "project": "main"
            }
          ],
          "tools": [
            {
              "id": 130,
              "tool": 1,
              "name": "1",
              "type": "endmill",
              "values": []
            }
          ],
          "problems": [
            {
              "code": "no-project",
              "severity": "remark",
              "message": "#100: the file has no machining project of a plan: workplans that nobody executes stand for it",
              "line": 31,
              "column": 1,
              "count": 1
            }
          ]
        }"##]]
    .assert_eq(&json);
}

#[test]
fn a_mill_does_not_turn() {
    let Some(plate) = sample("ap238/plate_mm_e3.stpnc") else {
        return;
    };
    assert!(!Program::turns(&plate));
}
