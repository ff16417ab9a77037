//! The plan at another speed: stop tails, and the way back onto the plan from where the machine stands.
//!
//! Both run along the planned path, on which only time is slowed: at phase p (in cycles of the plan) and rate r (planned time for each
//! real time) an axis is at q(p), has the speed r q'(p), the acceleration r^2 q'' + r' q' and the jerk r^3 q''' + 3 r r' q'' + r'' q', which
//! are kept under the axis's limits. Between two set-points q is Hermite's cubic, as in the controller.

use super::stock::Stock;
use machine::link::message::{Entry, TAIL};
use machine::{Command, MachineParameters, SetPoint};
use units::TICK;

/// Part of an axis's acceleration that a ramp uses at most; the rest is for a hold on top of it.
const SHARE: f64 = 0.7;
/// The same, where a ramp would become too long.
const MOST: f64 = 0.97;
/// Part of an axis's acceleration that may come on top of the plan's own where the plan uses all of it, and the most that is used where it
/// leaves room.
const ON_TOP: f64 = 0.02;
const LANDING: f64 = 0.2;
/// Part of an axis's jerk with which a ramp is begun and ended, and that its bends may use.
const JERK_SHARE: f64 = 0.6;
const BEND_SHARE: f64 = 0.4;
/// Cycles of the plan that are looked at for its highest speed.
const LOOKED_AT: u64 = 300;
/// Speed of the way back to the path, mm/s: slower than any cut.
const APPROACH: f64 = 10.0;
/// Cycles of a way back onto the plan at most: half a minute.
const LONGEST_LEAD: usize = 30_000;

/// A place on the plan and how fast time goes there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Cycles of the plan: n is on its n-th set-point.
    pub phase: f64,
    /// Planned time for each real time, 0..=1.
    pub rate: f64,
}

/// An entry, and where on the plan it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posed {
    /// The entry.
    pub entry: Entry,
    /// Its place.
    pub pose: Pose,
}

/// How a ramp ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RampEnd {
    /// A tail at rest; a lead on the plan, from here on the plan itself follows.
    Done,
    /// The plan is not known far enough.
    NoPlan,
    /// It would become too long.
    TooLong,
}

/// Entries that lead to rest, or onto the plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Ramp {
    /// In order.
    pub entries: Vec<Posed>,
    /// How it ends.
    pub end: RampEnd,
}

/// Makes ramps along a plan.
#[derive(Clone, Copy, Debug)]
pub struct Scaler<'a> {
    stock: &'a Stock,
    accelerations: [f64; 3],
    jerks: [f64; 3],
}

/// The plan at a phase: mm, mm/s, mm/s^2 of planned time.
struct Planned {
    set_point: SetPoint,
    /// Number of the last command of the plan that is behind it.
    done: u64,
}

/// A ramp in the making.
struct Course {
    pose: Pose,
    change: f64,
    /// Commands of the plan up to this number were said.
    said: u64,
    entries: Vec<Posed>,
}

impl<'a> Scaler<'a> {
    /// For a plan on a machine.
    pub fn new(stock: &'a Stock, machine: &MachineParameters) -> Self {
        Scaler {
            stock,
            accelerations: std::array::from_fn(|k| machine.axes[k].a_max.0),
            jerks: std::array::from_fn(|k| machine.axes[k].j_max.0),
        }
    }

    /// A stop tail from a place, `said` being the number of the last command of the plan that stands before it.
    pub fn tail(&self, from: Pose, said: u64) -> Ramp {
        let gentle = self.fall(from, said, SHARE);
        if gentle.end == RampEnd::TooLong {
            self.fall(from, said, MOST)
        } else {
            gentle
        }
    }

    /// The way onto the plan from standing at `position` beside phase `phase`: back to the path, straight and slowly, if it is not on it,
    /// and then along it until it is the plan itself. At phase 0 that is where the path begins ([`Scaler::start`]), and all of the plan
    /// follows. `done` commands of the plan are done.
    pub fn lead(&self, phase: f64, position: [f64; 3], done: u64) -> Ramp {
        let at_start = phase == 0.0;
        let begin = || {
            Some(Planned {
                set_point: self.start()?,
                done: 0,
            })
        };
        let Some(start) = (if at_start { begin() } else { self.planned(phase, 0.0, 0.0) }) else {
            return Ramp {
                entries: Vec::new(),
                end: RampEnd::NoPlan,
            };
        };
        let mut course = Course {
            pose: Pose { phase, rate: 0.0 },
            change: 0.0,
            said: start.done.max(done),
            entries: Vec::new(),
        };
        self.approach(&start, position, &mut course);
        let whole = phase == libm::floor(phase);
        let end = if at_start || (whole && self.stock.rests_at(phase as u64)) {
            RampEnd::Done
        } else {
            self.rise(&mut course)
        };
        Ramp {
            entries: course.entries,
            end,
        }
    }

    /// Where the path begins: at rest, a cycle before its first set-point. `None`: that one is not known, or was let go of.
    pub fn start(&self) -> Option<SetPoint> {
        let (&first, _) = self.stock.set_point(1)?;
        // Back at the acceleration of the first cycle; what its jerk adds is less than 1e-4 mm.
        let way = |k: usize| (first.velocity[k] - first.acceleration[k] * TICK.0 / 2.0) * TICK.0;
        let way: [f64; 3] = std::array::from_fn(way);
        Some(SetPoint {
            position: difference(first.position, way),
            velocity: [0.0; 3],
            acceleration: [0.0; 3],
            path_length: (first.path_length - dot(way, way).sqrt()).max(0.0),
            path_speed: 0.0,
            ..first
        })
    }

    /// Where a machine stands of which no motion is known, as [`Scaler::nearest`]: phase 0, where the path begins, unless it stands on the
    /// path (within `near`, mm) further on. A pause after command `done` is one that the person is still to see: nothing stands behind it.
    pub fn first_place(&self, cycles: u64, position: [f64; 3], near: f64, done: u64) -> Option<(f64, f64)> {
        let to = difference(position, self.start()?.position);
        let from_start = dot(to, to).sqrt();
        let (phase, distance) = self.nearest(1, cycles, position)?;
        let (_, number) = self.stock.set_point(libm::floor(phase) as u64)?;
        let pauses = (done + 1..number).any(|n| matches!(self.stock.command(n), Some(Command::Pause { .. })));
        if from_start <= near || distance > near || pauses {
            Some((0.0, from_start))
        } else {
            Some((phase, distance))
        }
    }

    /// The place of the plan nearest to a position, among `cycles` cycles from `from` on, and how far it is, mm.
    pub fn nearest(&self, from: u64, cycles: u64, position: [f64; 3]) -> Option<(f64, f64)> {
        let mut best: Option<(f64, f64)> = None;
        for cycle in from..from + cycles {
            let Some((a, _)) = self.stock.set_point(cycle) else { break };
            let along = self
                .stock
                .set_point(cycle + 1)
                .map_or([0.0; 3], |(b, _)| difference(b.position, a.position));
            let length = dot(along, along);
            let to = difference(position, a.position);
            let part = if length > 0.0 {
                (dot(to, along) / length).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let beside: [f64; 3] = std::array::from_fn(|k| to[k] - part * along[k]);
            let distance = dot(beside, beside).sqrt();
            if best.is_none_or(|(_, d)| distance < d) {
                // The end of a piece is the beginning of the next.
                best = Some((cycle as f64 + part.min(1.0 - f64::EPSILON), distance));
            }
            // Nearer than a pulse is there; a path may come by again.
            if distance < 5e-4 {
                break;
            }
        }
        best.map(|(phase, distance)| {
            if phase - libm::floor(phase) < 1e-9 {
                (libm::floor(phase), distance)
            } else {
                (phase, distance)
            }
        })
    }

    fn fall(&self, from: Pose, said: u64, share: f64) -> Ramp {
        let mut course = Course {
            pose: from,
            change: 0.0,
            said,
            entries: Vec::new(),
        };
        let smooth = self.smoothness(from.phase);
        let end = loop {
            if course.pose.rate <= 0.0 {
                break RampEnd::Done;
            }
            if course.entries.len() >= TAIL {
                break RampEnd::TooLong;
            }
            let rate = course.pose.rate;
            let Some((fall, _)) = self.room(course.pose, share) else {
                break RampEnd::NoPlan;
            };
            let brake = (2.0 * smooth * rate).sqrt() + smooth / 2.0;
            course.change = fall.min(course.change + smooth).min(brake);
            let next = if rate - course.change <= smooth / 2.0 {
                0.0
            } else {
                rate - course.change
            };
            match self.step(&mut course, next) {
                Some(true) => break RampEnd::Done,
                Some(false) => {}
                None => break RampEnd::NoPlan,
            }
        };
        Ramp {
            entries: course.entries,
            end,
        }
    }

    fn rise(&self, course: &mut Course) -> RampEnd {
        let smooth = self.smoothness(course.pose.phase);
        while course.pose.rate < 1.0 {
            if course.entries.len() >= LONGEST_LEAD {
                return RampEnd::TooLong;
            }
            let rate = course.pose.rate;
            let Some((_, rise)) = self.room(course.pose, SHARE) else {
                return RampEnd::NoPlan;
            };
            let arrive = (2.0 * smooth * (1.0 - rate)).sqrt() + smooth / 2.0;
            course.change = rise.min(course.change + smooth).min(arrive);
            let next = if 1.0 - rate - course.change <= smooth / 2.0 {
                1.0
            } else {
                rate + course.change
            };
            match self.step(course, next) {
                Some(true) => return RampEnd::Done,
                Some(false) => {}
                None => return RampEnd::NoPlan,
            }
        }
        self.land(course)
    }

    /// At full rate, but between two set-points of the plan: a little slower for a while, so that the plan's own are met.
    fn land(&self, course: &mut Course) -> RampEnd {
        let over = course.pose.phase - libm::floor(course.pose.phase);
        if over < 1e-9 {
            return RampEnd::Done;
        }
        // Rate 1 - over w(i), w(i) = 2/K sin^2(pi i/K): its sum is 1, its steepest 2 pi/K^2 and its bend 4 pi^2/K^3.
        let pi = core::f64::consts::PI;
        let cycles = self.landing_cycles(course.pose.phase, over);
        let began = course.pose.phase;
        for i in 1..=cycles as u64 {
            let sine = libm::sin(pi * i as f64 / cycles);
            let rate = 1.0 - over * 2.0 / cycles * sine * sine;
            if i as f64 == cycles {
                // Without what rounding has left over.
                let target = libm::round(began + cycles - over);
                course.pose.rate = 2.0 * (target - course.pose.phase) - 1.0;
                match self.step(course, 1.0) {
                    Some(_) => return RampEnd::Done,
                    None => return RampEnd::NoPlan,
                }
            }
            match self.step(course, rate) {
                Some(true) => return RampEnd::Done,
                Some(false) => {}
                None => return RampEnd::NoPlan,
            }
        }
        RampEnd::Done
    }

    /// How long a landing takes that the axes can do on top of what the plan does meanwhile.
    fn landing_cycles(&self, phase: f64, over: f64) -> f64 {
        let pi = core::f64::consts::PI;
        let (mut cycles, mut fastest, mut strongest) = (4.0f64, [0.0f64; 3], [0.0f64; 3]);
        // The longer it is, the more of the plan has a say in it.
        for (ahead, cycle) in (libm::floor(phase) as u64..).enumerate() {
            let Some((set_point, _)) = self.stock.set_point(cycle).filter(|_| ahead as f64 <= cycles + 1.0) else {
                break;
            };
            for k in 0..3 {
                fastest[k] = fastest[k].max(set_point.velocity[k].abs());
                strongest[k] = strongest[k].max(set_point.acceleration[k].abs());
                let share = (1.0 - strongest[k] / self.accelerations[k]).clamp(ON_TOP, LANDING);
                let v = over * fastest[k];
                let by_acceleration = (2.0 * pi * v / (share * self.accelerations[k] * TICK.0)).sqrt();
                let by_jerk = libm::cbrt(4.0 * pi * pi * v / (0.5 * self.jerks[k] * TICK.0 * TICK.0));
                cycles = cycles.max(by_acceleration.ceil()).max(by_jerk.ceil());
            }
        }
        cycles
    }

    /// One cycle further, at `rate` then; true when the plan is at rest there.
    fn step(&self, course: &mut Course, rate: f64) -> Option<bool> {
        let before = course.pose;
        let mut phase = before.phase + (before.rate + rate) / 2.0;
        let near = libm::round(phase);
        if (phase - near).abs() < 1e-9 {
            phase = near;
        }
        // A rest of the plan on the way is where this ends, or where it goes on as planned.
        let first = libm::floor(before.phase) as u64 + 1;
        for cycle in first..=libm::floor(phase) as u64 {
            if self.stock.rests_at(cycle) {
                self.say_up_to(course, cycle)?;
                let (&set_point, number) = self.stock.set_point(cycle)?;
                let pose = Pose {
                    phase: cycle as f64,
                    rate: 0.0,
                };
                self.say(course, Command::SetPoint(set_point), number, pose);
                return Some(true);
            }
        }
        let planned = self.planned(phase, rate, (rate - before.rate) / TICK.0)?;
        self.say_up_to(course, libm::ceil(phase) as u64)?;
        self.say(
            course,
            Command::SetPoint(planned.set_point),
            planned.done,
            Pose { phase, rate },
        );
        Some(false)
    }

    /// Says what is switched on the way to the set-point of a cycle.
    fn say_up_to(&self, course: &mut Course, cycle: u64) -> Option<()> {
        let (_, number) = self.stock.set_point(cycle)?;
        let pose = course.pose;
        for between in course.said + 1..number {
            match self.stock.command(between)? {
                Command::SetPoint(_) => {}
                command => self.say(course, *command, between, pose),
            }
        }
        Some(())
    }

    fn say(&self, course: &mut Course, command: Command, done: u64, pose: Pose) {
        course.said = course.said.max(done);
        course.pose = pose;
        course.entries.push(Posed {
            entry: Entry {
                command,
                done: course.said,
            },
            pose,
        });
    }

    /// Straight back to the path, from rest to rest.
    fn approach(&self, start: &Planned, position: [f64; 3], course: &mut Course) {
        let goal = start.set_point;
        let off = difference(position, goal.position);
        let length = dot(off, off).sqrt();
        // Below that, it is rounding.
        if length < 5e-4 {
            return;
        }
        let weakest = self.accelerations.iter().copied().fold(f64::INFINITY, f64::min);
        // Least jerk: 10 u^3 - 15 u^4 + 6 u^5 is fastest at 15/8, and accelerates by 5.77 and jerks by 60 at most.
        let least_jerk = self.jerks.iter().copied().fold(f64::INFINITY, f64::min);
        let by_speed = 1.875 * length / APPROACH;
        let by_acceleration = (5.78 * length / (0.5 * weakest)).sqrt();
        let by_jerk = libm::cbrt(60.0 * length / least_jerk);
        let cycles = (by_speed.max(by_acceleration).max(by_jerk) / TICK.0).ceil().max(10.0);
        let duration = cycles * TICK.0;
        for i in 1..=cycles as u64 {
            let u = i as f64 / cycles;
            let (left, speed, acceleration) = if i as f64 == cycles {
                (0.0, 0.0, 0.0)
            } else {
                (
                    1.0 - u * u * u * (10.0 - 15.0 * u + 6.0 * u * u),
                    -30.0 * u * u * (1.0 - u) * (1.0 - u) / duration,
                    -60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (duration * duration),
                )
            };
            let set_point = SetPoint {
                position: std::array::from_fn(|k| goal.position[k] + off[k] * left),
                velocity: off.map(|d| d * speed),
                acceleration: off.map(|d| d * acceleration),
                path_speed: length * -speed,
                rapid: false,
                planned_override: 1.0,
                tie: None,
                ..goal
            };
            let said = course.said;
            self.say(course, Command::SetPoint(set_point), said, course.pose);
        }
    }

    /// How much the rate may fall and rise in the next cycle with the axes within a share of their acceleration.
    fn room(&self, pose: Pose, share: f64) -> Option<(f64, f64)> {
        let here = self.planned(pose.phase, 1.0, 0.0)?.set_point;
        let (mut lowest, mut highest) = (-1.0 / TICK.0, 1.0 / TICK.0);
        for k in 0..3 {
            let v = here.velocity[k];
            let already = pose.rate * pose.rate * here.acceleration[k];
            // Where the plan itself uses more than the share, the ramp adds nothing to it.
            let limit = (share * self.accelerations[k]).max(already.abs());
            if v.abs() > 1e-9 {
                let (one, other) = ((-limit - already) / v, (limit - already) / v);
                lowest = lowest.max(one.min(other));
                highest = highest.min(one.max(other));
            }
            // A bend changes with the rate: 3 r r' q''.
            let bend = 3.0 * pose.rate * here.acceleration[k].abs();
            lowest = lowest.max(-BEND_SHARE * self.jerks[k] / bend);
            highest = highest.min(BEND_SHARE * self.jerks[k] / bend);
        }
        Some(((-lowest * TICK.0).max(0.0), (highest * TICK.0).max(0.0)))
    }

    /// How much the change of the rate in a cycle may change from one cycle to the next: by the axes' jerk at the highest speed near by.
    fn smoothness(&self, phase: f64) -> f64 {
        let from = libm::floor(phase) as u64;
        let near = (from..from + LOOKED_AT).map_while(|cycle| self.stock.set_point(cycle));
        let fastest = near.fold([1e-9f64; 3], |most, (s, _)| {
            std::array::from_fn(|k| most[k].max(s.velocity[k].abs()))
        });
        let jerk = (0..3).map(|k| JERK_SHARE * self.jerks[k] * TICK.0 * TICK.0 / fastest[k]);
        jerk.fold(0.1, f64::min).max(1e-6)
    }

    /// The plan at a phase, its time slowed to `rate`, which changes by `change` a second.
    fn planned(&self, phase: f64, rate: f64, change: f64) -> Option<Planned> {
        let cycle = libm::floor(phase);
        let u = phase - cycle;
        let (&a, number) = self.stock.set_point(cycle as u64)?;
        if u == 0.0 && rate == 1.0 && change == 0.0 {
            return Some(Planned {
                set_point: a,
                done: number,
            });
        }
        let b = if u > 0.0 {
            *self.stock.set_point(cycle as u64 + 1)?.0
        } else {
            a
        };
        let between = |from: f64, to: f64| from + (to - from) * u;
        let (u2, u3) = (u * u, u * u * u);
        let position = std::array::from_fn(|k| {
            let (m, n) = (a.velocity[k] * TICK.0, b.velocity[k] * TICK.0);
            (2.0 * u3 - 3.0 * u2 + 1.0) * a.position[k]
                + (u3 - 2.0 * u2 + u) * m
                + (3.0 * u2 - 2.0 * u3) * b.position[k]
                + (u3 - u2) * n
        });
        let velocity: [f64; 3] = std::array::from_fn(|k| between(a.velocity[k], b.velocity[k]));
        let acceleration: [f64; 3] = std::array::from_fn(|k| between(a.acceleration[k], b.acceleration[k]));
        let stands = rate == 0.0;
        Some(Planned {
            set_point: SetPoint {
                position,
                velocity: velocity.map(|v| v * rate),
                acceleration: std::array::from_fn(|k| {
                    if stands {
                        0.0
                    } else {
                        acceleration[k] * rate * rate + velocity[k] * change
                    }
                }),
                path_length: between(a.path_length, b.path_length),
                path_speed: between(a.path_speed, b.path_speed) * rate,
                ..b
            },
            done: number,
        })
    }
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
