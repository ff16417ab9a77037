//! Cutter-location files are told from G-code by their text.

use apt::AptProgram;

#[test]
fn a_macro_program_with_branches_is_no_cutter_location_file() {
    for text in [
        "O1\nGOTO\nM30",
        "%\nGOTO 10\nGOTO/2\nN10 M30\n",
        "N1 G0 X1\nFROM/0,0,0\nGOTO/1,1,1\n",
        "GOTO 1\nSTOP\n",
        "",
    ] {
        assert!(!AptProgram::looks_like(text.as_bytes()), "{text:?}");
    }
}

#[test]
fn statements_with_their_slash_are_a_cutter_location_file() {
    for text in [
        "$$ by hand\nTOOL PATH/FACE,TOOL,EM1\nGOTO/1,2,3\n",
        "units/mm\nrapid\ngoto / 0,0,0\nfini\n",
        "GOTO/0,0,0",
    ] {
        assert!(AptProgram::looks_like(text.as_bytes()), "{text:?}");
    }
}
