//! G53 as the word for "wait until all moves are done".

use gcode::{Setup, interpret};

#[test]
fn g53_without_an_axis_word_moves_nothing_and_stops_the_read_ahead() {
    let warned = |text: &str| {
        let run = interpret(text, &Setup::default());
        assert_eq!(run.alarm, None, "{:?}", run.fault);
        assert_eq!(run.path.len(), 1);
        run.remarks.iter().any(|r| r.code == "read-ahead")
    };
    assert!(warned("O1\nG21 G0 X10.\n#2001=0.1\nM30"));
    assert!(!warned("O1\nG21 G0 X10.\nG53\n#2001=0.1\nM30"));
}
