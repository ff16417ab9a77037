//! Dimensions with tolerances: what the file says of them and nothing else.

#![allow(clippy::disallowed_methods, reason = "files of the repository are read")]

mod common;

use common::sample;
use stepnc::Program;
use stepnc::dimensions::{Measures, StatedLimits, StatedUnit, dimensions};
use units::{Millimetres, ToolNumber};

const BRACKET: &str = include_str!("../../../corpus/bracket.stpnc");

/// The bracket of the corpus with more instances, and one workingstep on a feature of its own. The text was held against the EXPRESS
/// long form of edition 3.
fn bracket(more: &str) -> Program {
    let text = BRACKET;
    let end = text.rfind("ENDSEC;").expect("a data section");
    let text = format!("{}{more}{}", &text[..end], &text[end..]);
    let text = text.replace(
        "MACHINING_FEATURE_RELATIONSHIP('','machining',#351,#53)",
        "MACHINING_FEATURE_RELATIONSHIP('','machining',#351,#905)",
    );
    Program::read("bracket.stpnc", text.into_bytes()).expect("Part 21")
}

const MORE: &str = include_str!("data/bracket-dimensions.p21");

#[test]
fn the_size_of_the_plate_has_its_nominal_and_both_deviations() {
    let Some(plate) = sample("ap238/plate_mm_e3.stpnc") else {
        return;
    };
    let read = dimensions(&plate);
    let [pocket] = read.dimensions.as_slice() else {
        panic!("one dimension: {read:?}");
    };
    assert_eq!(
        (pocket.id, pocket.measures, pocket.word.as_str()),
        (795, Measures::Size, "diameter")
    );
    assert_eq!(pocket.aspects, [(794, "pocket wall".to_owned())]);
    assert_eq!((pocket.nominal, pocket.unit), (Some(Millimetres(40.0)), StatedUnit::Mm));
    let limits = StatedLimits::Deviations {
        lower: Millimetres(0.0),
        upper: Millimetres(0.05),
    };
    assert_eq!(pocket.limits, limits);
    assert_eq!(
        pocket.workingsteps,
        [],
        "no feature of the file leads from the wall to a workingstep"
    );
    let [flatness] = &read.geometric[..] else {
        panic!("{:?}", read.geometric)
    };
    assert_eq!(
        (flatness.id, flatness.entity.as_str(), flatness.name.as_str()),
        (805, "FLATNESS_TOLERANCE", "flatness top")
    );
    assert_eq!(
        (flatness.magnitude, flatness.aspect.clone()),
        (Some(Millimetres(0.03)), Some((803, "top face".to_owned())))
    );
    assert_eq!(read.diagnostics, []);
}

#[test]
fn each_length_has_its_own_unit_and_a_feature_leads_to_its_workingstep_and_tool() {
    let read = dimensions(&bracket(MORE));
    assert_eq!(read.diagnostics, []);
    let by_id = |id: u64| read.dimensions.iter().find(|d| d.id == id).unwrap_or_else(|| panic!("#{id}"));
    let bore = by_id(910);
    assert_eq!((bore.nominal, bore.unit), (Some(Millimetres(25.4)), StatedUnit::Inch));
    let StatedLimits::Deviations { lower, upper } = bore.limits else {
        panic!("{bore:?}");
    };
    assert!(
        (lower.0 + 0.0254).abs() < 1e-12 && (upper.0 - 0.02).abs() < 1e-12,
        "bounds in mm at a nominal value in inches: {bore:?}"
    );
    assert_eq!(bore.features[0].name, "BORE");
    assert!(bore.features[0].entities.iter().any(|e| e == "ROUND_HOLE"));
    let [maker] = bore.workingsteps.as_slice() else {
        panic!("{bore:?}");
    };
    assert_eq!((maker.workingstep, maker.name.as_str()), (351, "round pocket"));
    assert!(maker.tool.is_some_and(|t| t > ToolNumber(0)), "{maker:?}");

    let distance = by_id(930);
    assert_eq!(
        (distance.measures, distance.word.as_str()),
        (Measures::Distance, "linear distance")
    );
    let limits = StatedLimits::Deviations {
        lower: Millimetres(-0.1),
        upper: Millimetres(0.2),
    };
    let StatedLimits::Deviations { lower, upper } = &distance.limits else {
        panic!("{distance:?}");
    };
    assert!(
        (lower.0 + 0.1).abs() < 1e-9 && (upper.0 - 0.2).abs() < 1e-9,
        "{limits:?} from the limits: {distance:?}"
    );
    assert_eq!(
        by_id(940).limits,
        StatedLimits::Fit("H7".to_owned()),
        "a fit is not looked up"
    );
    assert_eq!(by_id(950).limits, StatedLimits::None);
}

#[test]
fn a_tolerance_that_cannot_be_is_named_and_not_read() {
    let more = MORE.replace("TOLERANCE_VALUE(#915,#916)", "TOLERANCE_VALUE(#916,#915)");
    let read = dimensions(&bracket(&more));
    assert!(read.dimensions.iter().all(|d| d.id != 910));
    let [found] = read.diagnostics.as_slice() else {
        panic!("{:?}", read.diagnostics);
    };
    assert_eq!((found.code, found.entity), ("tolerance-order", Some(917)));
    let dangling = MORE.replace("(#912),#33);", "(#999),#33);");
    let read = dimensions(&bracket(&dangling));
    assert_eq!(read.diagnostics[0].code, "missing-instance");
}

#[test]
fn the_bracket_of_the_corpus_states_one_size() {
    let program = Program::read("bracket.stpnc", BRACKET.as_bytes().to_vec()).expect("Part 21");
    let read = dimensions(&program).dimensions;
    let [pocket] = read.as_slice() else {
        panic!("{read:?}");
    };
    assert_eq!((pocket.nominal, pocket.features.len()), (Some(Millimetres(36.0)), 0));
}
