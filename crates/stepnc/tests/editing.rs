//! Parts are found by their names, and a change touches only what it must.

mod common;
use common::{holds, one_path, outline, program_of};
use expect_test::{Expect, expect};
use stepnc::Program;
use stepnc::edit::{ChangeError, ProgramEdits};
use stepnc::inspect::inspect;
use stepnc::select::select;
use units::MmPerSec;

/// Two workingsteps 'cut' and one 'drill/ream' in two workplans; the paths of the first share a technology, the disabled property is
/// shared by nobody.
fn program() -> Program {
    let step = |id: u64, name: &str| {
        format!(
            "#{id}=MACHINING_WORKINGSTEP('{name}','machining','','');\n#{r}=MACHINING_OPERATION_RELATIONSHIP('','machining',#{id},#{op});\n\
             #{op}=FREEFORM_MILLING_OPERATION('op','finishing','','');\n#{t}=MACHINING_TECHNOLOGY_RELATIONSHIP('','',#{op},#500);\n\
             #{s}=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#{op},#{p},1.);\n#{p}=MACHINING_TOOLPATH('pass','cutter location trajectory','','');\n\
             #{s2}=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#{op},#{p2},2.);\n#{p2}=MACHINING_TOOLPATH('pass','cutter location trajectory','','');\n{}{}",
            holds(id + 20, id + 6, "basic curve", 550, 7),
            holds(id + 30, id + 8, "basic curve", 550, 7),
            r = id + 1,
            op = id + 2,
            t = id + 3,
            s = id + 5,
            p = id + 6,
            s2 = id + 7,
            p2 = id + 8,
        )
    };
    program_of(&format!(
        "#100=MACHINING_WORKPLAN('main','','','');\n#101=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#200,1.);\n\
         #102=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#110,2.);\n#110=MACHINING_WORKPLAN('second','','','');\n\
         #111=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#110,#300,1.);\n#112=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#110,#400,2.);\n{}{}{}\
         #500=MACHINING_TECHNOLOGY('','milling','','');\n{}{}\
         #520=MEASURE_REPRESENTATION_ITEM('feed speed',NUMERIC_MEASURE(600.),#5);\n#521=MEASURE_REPRESENTATION_ITEM('rotational speed',NUMERIC_MEASURE(-1500.),#6);\n\
         #550=POLYLINE('',(#551,#552));\n#551=CARTESIAN_POINT('',(0.,0.,0.));\n#552=CARTESIAN_POINT('',(1.,0.,0.));",
        step(200, "cut"),
        step(300, "cut"),
        step(400, "drill/ream"),
        holds(501, 500, "feedrate", 520, 8),
        holds(505, 500, "spindle", 521, 8),
    ))
}

#[track_caller]
fn check_select(path: &str, expected: &str) {
    let answer = match select(&program(), path) {
        Ok(part) => format!("{part:?}"),
        Err(error) => error.to_string(),
    };
    assert_eq!(answer, expected);
}

#[test]
fn parts_are_found_by_number_and_by_name() {
    check_select("#300", "Executable(300)");
    check_select("second/cut", "Executable(300)");
    check_select("main/cut", "Executable(200)");
    check_select("drill\\/ream", "Executable(400)");
    check_select("second/cut/pass[2]", "Toolpath(308)");
    check_select("cut", "'cut' could be any of: main/cut (#200), main/second/cut (#300)");
    check_select("drill", "nothing in the program is called 'drill'");
    check_select("#12", "nothing in the program is called '#12'");
}

/// The outline after a change, and how many of the old instances are not as they were.
#[track_caller]
fn check(change: impl FnOnce(&Program, &mut ProgramEdits) -> Result<(), ChangeError>, touched: usize, expected: Expect) {
    let program = program();
    let mut edits = ProgramEdits::new(&program);
    change(&program, &mut edits).expect("it can be changed");
    let saved = edits.save().expect("it can be saved");
    let after = Program::read("own.stpnc", saved.bytes).expect("a Part 21 file");
    let text = |program: &Program, id: u64| {
        program
            .file()
            .row(id)
            .map(|row| program.file().bytes()[program.file().span(row)].to_vec())
    };
    let ids = program.file().rows().map(|row| program.file().id(row));
    assert_eq!(ids.filter(|&id| text(&program, id) != text(&after, id)).count(), touched);
    assert_eq!(after.file().problems(), []);
    let lines = outline(&inspect(&after));
    let tree: Vec<&str> = lines.lines().filter(|line| line.trim_start().starts_with('#')).collect();
    expected.assert_eq(&tree.join("\n"));
}

fn at(program: &Program, path: &str) -> stepnc::select::Part {
    select(program, path).expect("it is there")
}

#[test]
fn nothing_asked_is_nothing_changed() {
    let program = program();
    let saved = ProgramEdits::new(&program).save().expect("nothing to refuse");
    assert_eq!(saved.bytes, program.file().bytes());
}

#[test]
fn a_workingstep_is_disabled_and_renamed() {
    check(
        |program, edits| {
            edits.enable(at(program, "main/cut"), false)?;
            edits.rename(at(program, "second/cut"), "face it")
        },
        1,
        expect![[r#"
            #100 workplan 'main' of project 'main'
              #200 workingstep 'cut' disabled
                #206 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                #208 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
              #110 workplan 'second'
                #300 workingstep 'face it'
                  #306 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                  #308 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                #400 workingstep 'drill/ream'
                  #406 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                  #408 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw"#]],
    );
}

#[test]
fn a_feed_changes_for_one_path_and_not_for_those_that_share_its_technology() {
    check(
        |program, edits| edits.set_feed(at(program, "second/cut/pass[2]"), MmPerSec(5.0)),
        0,
        expect![[r#"
            #100 workplan 'main' of project 'main'
              #200 workingstep 'cut'
                #206 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                #208 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
              #110 workplan 'second'
                #300 workingstep 'cut'
                  #306 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                  #308 feed 'pass' 1.000 mm, 5.000 mm/s, 1500.000 rpm cw
                #400 workingstep 'drill/ream'
                  #406 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                  #408 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw"#]],
    );
    check(
        |program, edits| edits.set_feed(at(program, "second/cut"), MmPerSec(5.0)),
        1,
        expect![[r#"
        #100 workplan 'main' of project 'main'
          #200 workingstep 'cut'
            #206 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
            #208 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
          #110 workplan 'second'
            #300 workingstep 'cut'
              #306 feed 'pass' 1.000 mm, 5.000 mm/s, 1500.000 rpm cw
              #308 feed 'pass' 1.000 mm, 5.000 mm/s, 1500.000 rpm cw
            #400 workingstep 'drill/ream'
              #406 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
              #408 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw"#]],
    );
}

#[test]
fn parts_are_moved_deleted_and_functions_put_between() {
    check(
        |program, edits| {
            edits.move_before(at(program, "drill\\/ream"), at(program, "second/cut"))?;
            edits.delete(at(program, "main/cut/pass[1]"))?;
            edits
                .insert_function(at(program, "second"), "stamp", "trace:1 get_time its_label=\"it's\"")
                .map(|_| ())
        },
        7,
        expect![[r##"
            #100 workplan 'main' of project 'main'
              #200 workingstep 'cut'
                #208 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
              #553 nc-function 'stamp' [extended function] trace:1 get_time its_label="it's"
              #110 workplan 'second'
                #400 workingstep 'drill/ream'
                  #406 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                  #408 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                #300 workingstep 'cut'
                  #306 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw
                  #308 feed 'pass' 1.000 mm, 10.000 mm/s, 1500.000 rpm cw"##]],
    );
}

#[test]
fn what_cannot_be_changed_is_refused_with_the_way_out() {
    let program = one_path("#200=POLYLINE('',(#201,#201));\n#201=CARTESIAN_POINT('',(0.,0.,0.));", 7);
    let mut edits = ProgramEdits::new(&program);
    let refusals = [
        edits.enable(at(&program, "path"), false),
        edits.delete(at(&program, "main")),
        edits.set_feed(at(&program, "main"), MmPerSec(1.0)),
        edits.insert_function(at(&program, "path"), "f", "t").map(|_| ()),
    ];
    let text: Vec<String> = refusals
        .into_iter()
        .map(|refusal| refusal.expect_err("it cannot").to_string())
        .collect();
    expect![[r#"
        #110 is a toolpath, which cannot be disabled: disable its workingstep, or delete it
        #100 is not in an ordered place of a workplan or operation: choose a child of a workplan, or a toolpath
        #100 is no workingstep with an operation: choose a workingstep or a toolpath
        #110 is a toolpath; functions stand between workingsteps only: insert before its workingstep"#]]
    .assert_eq(&text.join("\n"));
    assert!(!edits.is_changed());
}
