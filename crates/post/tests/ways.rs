//! What holds on one way of a branch only is not taken for granted on the other, nor where ways meet; what stands along a path ends with it.

use plan::flow::{Flow, Part, StructuredProgram};
use plan::{Alarm, Diagnostic, Expression, FileId, Level, Marker, Origin, PathMode, Place, RawNcFunction, Step, StepKind};
use post::{CONTROLS, Grade, Options, Posted, by_name, post};
use units::{Millimetres, StepId};

struct Parts(std::vec::IntoIter<Part>);

impl StructuredProgram for Parts {
    fn next_part(&mut self) -> Result<Option<Part>, Box<Alarm>> {
        Ok(self.0.next())
    }
    fn diagnostics(&self) -> &[Diagnostic] {
        &[]
    }
    fn file_name(&self, _file: FileId) -> &str {
        "test"
    }
}

const HERE: Origin = Origin {
    file: FileId(0),
    place: Place::Given,
};

fn step(kind: StepKind) -> Part {
    Part::Step(Step {
        id: StepId(1),
        origin: HERE,
        kind,
    })
}

fn flow(flow: Flow) -> Part {
    Part::Flow(HERE, flow)
}

fn condition() -> Flow {
    Flow::If(Expression::Name("SIZE".to_owned()))
}

fn line(text: &str) -> Part {
    step(StepKind::NcFunction(RawNcFunction {
        condition: None,
        kind: "extended function".to_owned(),
        name: String::new(),
        text: format!("trace:1 {text}"),
        properties: Default::default(),
    }))
}

fn posted(control: &str, parts: &[Part]) -> (Posted, String) {
    let begin = step(StepKind::Begin(Marker {
        level: Level::Program,
        name: "WAYS".to_owned(),
        entity: None,
        maximum_deviation: None,
        derived: false,
    }));
    let all: Vec<Part> = std::iter::once(begin).chain(parts.iter().cloned()).collect();
    let mut text = String::new();
    let done = post(
        by_name(control).expect("a control"),
        &mut |_| Ok(Box::new(Parts(all.clone().into_iter()))),
        &Options::default(),
        &mut |line| text.push_str(line),
    );
    (done.unwrap_or_else(|e| panic!("{e}")), text)
}

fn tolerance(mm: Option<f64>) -> Part {
    step(StepKind::PathMode(PathMode::Tolerance(mm.map(Millimetres))))
}

#[test]
fn a_tolerance_is_taken_back_on_both_ways() {
    let parts = [
        tolerance(Some(0.05)),
        flow(condition()),
        tolerance(None),
        flow(Flow::Otherwise),
        tolerance(None),
        flow(Flow::EndIf),
        // The body of a loop comes to its beginning from its end.
        flow(Flow::While(Expression::Name("SIZE".to_owned()))),
        tolerance(None),
        tolerance(Some(0.1)),
        flow(Flow::EndWhile),
    ];
    for (control, off) in [
        ("siemens-840d", "CYCLE832(0,_OFF,1)"),
        ("haas", "\nG187\r\n"),
        ("heidenhain", "CYCL DEF 32.1\r\n"),
    ] {
        let (_, text) = posted(control, &parts);
        assert_eq!(text.matches(off).count(), 3, "{control}\n{text}");
    }
}

const START: &str = "start_sensor_recording its_function_id=1 its_sensors=LOAD its_axes=X";
const STOP: &str = "stop_sensor_recording its_function_id=1";
const WATCH: &str = "start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"X.LOAD > 80 %\" its_actions=\"log_event its_kind=k\"";
const UNWATCH: &str = "stop_synchronized_action its_id=1";

#[track_caller]
fn grades(control: &str, parts: &[Part], expected: &[Grade]) {
    let (done, text) = posted(control, parts);
    let found: Vec<Grade> = done.functions.iter().map(|row| row.grade).collect();
    assert_eq!(found, expected, "{control}: {:#?}\n{text}", done.functions);
    if !expected.contains(&Grade::Native) && !expected.contains(&Grade::BlockBoundary) {
        let words: String = text.lines().filter(|line| !line.starts_with(['(', ';'])).collect();
        for word in ["ID=10", "ID=1 ", "CANCEL", "FIFO", "DPRNT"] {
            assert!(!words.contains(word), "{control}\n{text}");
        }
    }
}

#[test]
fn what_begins_on_one_way_and_ends_on_another_is_left_to_a_recorder() {
    use Grade::{BlockBoundary, External, Native};
    for (start, stop) in [(START, STOP), (WATCH, UNWATCH)] {
        let begun_in_one = [flow(condition()), line(start), flow(Flow::EndIf), line(stop)];
        let never_ended = [flow(condition()), line(start), flow(Flow::Otherwise), flow(Flow::EndIf)];
        let ended_in_both = [
            line(start),
            flow(condition()),
            line(stop),
            flow(Flow::Otherwise),
            line(stop),
            flow(Flow::EndIf),
        ];
        let ended_in_a_loop = [
            line(start),
            flow(Flow::While(Expression::Name("SIZE".to_owned()))),
            line(stop),
            flow(Flow::EndWhile),
        ];
        let on_each_its_own = [
            flow(condition()),
            line(start),
            line(stop),
            flow(Flow::Otherwise),
            line(start),
            line(stop),
            flow(Flow::EndIf),
        ];
        let around = [line(start), flow(condition()), flow(Flow::EndIf), line(stop)];
        for control in ["siemens-840d", "haas"] {
            let written = if control == "haas" { BlockBoundary } else { Native };
            grades(control, &begun_in_one, &[External, External]);
            grades(control, &never_ended, &[External]);
            grades(control, &ended_in_both, &[External, External]);
            grades(control, &ended_in_a_loop, &[External, External]);
            grades(control, &on_each_its_own, &[written, written]);
            grades(control, &around, &[written, written]);
        }
    }
    for control in CONTROLS {
        let parts = [
            flow(condition()),
            line("start_tool_logging its_function_id=T"),
            flow(Flow::EndIf),
            line("stop_tool_logging its_function_id=T"),
        ];
        grades(control.name(), &parts, &[External, External]);
    }
}

#[test]
fn recordings_and_actions_along_a_path_end_with_it_several_lines_in_one_property_too() {
    let lines = "trace:1 start_sensor_recording its_function_id=R its_sensors=X.LOAD,\
                 trace:1 start_synchronized_action its_id=A its_mode_scope=AUTOMATIC its_frequency=WHENEVER \
                 its_condition=\"X.LOAD > 80 %\" its_actions=\"set_alarm its_alarm_id=3 its_text=high\"";
    let along = step(StepKind::NcFunction(RawNcFunction {
        condition: None,
        kind: trace::survey::ALONG.to_owned(),
        name: String::new(),
        text: String::new(),
        properties: [("one".to_owned(), lines.to_owned())].into(),
    }));
    let path = step(StepKind::Begin(Marker {
        level: Level::Toolpath,
        name: "groove".to_owned(),
        entity: None,
        maximum_deviation: None,
        derived: false,
    }));
    let end = step(StepKind::End(Level::Toolpath));
    let (done, text) = posted("siemens-840d", &[path, along, end]);
    let counted = |name: &str| done.functions.iter().any(|row| row.name == name);
    for name in [
        "start_sensor_recording",
        "stop_sensor_recording",
        "start_synchronized_action",
        "stop_synchronized_action",
    ] {
        assert!(counted(name), "{name}: {text}");
    }
    let (starts, cancels) = (text.find("WHENEVER $AA_LOAD[X]>80"), text.rfind("CANCEL("));
    assert!(starts.is_some() && starts < cancels, "{text}");
}
