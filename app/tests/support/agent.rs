//! An agent that replays a recording over real sockets: its observations at their times, a bounded buffer, streams with heartbeats, and
//! faults as a script wants them.

#![allow(dead_code, reason = "each test file uses a part of it")]

use mtconnect::streams::{Category, Streams, Value, read_streams};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// What the agent does, and what goes wrong.
#[derive(Clone, Debug)]
pub struct Script {
    /// How many times faster than it was.
    pub speed: f64,
    /// Slots of the buffer.
    pub buffer: usize,
    /// `multipart/mixed` instead of `multipart/x-mixed-replace`, a boundary that has its dashes already, parts without length, and an
    /// answer that lasts until the connection ends instead of chunks: what older agents do.
    pub old_fashioned: bool,
    /// The n-th connection that streams is cut after so many bytes.
    pub cuts: Vec<usize>,
    /// The n-th connection that streams sends these bytes in the place of a part first.
    pub garbage: Vec<&'static [u8]>,
    /// When so many observations have happened the agent is started anew: it begins at 1 with the next.
    pub restart_at: Option<usize>,
    /// The n-th answer that is no stream is cut after so many bytes, and the connection with it.
    pub answer_cuts: Vec<usize>,
    /// A line that carries so many bytes, then pauses.
    pub slow: Option<(usize, Duration)>,
    /// Nobody is answered while so many observations have happened: from, to.
    pub offline: Option<(usize, usize)>,
}

impl Script {
    /// Nothing goes wrong.
    pub fn at_speed(speed: f64) -> Script {
        Script {
            speed,
            buffer: 131_072,
            old_fashioned: false,
            cuts: vec![],
            garbage: vec![],
            restart_at: None,
            offline: None,
            answer_cuts: vec![],
            slow: None,
        }
    }
}

/// A running agent; it ends when it is dropped.
pub struct Agent {
    shared: Arc<Shared>,
    pub port: u16,
}

struct Shared {
    script: Script,
    streams: Streams,
    /// Indices into the observations, in the order of their numbers.
    order: Vec<usize>,
    began: Mutex<Option<Instant>>,
    over: AtomicBool,
    streaming: AtomicUsize,
    answers: AtomicUsize,
    log: Mutex<Vec<String>>,
}

/// The agent as it is at one moment.
#[derive(Clone, Copy, PartialEq, Eq)]
struct View {
    instance: u64,
    /// Observations that are gone with an earlier start of the agent.
    shift: usize,
    /// The number of the first observation that happened since the start.
    base: u64,
    first: u64,
    next: u64,
    offline: bool,
}

impl Agent {
    /// Replays the observations of an MTConnectStreams document. Time begins with the first request for a stream.
    pub fn start(recording: &[u8], script: Script) -> Agent {
        let streams = read_streams(recording, "the agent's recording");
        let mut order: Vec<usize> = (0..streams.observations.len()).collect();
        order.sort_by_key(|k| streams.observations[*k].sequence);
        let shared = Arc::new(Shared {
            script,
            streams,
            order,
            began: Mutex::new(None),
            over: AtomicBool::new(false),
            streaming: AtomicUsize::new(0),
            answers: AtomicUsize::new(0),
            log: Mutex::new(vec![]),
        });
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("an address").port();
        let accepting = Arc::clone(&shared);
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if accepting.over.load(Ordering::Relaxed) {
                    return;
                }
                let shared = Arc::clone(&accepting);
                std::thread::spawn(move || {
                    let _ = shared.serve(stream);
                });
            }
        });
        Agent { shared, port }
    }

    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    /// The number of the next observation to happen.
    pub fn next(&self) -> u64 {
        self.shared.view().next
    }

    /// Begins the time, and waits until everything has happened.
    pub fn begin(&self) {
        self.shared.began.lock().expect("no panic").get_or_insert_with(Instant::now);
        let last = self.shared.order.len() - 1;
        while self.shared.view().next <= self.shared.streams.observations[self.shared.order[last]].sequence {
            sleep(Duration::from_millis(5));
        }
    }

    /// The requests that came.
    pub fn requests(&self) -> Vec<String> {
        self.shared.log.lock().expect("no panic").clone()
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Relaxed);
        // The accepting thread hears of it by a connection.
        let _ = TcpStream::connect(("127.0.0.1", self.port));
    }
}

impl Shared {
    fn view(&self) -> View {
        let began = *self.began.lock().expect("no panic");
        let at = |k: usize| self.streams.observations[self.order[k]].at;
        // Before that only the first observation has happened.
        let elapsed = began.map_or(0.0, |began| began.elapsed().as_secs_f64() * self.script.speed);
        let happened = (0..self.order.len()).collect::<Vec<_>>();
        let happened = happened.partition_point(|k| at(*k).since(at(0)).0 <= elapsed);
        let restarted = self.script.restart_at.is_some_and(|k| happened > k);
        let shift = if restarted { self.script.restart_at.unwrap_or(0) } else { 0 };
        let header = self.streams.headers[0].instance;
        let base = if restarted {
            1
        } else {
            self.streams.observations[self.order[0]].sequence
        };
        let next = base + (happened - shift) as u64;
        View {
            instance: header + u64::from(restarted),
            shift,
            base,
            first: base.max(next.saturating_sub(self.script.buffer as u64)),
            next,
            offline: self.script.offline.is_some_and(|(from, to)| (from..to).contains(&happened)),
        }
    }

    fn serve(&self, stream: TcpStream) -> std::io::Result<()> {
        let mut reader = BufReader::new(stream.try_clone()?);
        let mut out = Out {
            stream,
            left: usize::MAX,
            slow: self.script.slow,
        };
        loop {
            let mut line = String::new();
            if reader.read_line(&mut line)? == 0 {
                return Ok(());
            }
            let target = line.split(' ').nth(1).unwrap_or_default().to_owned();
            while reader.read_line(&mut line)? > 2 {}
            if target.starts_with("/sample") {
                self.began.lock().expect("no panic").get_or_insert_with(Instant::now);
            }
            let view = self.view();
            if view.offline || self.over.load(Ordering::Relaxed) {
                return Ok(());
            }
            self.log.lock().expect("no panic").push(target.clone());
            let (what, query) = target.split_once('?').unwrap_or((&target, ""));
            let parameters: BTreeMap<&str, &str> = query.split('&').filter_map(|p| p.split_once('=')).collect();
            let number = |name: &str| parameters.get(name).and_then(|v| v.parse::<u64>().ok());
            if what != "/sample" {
                let nth = self.answers.fetch_add(1, Ordering::Relaxed);
                out.left = self.script.answer_cuts.get(nth).copied().unwrap_or(usize::MAX);
            }
            match what {
                "/probe" => out.whole("200 OK", "<MTConnectDevices><Header instanceId=\"1\"/><Devices><Device name=\"replayed\"/></Devices></MTConnectDevices>")?,
                "/current" => {
                    let document = self.newest(&view);
                    out.whole("200 OK", &document)?;
                }
                "/sample" => {
                    let from = number("from").unwrap_or(view.first);
                    if from < view.first || from > view.next {
                        let text = format!(
                            "<MTConnectError><Header instanceId=\"{}\"/><Errors><Error errorCode=\"OUT_OF_RANGE\">'from' must be from {} to {}</Error></Errors></MTConnectError>",
                            view.instance, view.first, view.next
                        );
                        out.whole("404 Not Found", &text)?;
                        continue;
                    }
                    let nth = self.streaming.fetch_add(1, Ordering::Relaxed);
                    out.left = self.script.cuts.get(nth).copied().unwrap_or(usize::MAX);
                    let count = number("count").unwrap_or(100);
                    let interval = Duration::from_millis(number("interval").unwrap_or(0));
                    let heartbeat = Duration::from_millis(number("heartbeat").unwrap_or(10_000));
                    let garbage = self.script.garbage.get(nth).copied();
                    return self.stream(&mut out, view, from, count, interval, heartbeat, garbage);
                }
                _ => out.whole("404 Not Found", "<MTConnectError><Header/><Errors><Error errorCode=\"INVALID_URI\">no</Error></Errors></MTConnectError>")?,
            }
        }
    }

    #[expect(clippy::too_many_arguments, reason = "the parameters of a query")]
    fn stream(
        &self,
        out: &mut Out,
        begun: View,
        mut from: u64,
        count: u64,
        interval: Duration,
        heartbeat: Duration,
        garbage: Option<&[u8]>,
    ) -> std::io::Result<()> {
        let old = self.script.old_fashioned;
        if old {
            out.send(b"HTTP/1.0 200 OK\r\nServer: old\r\nCONTENT-TYPE: multipart/mixed; boundary=\"--d41d8\"\r\n\r\n--d41d8\n")?;
        } else {
            out.send(b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=d41d8\r\nTransfer-Encoding: chunked\r\n\r\n")?;
        }
        let part = |document: &str| {
            if old {
                // The boundary follows at once: without a length nothing else ends the part.
                format!("content-type: text/xml\n\n{document}\n--d41d8\n")
            } else {
                let length = document.len();
                format!("\r\n--d41d8\r\nContent-type: text/xml\r\nContent-length: {length}\r\n\r\n{document}")
            }
        };
        if let Some(garbage) = garbage {
            out.send(garbage)?;
        }
        let mut said = Instant::now();
        loop {
            let view = self.view();
            let gone = view.offline || view.instance != begun.instance || from < view.first;
            if gone || self.over.load(Ordering::Relaxed) {
                return Ok(());
            }
            let to = view.next.min(from + count);
            if to > from || said.elapsed() >= heartbeat {
                let told: Vec<u64> = (from..to).collect();
                let text = part(&self.document(&view, &told, to));
                if old {
                    out.send(text.as_bytes())?;
                } else {
                    out.send(format!("{:x}\r\n{text}\r\n", text.len()).as_bytes())?;
                }
                from = to;
                said = Instant::now();
            }
            sleep(interval.clamp(Duration::from_millis(1), Duration::from_millis(50)));
        }
    }

    /// The newest observation of each data item.
    fn newest(&self, view: &View) -> String {
        let mut newest = BTreeMap::new();
        for sequence in view.base..view.next {
            let o = &self.streams.observations[self.order[(sequence - view.base) as usize + view.shift]];
            newest.insert(o.item.as_str(), sequence);
        }
        let told: Vec<u64> = newest.into_values().collect();
        self.document(view, &told, view.next)
    }

    /// A document, its observations grouped by category as agents do.
    fn document(&self, view: &View, told: &[u64], next: u64) -> String {
        let source = &self.streams.sources[0];
        let created = told
            .last()
            .map_or(self.order[0], |s| self.order[(s - view.base) as usize + view.shift]);
        let mut text = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?><MTConnectStreams xmlns=\"urn:mtconnect.org:MTConnectStreams:1.5\"><Header creationTime=\"{}\" sender=\"replay\" instanceId=\"{}\" version=\"1.5\" bufferSize=\"{}\" nextSequence=\"{next}\" firstSequence=\"{}\" lastSequence=\"{}\"/><Streams><DeviceStream name=\"{}\" uuid=\"{}\"><ComponentStream component=\"{}\" name=\"{}\" componentId=\"{}\">",
            mtconnect::instant::format(self.streams.observations[created].at),
            view.instance,
            self.script.buffer,
            view.first,
            view.next - 1,
            source.device,
            source.device_uuid,
            source.component,
            source.name,
            source.id,
        );
        for (category, name) in [
            (Category::Condition, "Condition"),
            (Category::Event, "Events"),
            (Category::Sample, "Samples"),
        ] {
            let mut open = false;
            for sequence in told {
                let o = &self.streams.observations[self.order[(sequence - view.base) as usize + view.shift]];
                if o.category != category {
                    continue;
                }
                if !open {
                    write!(text, "<{name}>").expect("a string");
                    open = true;
                }
                let value = match &o.value {
                    Value::Unavailable => "UNAVAILABLE".to_owned(),
                    Value::Text(value) => value.replace('&', "&amp;").replace('<', "&lt;"),
                };
                let (element, kind, value) = match category {
                    Category::Condition => {
                        let (level, words) = value.split_once(' ').unwrap_or((&value, ""));
                        (level.to_owned(), format!(" type=\"{}\"", o.kind), words.to_owned())
                    }
                    _ => (o.kind.clone(), String::new(), value),
                };
                let sub_type = if o.sub_type.is_empty() {
                    String::new()
                } else {
                    format!(" subType=\"{}\"", o.sub_type)
                };
                let item_name = if o.name.is_empty() {
                    String::new()
                } else {
                    format!(" name=\"{}\"", o.name)
                };
                write!(
                    text,
                    "<{element} dataItemId=\"{}\" timestamp=\"{}\"{item_name}{sub_type}{kind} sequence=\"{sequence}\">{value}</{element}>",
                    o.item,
                    mtconnect::instant::format(o.at),
                )
                .expect("a string");
            }
            if open {
                write!(text, "</{name}>").expect("a string");
            }
        }
        text + "</ComponentStream></DeviceStream></Streams></MTConnectStreams>"
    }
}

/// A connection that can be cut at any byte.
struct Out {
    stream: TcpStream,
    left: usize,
    slow: Option<(usize, Duration)>,
}

impl Out {
    fn send(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        let taken = bytes.len().min(self.left);
        match self.slow {
            None => self.stream.write_all(&bytes[..taken])?,
            Some((piece, pause)) => {
                for piece in bytes[..taken].chunks(piece) {
                    self.stream.write_all(piece)?;
                    sleep(pause);
                }
            }
        }
        self.left -= taken;
        if taken < bytes.len() {
            self.stream.shutdown(Shutdown::Both)?;
            return Err(std::io::Error::other("cut"));
        }
        Ok(())
    }

    fn whole(&mut self, status: &str, body: &str) -> std::io::Result<()> {
        let head = format!(
            "HTTP/1.1 {status}\r\nContent-Type: text/xml\r\nContent-Length: {}\r\n\r\n",
            body.len()
        );
        self.send(head.as_bytes())?;
        self.send(body.as_bytes())
    }
}
