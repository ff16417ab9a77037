//! G-code as every family of control.

use gcode::{GcodeProgram, Options, PROFILES, detect};
use plan::{Answer, MemorySource, Missing, Next, NoOtherFiles, ProgramStream, StepKind, Tables};

/// Loops of an input end after so many blocks and jumps: what a longer one would show, a short one shows too.
const MOST_BLOCKS: u64 = 20_000;

/// Reads a program as every family; a long one tells as much by its first part.
pub fn run(bytes: &[u8]) {
    let _ = detect(&mut MemorySource(bytes.to_vec()));
    for profile in PROFILES {
        let tables = Tables {
            missing: Missing::Assume,
            ..Tables::empty()
        };
        let options = Options {
            most_blocks_at_rest: MOST_BLOCKS,
            most_jumps_back: MOST_BLOCKS,
            ..Options::default()
        };
        let source = Box::new(MemorySource(bytes.to_vec()));
        let Ok(mut program) = GcodeProgram::open(source, "f", profile, Box::new(NoOtherFiles), tables, options) else {
            continue;
        };
        let mut answer = None;
        for _ in 0..2_000 {
            match program.next(answer.take()) {
                Next::Step(step) => {
                    if let StepKind::Move(m) = &step.kind {
                        assert!(m.path.is_sound(), "{:?}", m.path);
                    }
                }
                Next::Ask(_) => answer = Some(Answer::Truth(false)),
                Next::End | Next::Alarm(_) => break,
            }
        }
    }
}
