//! Generated macros do what the law of sizing says, and the proof of it can fail; both published methods size a part on the simulated
//! lathe.
#![allow(clippy::disallowed_methods, reason = "tests may read settings")]

use cell::proof::{Proof, prove};
use cell::sim::measure::{Feature, Gauge, Part};
use cell::{Ended, Fault, World, WorldConfig};
use gcode::interpretation::MachineKind;
use gcode::{GcodeProgram, Interpretation, Setup, interpret};
use machine::MachineParameters;
use motion::{Limits, Trajectory};
use plan::tables::Offset;
use plan::{MemorySource, Missing, Next, NoOtherFiles, ProgramStream, StepKind, Tables, ToolEntry};
use sizing::control::Control;
use sizing::generate::{Generated, Method, SetupEnd, generate};
use sizing::{Job, MachineAxes};
use std::collections::BTreeMap;
use units::{Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Point, ToolNumber, Transform, Vector};

fn control() -> Control {
    Control::find("fanuc-lathe").expect("built in")
}

fn job(text: &str, radii: bool) -> Job {
    let lathe = MachineAxes {
        name: "lathe".into(),
        counts_diameters: [!radii, false, false],
    };
    Job::parse(text, "job.toml", &lathe).unwrap_or_else(|e| panic!("{e}"))
}

/// The example of the article: 3.2342 in, offset 5, entries between 3.22 and 3.245.
const PUBLISHED: &str = "name = \"EXAMPLE\"\nnumber = 200\nunit = \"inch\"\n[[dimension]]\nname = \"DIM A\"\nkind = \"outside diameter\"\n\
                         nominal = 3.2342\ntolerance = 0.001\ntarget = 3.2342\nwindow = [3.22, 3.245]\nlargest_step = 0.005\ntool = 5\n";

/// Outside and inside, X and Z, a size that grows and one that shrinks with its offset, two columns of one offset, an offset that is not
/// the tool's number, a taper.
const MANY: &str = r#"name = "MANY"
number = 77
unit = "mm"
[[dimension]]
name = "SEAT"
kind = "outside diameter"
nominal = 40
tolerance = [-0.050, -0.025]
tool = 3
[[dimension]]
name = "SHOULDER"
kind = "depth"
nominal = 45
tolerance = 0.05
tool = 3
[[dimension]]
name = "BORE"
kind = "inside diameter"
nominal = 18
tolerance = [0, 0.018]
tool = 4
offset = 14
[[dimension]]
name = "LENGTH"
kind = "length"
nominal = 60
tolerance = 0.1
tool = 1
[[dimension]]
name = "TAPER"
kind = "outside diameter"
nominal = 25
tolerance = 0.03
tool = 5
factor = -0.8
"#;

fn generated(job: &Job, method: Method) -> Generated {
    generate(job, &control(), method, SetupEnd::M30).expect("possible")
}

#[track_caller]
fn check_proven(job: &Job, method: Method) -> Proof {
    let proof = prove(&generated(job, method), &control(), 10_000);
    assert!(proof.holds(), "{}", proof.text());
    assert!(proof.total() >= 10_000, "{}", proof.text());
    proof
}

#[test]
fn macros_of_the_t_word_do_what_the_law_says() {
    let proof = check_proven(&job(PUBLISHED, false), Method::TWord);
    for how in [
        "applied",
        "refused by alarm 100",
        "refused by alarm 101",
        "refused by alarm 102",
        "with nothing entered",
        "on target",
    ] {
        assert!(proof.ended.get(how).is_some_and(|n| *n > 0), "{how}: {}", proof.text());
    }
    check_proven(&job(MANY, false), Method::TWord);
    // Radius registers and a reversed X: half steps and the other sign.
    check_proven(&job(&MANY.replace("unit", "x_reversed = true\nunit"), true), Method::TWord);
}

#[test]
fn macros_called_by_g65_do_what_the_law_says() {
    check_proven(&job(PUBLISHED, false), Method::G65);
    check_proven(&job(MANY, false), Method::G65);
    check_proven(&job(&MANY.replace("unit", "x_reversed = true\nunit"), true), Method::G65);
}

/// Every one of these mistakes is found, or the proof proves nothing.
#[test]
fn the_proof_finds_the_mistakes_of_the_published_listings_and_others() {
    let job = job(MANY, false);
    for (method, from, to) in [
        (Method::TWord, "IF[#3GT#", "IF[#3GE#"),
        (Method::TWord, "IF[#3LT#", "IF[#3LE#"),
        (Method::TWord, "IF[#3EQ#0]GOTO1", "IF[1EQ2]GOTO1"),
        (Method::TWord, "GOTO2\nN99", "GOTO99\nN99"),
        (Method::TWord, "N15 #2=#2+1", "N15 #2=#2+2"),
        (Method::TWord, "#[#5]=#6+#7", "#[#5]=#6-#7"),
        (Method::TWord, "#[#5]=#6+#7", "#[#5]=#7"),
        (Method::TWord, "IF[ABS[#4]LE#", "IF[ABS[#4]LT#"),
        (Method::TWord, "T#149 (INDEX, ONCE)\n", ""),
        (Method::TWord, "T#149 (INDEX, ONCE)", "T[#149-1]"),
        (Method::TWord, "#1=ROUND[#20]-", "#1=FIX[#20/100]+0*"),
        (Method::TWord, "=#0 (TAKEN, BEFORE THE OFFSET IS WRITTEN)", "=0"),
        (Method::G65, "IF[#27GT#19]", "IF[#27GE#19]"),
        (
            Method::G65,
            "#[#[520+#29]]=0 (TAKEN, BEFORE THE OFFSET IS WRITTEN)",
            "(LEFT THERE)",
        ),
        (Method::G65, "#32=#28/#18", "#32=#28/#18*0.9"),
        (Method::G65, "EQ#5]GOTO1", "NE0]GOTO1"),
    ] {
        let mut wrong = generated(&job, method);
        let before = wrong.macros.clone();
        for program in &mut wrong.macros {
            program.text = program.text.replace(from, to);
        }
        assert_ne!(wrong.macros, before, "{from:?} is not there any more");
        assert!(!prove(&wrong, &control(), 600).holds(), "{from:?} as {to:?} was not found");
    }
}

#[test]
fn an_entry_that_is_cleared_after_the_offset_is_written_is_found_to_be_applied_twice() {
    let mut wrong = generated(&job(PUBLISHED, false), Method::G65);
    let cleared = "#[#[520+#29]]=0 (TAKEN, BEFORE THE OFFSET IS WRITTEN)\n";
    // Nor is it cleared by the alarm that tells of the power loss.
    let text = wrong.macros[0].text.replace(cleared, "").replace("#[#[520+#29]]=0\n", "");
    wrong.macros[0].text = text.replace("#[#30]=#31+#32\n", "#[#30]=#31+#32\n#[#8]=0\n");
    let proof = prove(&wrong, &control(), 100);
    assert!(proof.text().contains("power lost before"), "{}", proof.text());
}

#[test]
fn a_used_entry_is_printed_for_the_records_of_the_shop() {
    let made = generated(&job(PUBLISHED, false), Method::TWord);
    let ready = interpret(&made.setup.text, &lathe_in_inches(BTreeMap::new()));
    assert_eq!(ready.alarm, None, "{:?}", ready.fault);
    let mut vars = ready.vars;
    vars.insert(501, Some(3.2351));
    let mut text = "O1\n#140=200\nT0505\nM30\n".to_owned();
    made.macros.iter().for_each(|m| text.push_str(&m.text));
    let run = interpret(&text, &lathe_in_inches(vars));
    assert_eq!(run.alarm, None, "{:?}", run.fault);
    assert_eq!(run.tool, Some(505));
    assert!((wear(&run) + 0.0009).abs() < 1e-9, "{}", wear(&run));
    let [line] = run.output.as_slice() else {
        panic!("one line was expected: {:?}", run.output)
    };
    for part in ["JOB200", "OFS5", "IS3.23510", "BY-0.00090"] {
        assert!(line.replace(' ', "").contains(part), "{part} in {line:?}");
    }
}

#[test]
fn a_t_word_indexes_the_turret_exactly_once_with_an_entry_and_without() {
    let made = generated(&job(PUBLISHED, false), Method::TWord);
    let ready = interpret(&made.setup.text, &lathe_in_inches(BTreeMap::new()));
    let mut text = "O1\n#140=200\nT0505\nM30\n".to_owned();
    made.macros.iter().for_each(|m| text.push_str(&m.text));
    for entry in [None, Some(3.2351)] {
        let mut vars = ready.vars.clone();
        vars.insert(501, entry);
        let options = lathe_in_inches(vars).options();
        let profile = gcode::profile::by_name("fanuc-lathe").expect("built in");
        let source = Box::new(MemorySource(text.as_bytes().to_vec()));
        let tables = Tables {
            missing: Missing::Assume,
            ..Tables::empty()
        };
        let mut stream = GcodeProgram::open(source, "part.nc", profile, Box::new(NoOtherFiles), tables, options).expect("opens");
        let (mut indexes, mut answer) = (0, None);
        loop {
            match stream.next(answer.take()) {
                Next::Step(step) => indexes += usize::from(matches!(step.kind, StepKind::Tool(_))),
                Next::Ask(_) => answer = Some(plan::Answer::Unknown),
                Next::End => break,
                Next::Alarm(alarm) => panic!("{alarm}"),
            }
        }
        assert_eq!(indexes, 1, "{entry:?}");
    }
}

// -- the least corrected forms of the published programs, on the interpreter and on the simulated lathe

const O8002: &str = "O8002\nIF[#[2020+#20]EQ0]GOTO99\nIF[#[2020+#20]GT#19]GOTO5\n#3000=100(DIMENSION OFFSET TOO SMALL)\n\
                     N5 IF[#[2020+#20]LT#2]GOTO10\n#3000=101(DIMENSION OFFSET TOO BIG)\n\
                     N10 #[2000+#20]=#[2000+#20]+[#7-#[2020+#20]]\n#[2020+#20]=0\nN99 M99\n";
const O9000: &str = "O9000\n#101=FIX[#149/100]\n#102=1\nN1 IF[#102GT#542]GOTO99\nIF[#101NE#[520+#102]]GOTO15\n\
                     IF[#[500+#102]EQ#0]GOTO15\nIF[#[500+#102]EQ0]GOTO15\nIF[#[500+#102]GT[#[530+#102]-#541]]GOTO5\n\
                     #3000=100(DIMENSION ENTERED TOO SMALL)\nN5 IF[#[500+#102]LT[#[530+#102]+#541]]GOTO10\n\
                     #3000=101(DIMENSION ENTERED TOO BIG)\nN10 #[2000+#101]=#[2000+#101]+[#[530+#102]-#[500+#102]]\n\
                     #[500+#102]=0\nN15 #102=#102+1\nGOTO1\nN99 T#149\nM99\n";

fn lathe_in_inches(vars: BTreeMap<u32, Option<f64>>) -> Setup {
    Setup {
        machine: MachineKind::Lathe,
        units: gcode::interpretation::Unit::Inch,
        params: BTreeMap::from([("6001.5".to_owned(), 1.0)]),
        vars,
        ..Setup::default()
    }
}

fn wear(run: &Interpretation) -> f64 {
    run.vars.get(&2005).copied().flatten().unwrap_or(0.0)
}

#[test]
fn the_published_call_moves_offset_five_by_nine_steps_and_its_window_ends_are_alarms() {
    let program = format!("O1\nG65 P8002 T5. D3.2342 S3.22 B3.245\nM30\n{O8002}");
    for (typed, alarm, change) in [
        (3.2351, None, -0.0009),
        (0.0, None, 0.0),
        (3.22, Some(100), 0.0),
        (3.21, Some(100), 0.0),
        (3.245, Some(101), 0.0),
        (3.2451, Some(101), 0.0),
    ] {
        let run = interpret(
            &program,
            &lathe_in_inches(BTreeMap::from([(2025, Some(typed)), (2005, Some(0.0))])),
        );
        assert_eq!(run.alarm.as_ref().map(|a| a.number), alarm, "{typed}: {:?}", run.fault);
        assert!((wear(&run) - change).abs() < 1e-9, "{typed}: {}", wear(&run));
    }
}

/// Turns a diameter of 20 mm with a program that holds `macros`; `variables` are typed in at the control.
fn turned(program: &str, variables: &[(u32, f64)], wear_radial: f64) -> (f64, Ended) {
    let tool = ToolEntry {
        geometry: Offset(Vector::new(40.0, 0.0, 38.0)),
        ..ToolEntry::default()
    };
    let tables = Tables {
        position: Point::ORIGIN,
        tools: BTreeMap::from([
            (ToolNumber(5), tool),
            // The secondary offset is a row of the same table.
            (ToolNumber(25), ToolEntry::default()),
        ]),
        work_offsets: BTreeMap::from([("G54".to_owned(), Transform::shift([-100.0, 0.0, -100.0]))]),
        missing: Missing::Assume,
    };
    let setup = Setup {
        machine: MachineKind::Lathe,
        params: BTreeMap::from([("6001.5".to_owned(), f64::from(u8::from(program.contains("O9000"))))]),
        vars: variables.iter().map(|(n, v)| (*n, Some(*v))).collect(),
        ..Setup::default()
    };
    let profile = gcode::profile::by_name("fanuc-lathe").expect("built in");
    let source = Box::new(MemorySource(program.as_bytes().to_vec()));
    let options = setup.options();
    let stream = GcodeProgram::open(source, "part.nc", profile, Box::new(NoOtherFiles), tables, options).expect("opens");
    let faults = vec![Fault::ToolWear {
        tool: ToolNumber(5),
        radial: Millimetres(wear_radial),
    }];
    let limits = Limits {
        v_max: [MmPerSec(200.0); 3],
        a_max: [MmPerSec2(2000.0); 3],
        j_max: Some([MmPerSec3(50_000.0); 3]),
        tolerance: Millimetres(0.01),
    };
    let config = WorldConfig {
        machine: MachineParameters::small_lathe(),
        faults: faults.clone(),
        ..WorldConfig::default()
    };
    let feature = Feature::TurnedDiameter {
        z_from: Millimetres(-5.0),
        z_to: Millimetres(-1.0),
    };
    let mut part = Part::new(feature, &faults);
    let trajectory = Trajectory::new(Box::new(stream), Point::ORIGIN, limits);
    let outcome = World::new(config, trajectory).expect("a sound machine").run(&mut part);
    let size = part.measure(&mut Gauge::new(Millimetres(0.0), 1));
    (size.map_or(f64::NAN, |m| m.value.0), outcome.ended)
}

const CUT: &str = "G21 G18 G99\nG50 S3000\n{CALL}T0505\nG97 S2400 M3\nG0 X24. Z1.\nX20.\nG1 Z-6. F0.3\nU1.\nG0 Z1.\nM5\nM30\n";

#[track_caller]
fn check_sized_on_the_lathe(call: &str, macros: &str, idle: &[(u32, f64)], entry: u32) {
    let program = format!("O1\n{}{macros}", CUT.replace("{CALL}", call));
    let worn = 0.02;
    let (first, ended) = turned(&program, idle, worn);
    assert_eq!(ended, Ended::Completed);
    assert!((first - 20.04).abs() < 0.01, "worn by 0.02 on the radius: {first}");
    let mut typed = idle.to_vec();
    typed.retain(|(n, _)| *n != entry);
    typed.push((entry, (first * 1000.0).round() / 1000.0));
    let (second, ended) = turned(&program, &typed, worn);
    assert_eq!(ended, Ended::Completed);
    assert!((second - 20.0).abs() < 0.002, "{second}");
    // A slip of the finger stops the machine before it cuts.
    typed.pop();
    typed.push((entry, 2.0));
    let (none, ended) = turned(&program, &typed, worn);
    assert!(none.is_nan() && ended != Ended::Completed, "{ended:?}");
}

#[test]
fn both_published_methods_corrected_size_a_part_on_the_simulated_lathe() {
    let call = "G65 P8002 T5. D20. S19.8 B20.2\n";
    check_sized_on_the_lathe(call, O8002, &[(2025, 0.0)], 2025);
    check_sized_on_the_lathe("", O9000, &[(521, 5.0), (531, 20.0), (541, 0.2), (542, 1.0)], 501);
}

#[test]
fn both_generated_methods_size_a_part_on_the_simulated_lathe() {
    let text = "name = \"P\"\nnumber = 9\nunit = \"mm\"\n[[dimension]]\nname = \"D\"\nkind = \"outside diameter\"\nnominal = 20\n\
                tolerance = 0.05\ntarget = 20\ntool = 5\n";
    let job = job(text, false);
    for method in [Method::TWord, Method::G65] {
        let made = generated(&job, method);
        let ready = interpret(
            &made.setup.text,
            &Setup {
                machine: MachineKind::Lathe,
                ..Setup::default()
            },
        );
        assert_eq!(ready.alarm, None, "{:?}", ready.fault);
        let idle: Vec<(u32, f64)> = ready
            .vars
            .iter()
            .filter_map(|(n, v)| Some((*n, (*v)?)))
            .filter(|(n, _)| (500..2500).contains(n))
            .collect();
        let line = match method {
            Method::TWord => sizing::generate::t_word::job_line(&control(), 9),
            Method::G65 => sizing::generate::call::call(1, &made.dimensions, 9, &control()),
        };
        let macros: String = made.macros.iter().map(|m| m.text.as_str()).collect();
        let entry = if method == Method::TWord { 501 } else { 2025 };
        check_sized_on_the_lathe(&format!("{line}\n"), &macros, &idle, entry);
    }
}

/// Two diameters by one offset, three lengths by another, and one that stands alone.
const MEANS: &str = r#"name = "MEANS"
number = 78
unit = "mm"
[[dimension]]
name = "FRONT"
kind = "outside diameter"
nominal = 40
tolerance = [-0.050, -0.025]
tool = 3
role = "mean"
largest_step = 0.05
[[dimension]]
name = "BORE"
kind = "inside diameter"
nominal = 18
tolerance = [0, 0.018]
tool = 4
[[dimension]]
name = "REAR"
kind = "outside diameter"
nominal = 52
tolerance = 0.02
tool = 3
role = "mean"
largest_step = 0.05
[[dimension]]
name = "L1"
kind = "length"
nominal = 60
tolerance = 0.1
tool = 1
role = "mean"
largest_step = 0.1
[[dimension]]
name = "L2"
kind = "depth"
nominal = 12
tolerance = 0.1
tool = 1
role = "mean"
largest_step = 0.1
[[dimension]]
name = "L3"
kind = "length"
nominal = 30
tolerance = 0.1
tool = 1
role = "mean"
largest_step = 0.1
"#;

#[test]
fn sizes_that_share_a_register_move_it_once_by_their_mean() {
    for method in [Method::TWord, Method::G65] {
        let proof = check_proven(&job(MEANS, false), method);
        for how in [
            "waiting for the other size of the register",
            "applied",
            "refused by alarm 101",
        ] {
            assert!(proof.ended.get(how).is_some_and(|n| *n > 100), "{how}: {}", proof.text());
        }
    }
}

#[test]
fn the_proof_finds_a_sum_a_mean_that_does_not_wait_and_an_entry_that_stays() {
    let job = job(MEANS, false);
    for (method, from, to) in [
        (Method::TWord, "#4=ROUND[ROUND[#4/#10*1000]", "#4=ROUND[ROUND[#4*1000]"),
        (Method::TWord, "N10 #11=1", "N10 #11=0"),
        (Method::TWord, "N14 #9=#9+1", "N14 #9=#9+2"),
        (Method::G65, "#28=ROUND[ROUND[#28/#6*1000]", "#28=ROUND[ROUND[#28*1000]"),
        (Method::G65, "EQ#0]GOTO99 (ANOTHER IS", "EQ5]GOTO99 (ANOTHER IS"),
        (Method::G65, "N10 IF[#29GT#3]", "N10 IF[#29GE#3]"),
    ] {
        let mut wrong = generated(&job, method);
        let before = wrong.macros.clone();
        for program in &mut wrong.macros {
            program.text = program.text.replace(from, to);
        }
        assert_ne!(wrong.macros, before, "{from:?} is not there any more");
        assert!(!prove(&wrong, &control(), 600).holds(), "{from:?} as {to:?} was not found");
    }
}

/// A boss and a pocket by the radius of their cutters, two pockets by one cutter, a depth by a length.
const MILLED: &str = r#"name = "PLATE"
number = 79
unit = "mm"
[[dimension]]
name = "BOSS"
kind = "outside diameter"
nominal = 40
tolerance = 0.05
tool = 7
offset = 37
axis = "radius"
[[dimension]]
name = "POCKET"
kind = "inside width"
nominal = 25
tolerance = 0.05
tool = 12
offset = 42
axis = "radius"
role = "mean"
largest_step = 0.05
[[dimension]]
name = "SLOT"
kind = "inside width"
nominal = 12
tolerance = 0.05
tool = 12
offset = 42
axis = "radius"
role = "mean"
largest_step = 0.05
[[dimension]]
name = "FLOOR"
kind = "depth"
nominal = 8
tolerance = 0.05
tool = 12
"#;

#[test]
fn mills_are_sized_by_length_and_radius_in_every_offset_memory() {
    let mill = MachineAxes {
        name: "mill".into(),
        counts_diameters: [false; 3],
    };
    let job = Job::parse(MILLED, "job.toml", &mill).unwrap_or_else(|e| panic!("{e}"));
    for name in ["fanuc-mill", "fanuc-mill-a", "fanuc-mill-series-15", "fanuc-30i-mill"] {
        let control = Control::find(name).expect("built in");
        for method in [Method::TWord, Method::G65] {
            let made = generate(&job, &control, method, SetupEnd::M30).unwrap_or_else(|e| panic!("{name}: {e}"));
            let proof = prove(&made, &control, 10_000);
            assert!(
                proof.holds() && proof.total() >= 10_000,
                "{name} {method:?}: {}",
                proof.text()
            );
        }
    }
}

#[test]
fn every_built_in_lathe_is_proven_with_its_own_offset_variables() {
    let short = MANY.split("[[dimension]]").take(3).collect::<Vec<_>>().join("[[dimension]]");
    for control in Control::built_in().into_iter().filter(|c| !c.mill) {
        for method in [Method::TWord, Method::G65] {
            let made = generate(&job(&short, false), &control, method, SetupEnd::M99).expect("possible");
            let proof = prove(&made, &control, 10_000);
            assert!(proof.holds(), "{} {method:?}: {}", control.name, proof.text());
        }
    }
}

#[test]
fn the_radius_of_a_nose_is_sized_where_the_job_says_what_it_does() {
    let text = "name = \"FILLET\"\nnumber = 80\nunit = \"mm\"\n[[dimension]]\nname = \"FILLET\"\nkind = \"inside width\"\nnominal = 3\n\
                tolerance = 0.05\ntool = 5\naxis = \"radius\"\nfactor = 1.0\n";
    for method in [Method::TWord, Method::G65] {
        check_proven(&job(text, false), method);
    }
}
