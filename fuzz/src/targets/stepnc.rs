//! STEP-NC: the tree, the stream, and the twins in the file.

use plan::{Answer, Next, ProgramStream};
use std::sync::Arc;
use stepnc::inspect::inspect;
use stepnc::{Program, StepNcStream, StreamOptions, twin};

/// Reads, shows and runs.
pub fn run(bytes: &[u8]) {
    let Ok(program) = Program::read("f", bytes.to_vec()) else {
        return;
    };
    serde_json::to_string(&inspect(&program)).expect("plain data");
    twin::read(&program, &program);
    let mut stream = StepNcStream::new(Arc::new(program), StreamOptions::default());
    let mut reply = None;
    for _ in 0..2_000 {
        match stream.next(reply.take()) {
            Next::Step(step) => {
                if let plan::StepKind::Move(go) = &step.kind {
                    assert!(go.path.is_sound(), "{go:?}");
                }
            }
            Next::Ask(_) => reply = Some(Answer::Truth(true)),
            Next::End | Next::Alarm(_) => break,
        }
    }
}
