//! The socket of a live job: one add-in on this computer, a line a message both ways.

use super::job::LiveJob;
use super::protocol::{Connect, Heard, Said, read};
use machine::Request;
use std::io::{BufRead, BufReader, ErrorKind, Read, Result, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// The longest line: an operation of a million moves.
const LONGEST_LINE: u64 = 128 << 20;
/// How often the add-in hears how far the machine is.
pub const PROGRESS: Duration = Duration::from_millis(200);
/// How long an add-in may take to take a line.
const SEND: Duration = Duration::from_secs(5);

/// One add-in.
pub struct Session {
    lines: Mutex<BufReader<TcpStream>>,
    out: Mutex<TcpStream>,
    line: std::sync::atomic::AtomicU64,
}

/// What a line was.
pub enum Line {
    /// A message.
    Said(Box<Said>),
    /// No message: it was answered.
    Wrong,
    /// There are no more lines.
    Over,
}

impl Session {
    /// Waits for an add-in, or for `stop`; `None` then.
    ///
    /// # Errors
    /// The socket fails.
    pub fn accept(listener: &TcpListener, stop: &AtomicBool) -> Result<Option<Session>> {
        listener.set_nonblocking(true)?;
        while !stop.load(Relaxed) {
            match listener.accept() {
                Ok((stream, _)) => {
                    stream.set_nonblocking(false)?;
                    stream.set_nodelay(true)?;
                    stream.set_write_timeout(Some(SEND))?;
                    return Ok(Some(Session {
                        out: Mutex::new(stream.try_clone()?),
                        lines: Mutex::new(BufReader::new(stream)),
                        line: 0.into(),
                    }));
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                    std::thread::sleep(Duration::from_millis(20));
                }
                Err(error) => return Err(error),
            }
        }
        Ok(None)
    }

    /// Waits for the next line.
    pub fn next(&self) -> Line {
        let mut text = Vec::new();
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        let count = (&mut *lines).take(LONGEST_LINE).read_until(b'\n', &mut text);
        drop(lines);
        match count {
            Ok(0) | Err(_) => return Line::Over,
            Ok(_) => {}
        }
        let number = self.line.fetch_add(1, Relaxed) + 1;
        let whole = text.ends_with(b"\n");
        let said = match std::str::from_utf8(&text) {
            Ok(text) if text.trim().is_empty() => return Line::Wrong,
            Ok(text) => read(text.trim_end()),
            Err(_) => Err("the line is no UTF-8".to_owned()),
        };
        match said {
            Ok(said) => Line::Said(Box::new(said)),
            Err(_) if !whole && text.len() as u64 >= LONGEST_LINE => {
                drop(text);
                self.refuse(&format!(
                    "line {number} does not end within {LONGEST_LINE} bytes: split the operation"
                ));
                if self.pass_over_line() { Line::Wrong } else { Line::Over }
            }
            Err(why) => {
                self.refuse(&why);
                Line::Wrong
            }
        }
    }

    /// Reads to the end of a line without keeping it; false when the connection ends before.
    fn pass_over_line(&self) -> bool {
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let (taken, ended) = match lines.fill_buf() {
                Ok([]) => return false,
                Ok(bytes) => match bytes.iter().position(|byte| *byte == b'\n') {
                    Some(at) => (at + 1, true),
                    None => (bytes.len(), false),
                },
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(_) => return false,
            };
            lines.consume(taken);
            if ended {
                return true;
            }
        }
    }

    /// Answers the line that was read last.
    pub fn refuse(&self, why: &str) {
        self.tell(&Heard::Refused {
            line: self.line.load(Relaxed),
            why: why.to_owned(),
        });
    }

    /// Says something. An add-in that has gone hears nothing any more; that it has gone is seen where lines are read.
    pub fn tell(&self, heard: &Heard) {
        let Ok(mut text) = serde_json::to_vec(heard) else { return };
        text.push(b'\n');
        let _ = self.out.lock().unwrap_or_else(PoisonError::into_inner).write_all(&text);
    }

    /// Ends the connection, and with it whoever waits for lines.
    pub fn close(&self) {
        let _ = self
            .out
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .shutdown(std::net::Shutdown::Both);
    }

    /// Waits for the first good line, which has to be `connect`.
    pub fn introduced(&self) -> Option<Connect> {
        loop {
            match self.next() {
                Line::Said(said) => match *said {
                    Said::Connect(connect) if connect.client.trim().is_empty() || connect.job.trim().is_empty() => {
                        self.refuse("client and job need names");
                    }
                    Said::Connect(connect) => return Some(connect),
                    _ => self.refuse("the first line has to be connect"),
                },
                Line::Wrong => {}
                Line::Over => return None,
            }
        }
    }
}

/// How far the add-in has said its job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heading {
    /// The machine may begin.
    Started,
    /// The add-in wants nothing any more, or has gone.
    Over,
}

/// Takes what the add-in says into the job, until it has said everything. `heading` hears what concerns the run.
pub fn attend(session: &Session, job: &LiveJob, heading: &dyn Fn(Heading)) {
    let mut started = false;
    let mut ended = false;
    loop {
        match session.next() {
            Line::Wrong => {}
            Line::Over => {
                if !ended && !job.is_over() {
                    eprintln!("notice: the add-in has gone without saying that its job is complete: controlled stop");
                    job.ask(Request::Stop);
                }
                heading(Heading::Over);
                return;
            }
            Line::Said(said) => match *said {
                Said::Connect(_) => session.refuse("connect was said before"),
                Said::Start {} if started => session.refuse("start was said before"),
                Said::Start {} => {
                    started = true;
                    if job.operations() > 0 {
                        heading(Heading::Started);
                    }
                }
                Said::Operation(operation) => match job.add(&operation) {
                    Ok((number, steps)) => {
                        session.tell(&Heard::Accepted {
                            operation: number,
                            name: operation.name.clone(),
                            steps,
                        });
                        if started {
                            heading(Heading::Started);
                        }
                    }
                    Err(why) => session.refuse(&format!("operation '{}': {why}", operation.name)),
                },
                Said::Hold {} => job.ask(Request::Hold),
                Said::Resume {} => job.ask(Request::CycleStart),
                Said::Stop {} => {
                    job.ask(Request::Stop);
                    ended = true;
                    heading(Heading::Over);
                }
                Said::End {} => match job.end() {
                    Ok(()) => ended = true,
                    Err(why) => session.refuse(&why),
                },
            },
        }
    }
}
