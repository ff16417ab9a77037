//! Threads from program text to iron: planned under the machine's jerk, run on the simulated spindle, which sags under its own cut.

use cell::sink::Kept;
use cell::{Ended, Operator, World, WorldConfig};
use gcode::{GcodeProgram, Options, profile::by_name};
use machine::{MachineParameters, Phase, Sample};
use motion::{Limits, Trajectory};
use plan::{MemorySource, Missing, NoOtherFiles, Tables, ToolEntry};
use units::{Millimetres, ToolNumber, Transform};

fn run(profile: &str, text: &str, machine: MachineParameters) -> (Ended, Vec<Sample>) {
    let mut tables = Tables {
        missing: Missing::Fail,
        ..Tables::empty()
    };
    tables.tools.insert(ToolNumber(1), ToolEntry::default());
    tables
        .work_offsets
        .insert("G54".to_owned(), Transform::shift([-50.0, 0.0, -100.0]));
    let source = Box::new(MemorySource(text.as_bytes().to_vec()));
    let profile = by_name(profile).expect("a profile");
    let program = GcodeProgram::open(
        source,
        "thread.nc",
        profile,
        Box::new(NoOtherFiles),
        tables,
        Options::default(),
    )
    .expect("opens");
    let config = WorldConfig {
        machine,
        operator: Operator {
            cycle_start_after: Some(100),
            ..Operator::default()
        },
        ..WorldConfig::default()
    };
    let limits = Limits {
        v_max: machine.axes.map(|a| a.v_max),
        a_max: machine.axes.map(|a| a.a_max),
        j_max: Some(machine.axes.map(|a| a.j_max)),
        tolerance: Millimetres(0.01),
    };
    let source = Trajectory::new(Box::new(program), config.position, limits);
    let mut kept = Kept::default();
    let outcome = World::new(config, source).expect("a sound machine").run(&mut kept);
    (outcome.ended, kept.samples)
}

/// Largest thread error of the record, mm, and the rows that have one.
fn errors(samples: &[Sample]) -> (f64, usize) {
    let tied: Vec<f64> = samples.iter().map(|s| s.thread_error).filter(|e| !e.is_nan()).collect();
    (tied.iter().fold(0.0, |m: f64, e| m.max(e.abs())), tied.len())
}

#[test]
fn a_rigid_tap_of_a_program_goes_in_and_out_with_its_spindle_and_the_record_shows_how_closely() {
    let text = "O1\nG21 G90 G54 G94\nT1 M6\nM3 S800\nG0 X10. Y0 Z20.\nM29 S800\nG98 G84 X10. Z-15. R5. F1000.\nX30.\nG80\nG0 Z20.\nM30\n";
    let (ended, samples) = run("fanuc-mill", text, MachineParameters::small_machining_centre());
    assert_eq!(ended, Ended::Completed);
    let (worst, rows) = errors(&samples);
    println!("rigid tap: {:.1} um in {rows} cycles", worst * 1e3);
    // Two holes, down and up: some two seconds each.
    assert!(rows > 3000 && worst < 0.02, "{worst} in {rows}");
    let deepest = samples.iter().map(|s| s.commanded[2]).fold(f64::MAX, f64::min) + 100.0;
    assert!((deepest + 15.0).abs() < 0.25, "{deepest}");
    // The spindle turned round in the ground of the hole, and at no time did Z wait there for it.
    let deep = samples.iter().filter(|s| s.commanded[2] < -114.0);
    assert!(deep.clone().any(|s| s.spindle_speed > 5.0) && deep.clone().any(|s| s.spindle_speed < -5.0));
    assert!(deep.clone().all(|s| s.phase != Phase::Waiting), "a wait in the hole");
}

#[test]
fn passes_of_a_lathes_thread_meet_one_groove() {
    for cycle in [
        "G92 X19.4 Z-30. F1.5\nX19.0\nX18.7\nX18.5",
        "G76 P010060 Q100 R0.05\nG76 X18.16 Z-30. P920 Q300 F1.5",
    ] {
        let text = format!("O1\nG21 G97 G99\nT0101\nM3 S600\nG0 X25. Z6.\n{cycle}\nG0 X30.\nM30\n");
        let (ended, samples) = run("fanuc-lathe", &text, MachineParameters::small_lathe());
        assert_eq!(ended, Ended::Completed, "{cycle}");
        let (worst, rows) = errors(&samples);
        println!("{cycle:?}: {:.1} um in {rows} cycles", worst * 1e3);
        assert!(rows > 6000 && worst < 0.03, "{cycle}: {worst} in {rows}");
        if cycle.starts_with("G76") {
            // Its passes begin at other Z, along the flank: their grooves lie beside each other.
            continue;
        }
        // The groove by what is measured: Z less lead times angle is the same on all passes, but for whole leads.
        let phases: Vec<f64> = samples
            .iter()
            .filter(|s| !s.thread_error.is_nan() && (-125.0..-104.0).contains(&s.commanded[2]))
            .map(|s| -s.commanded[2] / 1.5 - s.spindle_angle / 360.0)
            .collect();
        let off = |p: f64| (p - phases[0] - (p - phases[0]).round()).abs() * 1.5;
        let apart = phases.iter().map(|p| off(*p)).fold(0.0, f64::max);
        println!("  passes apart: {:.1} um", apart * 1e3);
        assert!(apart < 0.04, "{cycle}: {apart}");
    }
}
