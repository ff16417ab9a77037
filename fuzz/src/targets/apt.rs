//! Cutter-location files.

use apt::AptProgram;
use plan::{Answer, MemorySource, Next, ProgramStream, StepKind, Tables};

/// Reads a file; a long one tells as much by its first part.
pub fn run(bytes: &[u8]) {
    let _ = AptProgram::looks_like(bytes);
    let source = Box::new(MemorySource(bytes.to_vec()));
    let mut program = AptProgram::open(source, "f", Tables::empty()).expect("memory can be read");
    let _ = program.in_inches();
    let mut answer = None;
    for _ in 0..20_000 {
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
