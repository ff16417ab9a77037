//! Every kind of curve that a toolpath may run along, and what is said about those it cannot.

mod common;
use common::{describe, one_path, says};
use expect_test::{Expect, expect};
use plan::StepKind;
use std::fmt::Write;
use stepnc::Program;

/// The pieces of the only path of `program`, one line each, with the length.
fn pieces(program: &Program) -> String {
    let toolpath = program.toolpath(110);
    let mut out = String::new();
    for piece in program.path(&toolpath) {
        match piece {
            Ok(path) => {
                let length = path.length();
                let kind = StepKind::Move(plan::Move {
                    path,
                    speed: plan::Speed::Rapid,
                    profile: None,
                    derived: false,
                });
                let _ = writeln!(out, "{} {length:.4} mm", describe(&kind).trim_end_matches(" rapid"));
            }
            Err(diagnostic) => {
                let _ = writeln!(out, "{diagnostic}");
            }
        }
    }
    out
}

#[track_caller]
fn check(data: &str, expected: Expect) {
    expected.assert_eq(&pieces(&one_path(data, 7)));
}

const CIRCLE: &str = "#210=CARTESIAN_POINT('',(0.,0.,5.));\n#211=AXIS2_PLACEMENT_3D('',#210,$,$);\n#212=CIRCLE('',#211,10.);\n\
    #213=CARTESIAN_POINT('',(10.,0.,5.));\n#214=CARTESIAN_POINT('',(0.,10.,5.));\n";

#[test]
fn a_polyline_is_lines_and_points_that_repeat_are_left_out() {
    check(
        "#200=POLYLINE('',(#201,#202,#202,#203));\n#201=CARTESIAN_POINT('',(0.,0.,0.));\n#202=CARTESIAN_POINT('',(3.,4.,0.));\n#203=CARTESIAN_POINT('',(3.,4.,10));",
        expect![[r#"
            line (0.0000, 0.0000, 0.0000) -> (3.0000, 4.0000, 0.0000) 5.0000 mm
            line (3.0000, 4.0000, 0.0000) -> (3.0000, 4.0000, 10.0000) 10.0000 mm
        "#]],
    );
}

#[test]
fn inches_are_told_by_the_context_and_its_numbers() {
    let program = one_path(
        "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,0.));\n#202=CARTESIAN_POINT('',(1.,0.,0.));",
        10,
    );
    expect![[r#"
        line (0.0000, 0.0000, 0.0000) -> (25.4000, 0.0000, 0.0000) 25.4000 mm
    "#]]
    .assert_eq(&pieces(&program));
}

#[test]
fn a_via_point_makes_an_arc_and_two_of_them_a_full_circle() {
    check(
        "#200=POLYLINE('',(#201,#202,#203,#204,#205,#203));\n#201=CARTESIAN_POINT('start',(0.,1.,0.));\n#202=VIA_ARC_POINT('via',(1.,0.,0.));\n\
         #203=CARTESIAN_POINT('end',(-1.,0.,0.));\n#204=VIA_ARC_POINT('',(0.,1.,0.));\n#205=VIA_ARC_POINT('',(1.,0.,0.));",
        expect![[r#"
            arc about (0.0000, 0.0000, 0.0000) 270.00 deg rise 0.000 (0.0000, 1.0000, 0.0000) -> (-1.0000, 0.0000, 0.0000) 4.7124 mm
            arc about (0.0000, 0.0000, 0.0000) 360.00 deg rise 0.000 (-1.0000, 0.0000, 0.0000) -> (-1.0000, 0.0000, 0.0000) 6.2832 mm
        "#]],
    );
}

#[test]
fn a_via_point_that_coincides_or_lies_on_the_line_means_straight() {
    check(
        "#200=POLYLINE('',(#201,#202,#203,#204,#205));\n#201=CARTESIAN_POINT('',(0.,0.,0.));\n#202=VIA_ARC_POINT('',(0.,0.,0.));\n\
         #203=CARTESIAN_POINT('',(5.,0.,0.));\n#204=VIA_ARC_POINT('',(7.,0.,0.));\n#205=CARTESIAN_POINT('',(9.,0.,0.));",
        expect![[r#"
            line (0.0000, 0.0000, 0.0000) -> (5.0000, 0.0000, 0.0000) 5.0000 mm
            line (5.0000, 0.0000, 0.0000) -> (9.0000, 0.0000, 0.0000) 4.0000 mm
        "#]],
    );
}

#[test]
fn a_via_helix_point_makes_a_helix() {
    check(
        "#200=POLYLINE('',(#201,#202,#203));\n#201=CARTESIAN_POINT('',(10.,0.,0.));\n#202=VIA_HELIX_POINT('',(0.,-10.,-1.));\n#203=CARTESIAN_POINT('',(-10.,0.,-2.));",
        expect![[r#"
            arc about (0.0000, 0.0000, 0.0000) -180.00 deg rise -2.000 (10.0000, 0.0000, 0.0000) -> (-10.0000, 0.0000, -2.0000) 31.4795 mm
        "#]],
    );
}

#[test]
fn a_trimmed_circle_keeps_its_sense_and_equal_trims_are_a_full_circle() {
    check(
        &format!("{CIRCLE}#200=TRIMMED_CURVE('',#212,(#213),(#214),.T.,.CARTESIAN.);"),
        expect![[r#"
            arc about (0.0000, 0.0000, 5.0000) 90.00 deg rise 0.000 (10.0000, 0.0000, 5.0000) -> (0.0000, 10.0000, 5.0000) 15.7080 mm
        "#]],
    );
    check(
        &format!("{CIRCLE}#200=TRIMMED_CURVE('',#212,(#213),(#214),.F.,.CARTESIAN.);"),
        expect![[r#"
            arc about (0.0000, 0.0000, 5.0000) -270.00 deg rise 0.000 (10.0000, 0.0000, 5.0000) -> (0.0000, 10.0000, 5.0000) 47.1239 mm
        "#]],
    );
    check(
        &format!("{CIRCLE}#200=TRIMMED_CURVE('',#212,(#213),(#213),.F.,.CARTESIAN.);"),
        expect![[r#"
            arc about (0.0000, 0.0000, 5.0000) -360.00 deg rise 0.000 (10.0000, 0.0000, 5.0000) -> (10.0000, 0.0000, 5.0000) 62.8319 mm
        "#]],
    );
}

#[test]
fn trims_by_angle_use_the_angle_unit_of_the_context() {
    check(
        &format!("{CIRCLE}#200=TRIMMED_CURVE('',#212,(PARAMETER_VALUE(0.)),(PARAMETER_VALUE(180.)),.T.,.PARAMETER.);"),
        expect![[r#"
            arc about (0.0000, 0.0000, 5.0000) 180.00 deg rise 0.000 (10.0000, 0.0000, 5.0000) -> (-10.0000, 0.0000, 5.0000) 31.4159 mm
        "#]],
    );
}

#[test]
fn an_arc_that_misses_its_circle_is_refused_and_rounding_is_closed() {
    check(
        &format!("{CIRCLE}#215=CARTESIAN_POINT('',(0.,10.2,5.));\n#200=TRIMMED_CURVE('',#212,(#213),(#215),.T.,.CARTESIAN.);"),
        expect![[r#"
            error: own.stpnc:59:1: #200: the second trim point of an arc is 10.2000 mm from the centre in a circle of radius 10.0000 mm: 0.2000 mm off; correct centre, radius or end points; the tolerance is 0.03 mm
        "#]],
    );
    check(
        &format!("{CIRCLE}#215=CARTESIAN_POINT('',(0.,10.01,5.));\n#200=TRIMMED_CURVE('',#212,(#213),(#215),.T.,.CARTESIAN.);"),
        expect![[r#"
            arc about (-0.0050, 0.0050, 5.0000) 90.00 deg rise 0.000 (10.0000, 0.0000, 5.0000) -> (0.0000, 10.0100, 5.0000) 15.7158 mm
        "#]],
    );
}

#[test]
fn a_trimmed_line_runs_from_its_first_to_its_second_trim() {
    check(
        "#201=CARTESIAN_POINT('',(1.,0.,0.));\n#202=DIRECTION('',(1.,0.,0.));\n#203=VECTOR('',#202,2.);\n#204=LINE('',#201,#203);\n\
         #200=TRIMMED_CURVE('',#204,(PARAMETER_VALUE(3.)),(#201),.F.,.UNSPECIFIED.);",
        expect![[r#"
            line (7.0000, 0.0000, 0.0000) -> (1.0000, 0.0000, 0.0000) 6.0000 mm
        "#]],
    );
}

#[test]
fn an_ellipse_becomes_an_exact_rational_spline() {
    let data = "#210=CARTESIAN_POINT('',(0.,0.,0.));\n#211=AXIS2_PLACEMENT_3D('',#210,$,$);\n#212=ELLIPSE('',#211,20.,10.);\n\
        #213=CARTESIAN_POINT('',(20.,0.,0.));\n#214=CARTESIAN_POINT('',(0.,-10.,0.));\n\
        #200=TRIMMED_CURVE('',#212,(#213),(#214),.T.,.CARTESIAN.);";
    check(
        data,
        expect![[r#"
            spline of degree 2 with 7 poles (20.0000, 0.0000, 0.0000) -> (0.0000, -10.0000, 0.0000) 72.6634 mm
        "#]],
    );
    let program = one_path(data, 7);
    let path = program
        .path(&program.toolpath(110))
        .next()
        .map(|path| path.expect("it is whole"))
        .expect("one piece");
    for k in 0..=50 {
        let [x, y, _] = path.at(f64::from(k) / 50.0).xyz;
        assert!((x * x / 400.0 + y * y / 100.0 - 1.0).abs() < 1e-12);
    }
}

const POLES: &str = "#201=CARTESIAN_POINT('',(0.,0.,0.));\n#202=CARTESIAN_POINT('',(1.,2.,0.));\n#203=CARTESIAN_POINT('',(3.,2.,0.));\n\
    #204=CARTESIAN_POINT('',(4.,0.,0.));\n#205=CARTESIAN_POINT('',(6.,-1.,0.));\n";

#[test]
fn splines_of_all_knot_kinds_are_read() {
    check(
        &format!(
            "{POLES}#200=B_SPLINE_CURVE_WITH_KNOTS('',3,(#201,#202,#203,#204),.UNSPECIFIED.,.F.,.F.,(4,4),(0.,1.),.UNSPECIFIED.);"
        ),
        expect![[r#"
            spline of degree 3 with 4 poles (0.0000, 0.0000, 0.0000) -> (4.0000, 0.0000, 0.0000) 5.2684 mm
        "#]],
    );
    check(
        &format!("{POLES}#200=BEZIER_CURVE('',2,(#201,#202,#203,#204,#205),.UNSPECIFIED.,.F.,.F.);"),
        expect![[r#"
            spline of degree 2 with 5 poles (0.0000, 0.0000, 0.0000) -> (6.0000, -1.0000, 0.0000) 8.1422 mm
        "#]],
    );
    check(
        &format!("{POLES}#200=UNIFORM_CURVE('',2,(#201,#202,#203,#204,#205),.UNSPECIFIED.,.F.,.F.);"),
        expect![[r#"
            spline of degree 2 with 5 poles (0.5000, 1.0000, 0.0000) -> (5.0000, -0.5000, 0.0000) 5.9822 mm
        "#]],
    );
    check(
        &format!("{POLES}#200=QUASI_UNIFORM_CURVE('',2,(#201,#202,#203,#204,#205),.UNSPECIFIED.,.F.,.F.);"),
        expect![[r#"
            spline of degree 2 with 5 poles (0.0000, 0.0000, 0.0000) -> (6.0000, -1.0000, 0.0000) 8.1194 mm
        "#]],
    );
    check(
        "#201=CARTESIAN_POINT('',(10.,0.,0.));\n#202=CARTESIAN_POINT('',(10.,10.,0.));\n#203=CARTESIAN_POINT('',(0.,10.,0.));\n\
         #200=(BOUNDED_CURVE() B_SPLINE_CURVE(2,(#201,#202,#203),.UNSPECIFIED.,.F.,.F.) B_SPLINE_CURVE_WITH_KNOTS((3,3),(0.,1.),.UNSPECIFIED.) \
         CURVE() GEOMETRIC_REPRESENTATION_ITEM() RATIONAL_B_SPLINE_CURVE((1.,0.7071067811865476,1.)) REPRESENTATION_ITEM(''));",
        expect![[r#"
            spline of degree 2 with 3 poles (10.0000, 0.0000, 0.0000) -> (0.0000, 10.0000, 0.0000) 15.7080 mm
        "#]],
    );
}

#[test]
fn a_trimmed_spline_is_the_same_curve_between_its_trims() {
    let base = format!("{POLES}#206=UNIFORM_CURVE('',2,(#201,#202,#203,#204,#205),.UNSPECIFIED.,.F.,.F.);\n");
    check(
        &format!("{base}#200=TRIMMED_CURVE('',#206,(PARAMETER_VALUE(0.5)),(PARAMETER_VALUE(2.25)),.T.,.PARAMETER.);"),
        expect![[r#"
            spline of degree 2 with 5 poles (1.1250, 1.7500, 0.0000) -> (3.7812, 0.5312, 0.0000) 3.3820 mm
        "#]],
    );
    let whole = one_path(
        &format!("{POLES}#200=UNIFORM_CURVE('',2,(#201,#202,#203,#204,#205),.UNSPECIFIED.,.F.,.F.);"),
        7,
    );
    let whole = whole
        .path(&whole.toolpath(110))
        .next()
        .map(|path| path.expect("sound"))
        .expect("one piece");
    let part = one_path(
        &format!("{base}#200=TRIMMED_CURVE('',#206,(PARAMETER_VALUE(3.)),(PARAMETER_VALUE(0.75)),.F.,.PARAMETER.);"),
        7,
    );
    let part = part
        .path(&part.toolpath(110))
        .next()
        .map(|path| path.expect("sound"))
        .expect("one piece");
    for k in 0..=20 {
        let u = f64::from(k) / 20.0;
        let same = whole.at(1.0 - u * 0.75);
        assert!(part.at(u).distance(same) < 1e-9, "{u}: {:?} {same:?}", part.at(u));
    }
}

#[test]
fn a_composite_curve_runs_its_segments_and_turns_those_against_it() {
    let data = format!(
        "{CIRCLE}#220=POLYLINE('',(#213,#221));\n#221=CARTESIAN_POINT('',(20.,0.,5.));\n#222=TRIMMED_CURVE('',#212,(#213),(#214),.T.,.CARTESIAN.);\n\
         #223=COMPOSITE_CURVE_SEGMENT(.CONTINUOUS.,.F.,#220);\n#224=COMPOSITE_CURVE_SEGMENT(.DISCONTINUOUS.,.T.,#222);\n\
         #200=COMPOSITE_CURVE('',(#223,#224),.F.);\n"
    );
    check(
        &data,
        expect![[r#"
            line (20.0000, 0.0000, 5.0000) -> (10.0000, 0.0000, 5.0000) 10.0000 mm
            arc about (0.0000, 0.0000, 5.0000) 90.00 deg rise 0.000 (10.0000, 0.0000, 5.0000) -> (0.0000, 10.0000, 5.0000) 15.7080 mm
        "#]],
    );
    // The whole path run from its end to its beginning.
    check(
        &(data + &says(230, 110, "direction", "end to beginning")),
        expect![[r#"
            arc about (0.0000, 0.0000, 5.0000) -90.00 deg rise -0.000 (0.0000, 10.0000, 5.0000) -> (10.0000, 0.0000, 5.0000) 15.7080 mm
            line (10.0000, 0.0000, 5.0000) -> (20.0000, 0.0000, 5.0000) 10.0000 mm
        "#]],
    );
}

#[test]
fn a_curve_that_cannot_be_cut_says_why_and_where() {
    check(
        "#200=COMPOSITE_CURVE('',(#201),.F.);\n#201=COMPOSITE_CURVE_SEGMENT(.DISCONTINUOUS.,.T.,#200);",
        expect![[r#"
            error: own.stpnc:53:1: #200: composite curves are nested too deep; correct the curve in the CAM system and export again
        "#]],
    );
    check(
        "#200=POLYLINE('',(#201,#299));\n#201=CARTESIAN_POINT('',(0.,0.,0.));",
        expect![[r#"
            error: own.stpnc: #299: #299 is referred to and not in the file; repair the file, or open the file it refers to
        "#]],
    );
    check(
        "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,0.));\n#202=CARTESIAN_POINT('',(0.,1.));",
        expect![[r#"
            error: own.stpnc:55:1: #202: CARTESIAN_POINT is no point with three coordinates; correct the curve in the CAM system and export again
        "#]],
    );
    let no_unit = one_path("#200=POLYLINE('',(#201,#201));\n#201=CARTESIAN_POINT('',(0.,0.,0.));", 8);
    expect![[r#"
        error: own.stpnc:23:1: #8: coordinates stand in a context without a length unit; give the context a length unit: millimetres and inches are told apart by nothing else
    "#]]
    .assert_eq(&pieces(&no_unit));
}
