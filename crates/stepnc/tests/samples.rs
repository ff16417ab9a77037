//! The sample files, whole: their trees, and what a stream makes of them.

mod common;
use common::{outline, sample, steps};
use plan::Answer;
use stepnc::StreamOptions;
use stepnc::inspect::inspect;

#[test]
fn look() {
    for name in [
        "ap238/plate_mm_e3.stpnc",
        "ap238/block_inch_nested_e1.stpnc",
        "ap238/plate_plan_and_twin_e3.stpnc",
        "ap238/plate_twin_external_p21e3.stpnc",
        "ap238/plate_trace_functions_e3.stpnc",
        "iso14649/nist_ex1.stp",
        "step-models/stepnode_vise.stp",
    ] {
        let Some(program) = sample(name) else { return };
        println!("== {name}\n{}", outline(&inspect(&program)));
        println!("{}", steps(program, StreamOptions::default(), 400, |_| Answer::Truth(true)));
    }
}
