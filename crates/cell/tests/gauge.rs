//! The loop that sizing closes, in the small: a tool that is not where the table says makes a wrong size, the gauge finds it, a wear
//! correction makes the next part right.
#![allow(clippy::disallowed_methods, reason = "tests may square a number")]

mod common;

use cell::sim::measure::{Feature, Gauge, Part};
use cell::{Ended, Fault, World, WorldConfig};
use common::Writer;
use machine::MachineParameters;
use units::{Millimetres, ToolNumber};

const GEOMETRY: [f64; 3] = [5.0, 0.0, 40.0];

/// Turns to a diameter of 20 mm (radius 10) along Z -30 .. 0, with a wear correction in X; the work offset is 0.
fn turning(wear: f64) -> cell::source::Planned {
    let mut w = Writer::default();
    w.frame([0.0; 3]);
    w.tool(5, 0.0);
    w.tool_offset(GEOMETRY, [wear, 0.0, 0.0]);
    w.spindle(2000.0);
    let mut tip = |x: f64, z: f64, speed: f64| w.go([x + GEOMETRY[0] + wear, 0.0, z + GEOMETRY[2]], speed);
    tip(15.0, 2.0, 200.0);
    tip(10.0, 2.0, 200.0);
    tip(10.0, -30.0, 20.0);
    tip(15.0, -30.0, 20.0);
    tip(15.0, 2.0, 200.0);
    w.finish()
}

fn diameter_with(wear: f64, faults: &[Fault]) -> cell::sim::measure::Measurement {
    let config = WorldConfig {
        machine: MachineParameters::small_lathe(),
        faults: faults.to_vec(),
        ..WorldConfig::default()
    };
    let feature = Feature::TurnedDiameter {
        z_from: Millimetres(-25.0),
        z_to: Millimetres(-5.0),
    };
    let mut part = Part::new(feature, faults);
    let outcome = World::new(config, turning(wear)).expect("a sound machine").run(&mut part);
    assert_eq!(outcome.ended, Ended::Completed);
    part.measure(&mut Gauge::new(Millimetres(0.001), 3)).expect("it was cut")
}

#[test]
fn a_true_tool_makes_the_size_of_the_drawing() {
    let size = diameter_with(0.0, &[]);
    assert!((size.true_value.0 - 20.0).abs() < 0.012, "{size:?}");
    assert!(
        (size.value.0 - size.true_value.0).abs() < 0.005 && size.value != size.true_value,
        "{size:?}"
    );
}

#[test]
fn a_worn_tool_makes_a_wrong_size_and_the_correction_makes_it_right() {
    let faults = [Fault::ToolWear {
        tool: ToolNumber(5),
        radial: Millimetres(0.025),
    }];
    let first = diameter_with(0.0, &faults);
    assert!((first.true_value.0 - 20.05).abs() < 0.012, "{first:?}");
    let correction = -(first.value.0 - 20.0) / 2.0;
    let second = diameter_with(correction, &faults);
    assert!((second.true_value.0 - 20.0).abs() < 0.006, "{second:?}");
    // The other tool's wear is nobody's business.
    let other = [Fault::ToolWear {
        tool: ToolNumber(6),
        radial: Millimetres(1.0),
    }];
    assert_eq!(diameter_with(0.0, &other).value, diameter_with(0.0, &[]).value);
}

#[test]
fn a_pocket_and_a_boss_are_measured_over_the_cutters_true_radius() {
    // The cutter's centre runs round a square of 20 mm about (0, 0): a pocket of 30 mm, or a boss of 10 mm, with a cutter of 10 mm.
    for (inside, nominal, wear, expected) in [(true, 30.0, 0.0, 30.0), (true, 30.0, 0.05, 29.9), (false, 10.0, 0.05, 10.1)] {
        let mut w = Writer::default();
        w.tool(1, 10.0);
        w.spindle(6000.0);
        w.rectangle("square", [-10.0, -10.0], [20.0, 20.0], -5.0);
        let faults = vec![Fault::ToolWear {
            tool: ToolNumber(1),
            radial: Millimetres(wear),
        }];
        let feature = Feature::MilledWidth {
            axis: 0,
            centre: Millimetres(0.0),
            across_from: Millimetres(-5.0),
            across_to: Millimetres(5.0),
            z_below: Millimetres(-4.0),
            inside,
            cutter_radius: Millimetres(99.0),
        };
        let mut part = Part::new(feature, &faults);
        let config = WorldConfig {
            faults,
            ..WorldConfig::default()
        };
        World::new(config, w.finish()).expect("a sound machine").run(&mut part);
        let size = part.measure(&mut Gauge::new(Millimetres(0.0), 1)).expect("it was cut");
        assert!((size.true_value.0 - expected).abs() < 0.012, "nominal {nominal}: {size:?}");
    }
}

#[test]
fn what_was_not_cut_has_no_size() {
    let feature = Feature::TurnedDiameter {
        z_from: Millimetres(100.0),
        z_to: Millimetres(200.0),
    };
    let mut part = Part::new(feature, &[]);
    World::new(WorldConfig::default(), turning(0.0))
        .expect("a sound machine")
        .run(&mut part);
    assert_eq!(part.measure(&mut Gauge::new(Millimetres(0.001), 1)), None);
}
