//! One question to a controller, by somebody who does not drive it: what lives in its machine, or that it ends something of that.

use super::address::Address;
use super::certificates::Client;
use super::remote::{dial, speaks_alike};
use crate::failure::Failure;
use cell::link::{Answer, LinkAsker, LinkError};
use machine::link::Asked;
use std::time::{Duration, Instant};
use units::Tick;

/// How long a controller may take to answer: a full list is a quarter of a second.
const ANSWER: Duration = Duration::from_secs(10);
/// How often the answer is looked for.
const LOOK: Duration = Duration::from_millis(1);

/// Asks, and waits for the answer. `name` is what the controller's own log calls who asks.
///
/// # Errors
/// Nobody answers, or not as a controller does.
pub fn ask(address: &Address, client: Option<&Client>, name: &str, what: Asked) -> Result<Answer, Failure> {
    let failed = |why: &str| Failure::machine(format_args!("{address}: {why}"));
    let mut socket = dial(&address.resolve()?, client).map_err(|why| failed(&why))?;
    let began = Instant::now();
    let now = || Tick(u64::try_from(began.elapsed().as_millis()).unwrap_or(u64::MAX));
    let mut asker = LinkAsker::new(name, what, now());
    let (mut bytes, mut out) = (Vec::new(), Vec::new());
    loop {
        bytes.clear();
        // What came before the end counts: the answer is the last word of the connection.
        let read = socket.read(&mut bytes);
        speaks_alike(client.is_some(), &bytes, read.is_err()).map_err(failed)?;
        let answer = asker.receive(now(), &bytes).map_err(|error| failed(&words(&error)))?;
        if let Some(answer) = answer {
            socket.close();
            return Ok(answer);
        }
        read.map_err(|error| failed(&format!("{error}, and it has not answered: {KIND}")))?;
        if began.elapsed() > ANSWER {
            return Err(failed(&format!("it does not answer: {KIND}")));
        }
        out.clear();
        asker.output(now(), &mut out);
        let written = socket.write(&out).and_then(|()| socket.flush());
        written.map_err(|error| failed(&error.to_string()))?;
        std::thread::sleep(LOOK);
    }
}

const KIND: &str = "is it a toolmark controller of this release, and with the default link?";

fn words(error: &LinkError) -> String {
    match error {
        LinkError::Rules(_) => format!("{error}: {KIND}"),
        _ => error.to_string(),
    }
}
