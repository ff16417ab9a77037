//! The default link: bytes and time into both sides, with checksums that fit and with such that do not.

use cell::link::{LinkAsker, LinkReceiver, LinkSender, MachineCard};
use machine::link::asking::{AnswerEntry, AnswerHead, Asked, Inquiry};
use machine::link::message::{Hello, UNITS};
use machine::link::{Entry, FRAME, Follower, FrameReader, Header, Kind, LimitsHash, Name, PlanId, Reader, Wire, write_frame};
use machine::{MachineParameters, Plant, Quality, RealtimeHalf, Report, Request};
use units::{Point, Tick};

const KINDS: [Kind; 9] = [
    Kind::Hello,
    Kind::Welcome,
    Kind::Refusal,
    Kind::Block,
    Kind::Urgent,
    Kind::Reports,
    Kind::Heartbeat,
    Kind::Goodbye,
    Kind::Load,
];

/// The bytes as they are; then each piece between `|` as a payload in a sound frame, its kind by the first byte, to a controller that was
/// greeted and to a sender that was welcomed; and as a question of somebody else, and what such a one hears. A machine follows what gets
/// through.
pub fn run(bytes: &[u8]) {
    let mut reader = Box::new(FrameReader::new());
    let mut rest = bytes;
    while let Ok(Some(_)) = reader.feed(&mut rest) {}
    reads_what_it_writes(bytes);

    let machine = MachineParameters::small_machining_centre();
    let mut receiver = LinkReceiver::new(MachineCard::new("mill", Quality::Simulated, &machine));
    let mut raw = receiver.clone();
    raw.connected(1, Tick(0));
    raw.receive(1, Tick(0), bytes);
    assert_eq!(raw.order(), None, "nothing comes through without a hello");

    let mut sender = LinkSender::new("fuzz", PlanId::default(), &machine);
    receiver.connected(1, Tick(0));
    sender.connected(Tick(0));
    let hello = Hello {
        units: UNITS,
        axes: 3,
        name: Name::new("fuzz"),
        plan: PlanId::default(),
        limits: LimitsHash::of(&machine),
        session: 0,
        reports: 0,
        firings: 0,
    };
    let mut sequence = 1;
    receiver.receive(1, Tick(0), &framed(Kind::Hello, 0, sequence, |to| hello.write(to)));
    let mut half = Box::new(RealtimeHalf::new(
        &machine,
        Plant::new(&machine, Point::ORIGIN, 1),
        Quality::Simulated,
    ));
    let mut follower = Box::new(Follower::new());
    half.request(Request::PowerOn);
    let mut held = None;
    for (count, piece) in bytes.split(|b| *b == b'|').take(64).enumerate() {
        let now = Tick(count as u64);
        let Some((first, payload)) = piece.split_first() else {
            continue;
        };
        let payload = &payload[..payload.len().min(FRAME / 2)];
        let kind = KINDS[usize::from(*first) % KINDS.len()];
        sequence += 1;
        receiver.receive(1, now, &framed(kind, 1, sequence, |to| to.put(payload)));
        let _ = sender.receive(now, &framed(kind, 1, sequence - 1, |to| to.put(payload)));
        let asking = 2 + count as u32;
        receiver.connected(asking, now);
        receiver.receive(asking, now, &framed(Kind::Inquiry, 0, 1, |to| to.put(payload)));
        let mut asker = LinkAsker::new("fuzz", Asked::Living, now);
        let _ = asker.receive(now, &framed(Kind::Answer, 0, 1, |to| to.put(payload)));
        receiver.pass(now);
        while let Some(urgent) = receiver.urgent() {
            follower.take_urgent(urgent, &mut half);
        }
        while let Some(order) = held.take().or_else(|| receiver.order()) {
            if let Err(back) = follower.take(order, &mut half) {
                held = Some(back);
                break;
            }
        }
        half.tick(now);
        follower.after_tick(&mut half);
        while let Some(lives) = follower.lives(&mut half) {
            receiver.lives(now, lives);
        }
        while let Some(report) = half.report() {
            while let Some(firing) = half.firing(report.sample.tick) {
                receiver.fired(firing);
            }
            receiver.reported(follower.translated(report), follower.status());
        }
        let _ = receiver.output(1, now, &mut Vec::new());
        let mut answer = Vec::new();
        receiver.output(asking, now, &mut answer);
        let mut asker = LinkAsker::new("fuzz", Asked::Living, now);
        asker.receive(now, &answer).expect("the controller's own answer is one");
        let _ = sender.output(now, &mut Vec::new());
    }
}

fn framed(kind: Kind, session: u32, sequence: u32, payload: impl FnOnce(&mut machine::link::Writer<'_>)) -> Vec<u8> {
    let mut bytes = vec![0; FRAME];
    let header = Header {
        kind,
        session,
        sequence,
        acknowledged: 0,
    };
    let length = write_frame(&mut bytes, &header, payload).expect("half a frame fits");
    bytes.truncate(length);
    bytes
}

/// What can be read from the bytes is written as the bytes that were read.
fn reads_what_it_writes(bytes: &[u8]) {
    fn check<T: Wire>(bytes: &[u8]) {
        let mut reader = Reader::new(bytes);
        let Ok(read) = T::read(&mut reader) else { return };
        let mut again = [0; 2048];
        let mut writer = machine::link::Writer::new(&mut again);
        read.write(&mut writer);
        let length = writer.finish().expect("items are small");
        assert_eq!(bytes.get(..length), again.get(..length));
    }
    check::<Entry>(bytes);
    check::<Report>(bytes);
    check::<Hello>(bytes);
    check::<Inquiry>(bytes);
    check::<AnswerHead>(bytes);
    check::<AnswerEntry>(bytes);
}
