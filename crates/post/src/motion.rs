//! Moves as a control can follow them: places are rounded before anything is decided by them, arcs that rounding would turn into full
//! circles are cut or straightened, splines become chords.

use crate::number::{scale, units_of};
use crate::posting::Posting;
use crate::sheet::Refusal;
use crate::statement::{Arc, Line, Pace, Statement};
use plan::{Feed, Move, Path, PathMode, Speed, SpeedProfile};
use units::{Point, Setup};

/// Chords of one curve, at most: what a control has to read for it is megabytes then.
const MOST_CHORDS: usize = 200_000;

/// Longest piece of a circle, radians: nearer to a full turn, rounding of the two ends decides between all of it and nothing.
const LONGEST_SWEEP: f64 = 5.2;

/// How much of the feed may change from one block to the next along a path with a speed profile.
const PROFILE_STEP: f64 = 0.1;

impl Posting<'_, '_> {
    /// Writes a move.
    pub(crate) fn travel(&mut self, go: &Move) -> Result<(), Refusal> {
        let path = go.path.in_frame(&self.base_from_setup);
        if !path.is_sound() {
            return Err(Refusal::new(
                "not-finite",
                "a move has a coordinate that is no finite number, or no length where it needs one",
                "correct the program",
            ));
        }
        self.fingerprint.travel(go, &path);
        if self.lifted > 0 && go.derived {
            return self.come_down(&path);
        }
        let pace = match go.speed {
            Speed::Rapid => Pace::Rapid,
            Speed::Feed(Feed::Thread(thread)) => return self.thread(&path, thread),
            Speed::Feed(Feed::PerTime(speed)) => Pace::PerMinute(speed.mm_per_min()),
            Speed::Feed(Feed::PerRevolution(advance)) => Pace::PerRevolution(advance.0),
            // The whole move in a time is its length in that time; no control needs another mode for it.
            Speed::Feed(Feed::WholeMove(time)) => Pace::PerMinute(path.length() / time.0 * 60.0),
        };
        if let Pace::PerMinute(feed) | Pace::PerRevolution(feed) = pace
            && !(feed.is_finite() && feed > 0.0)
        {
            return Err(Refusal::new(
                "feed",
                format!("a feed of {feed}"),
                "give the move a feed above 0",
            ));
        }
        match &go.profile {
            Some(profile) if pace != Pace::Rapid => self.by_profile(&path, profile, pace),
            _ => self.follow(&path, pace),
        }
    }

    /// From out of the way to a path: first across, then in.
    fn come_down(&mut self, path: &Path<Setup>) -> Result<(), Refusal> {
        let axis = self.tool_axis();
        let across = self.lifted == 2;
        self.lifted -= 1;
        let to = self.rounded(path.end())?;
        let mut words = [None; 3];
        for k in self.axes() {
            if (*k == axis) != across {
                words[*k] = Some(to[*k]);
                self.at[*k] = Some(to[*k]);
            }
        }
        self.write(&Statement::Line(&Line {
            words,
            pace: Pace::Rapid,
        }))
    }

    fn follow(&mut self, path: &Path<Setup>, pace: Pace) -> Result<(), Refusal> {
        match path {
            Path::Line { from, to } => self.straight(*from, *to, pace),
            Path::Arc(arc) => self.circle(path, arc, pace),
            Path::Spline(_) => {
                let tolerance = match self.path_mode {
                    PathMode::Tolerance(Some(t)) => (t.0 * 0.5).clamp(self.increment(), self.options.chord),
                    _ => self.options.chord,
                };
                self.notice_chords("splines", tolerance);
                self.chords(path, tolerance, pace)
            }
        }
    }

    fn notice_chords(&mut self, what: &str, tolerance: f64) {
        self.sheet
            .notice(format!("{what} are chords within {} mm", (tolerance * 1e6).round() / 1e6));
    }

    /// One of the last decimal, mm.
    fn increment(&self) -> f64 {
        1.0 / scale(self.sheet.paper().lengths.places)
    }

    /// The axes that moves have.
    fn axes(&self) -> &'static [usize] {
        if self.sheet.turning { &[0, 2] } else { &[0, 1, 2] }
    }

    /// The axis along which the tool comes in.
    fn tool_axis(&self) -> usize {
        if self.sheet.turning { 0 } else { 2 }
    }

    /// A place as words say it.
    pub(crate) fn rounded(&self, place: Point<Setup>) -> Result<[i64; 3], Refusal> {
        let paper = self.sheet.paper();
        let mut units = [0; 3];
        for k in 0..3 {
            let value = place.xyz[k] * self.word_factor(k);
            if !value.is_finite() || value.abs() > paper.largest {
                return Err(Refusal::new(
                    "too-far",
                    format!(
                        "{}{value} is beyond the {} mm that the control reads",
                        ["X", "Y", "Z"][k],
                        paper.largest
                    ),
                    "correct the program, or its set-up",
                ));
            }
            units[k] = units_of(value, paper.lengths.places).unwrap_or(0);
        }
        if self.sheet.turning && units[1] != 0 {
            return Err(Refusal::new(
                "lathe-y",
                format!("a lathe's program goes to Y{}", place.xyz[1]),
                "only X and Z are posted for lathes",
            ));
        }
        Ok(units)
    }

    /// X words of a lathe are diameters.
    fn word_factor(&self, axis: usize) -> f64 {
        if self.sheet.turning && axis == 0 { 2.0 } else { 1.0 }
    }

    /// The axes that a move to `to` has to name: those that the control has elsewhere.
    fn words(&mut self, from: [i64; 3], to: [i64; 3]) -> [Option<i64>; 3] {
        let mut words = [None; 3];
        for &k in self.axes() {
            // Where an axis stands is not known behind a move in machine coordinates; then the program's own word decides.
            let stays = self.at[k].unwrap_or(from[k]) == to[k];
            if !stays || self.force[k] {
                words[k] = Some(to[k]);
                self.at[k] = Some(to[k]);
                self.force[k] = false;
            }
        }
        words
    }

    fn straight(&mut self, from: Point<Setup>, to: Point<Setup>, pace: Pace) -> Result<(), Refusal> {
        let (from, to) = (self.rounded(from)?, self.rounded(to)?);
        let words = self.words(from, to);
        if words == [None; 3] {
            return Ok(()); // shorter than the control can say
        }
        self.write(&Statement::Line(&Line { words, pace }))
    }

    /// The path as straight pieces.
    fn chords(&mut self, path: &Path<Setup>, tolerance: f64, pace: Pace) -> Result<(), Refusal> {
        let mut places = Vec::new();
        path.flatten(tolerance, MOST_CHORDS, |_, place| places.push(place));
        if places.len() > MOST_CHORDS {
            return Err(too_many_chords(tolerance));
        }
        for pair in places.windows(2) {
            self.straight(pair[0], pair[1], pace)?;
        }
        Ok(())
    }

    fn circle(&mut self, path: &Path<Setup>, arc: &plan::Arc<Setup>, pace: Pace) -> Result<(), Refusal> {
        let increment = self.increment();
        let axis = (0..3).find(|k| arc.normal.xyz[*k].abs() > 1.0 - 1e-12);
        let radius = arc.radius();
        let plain = axis.filter(|axis| {
            let of_the_control = if self.sheet.turning {
                *axis == 1
            } else {
                self.control.arc_planes().contains(axis)
            };
            of_the_control && radius >= 10.0 * increment && radius <= 1e5
        });
        let Some(normal) = plain else {
            let tolerance = self.options.chord.min((radius * 0.1).max(increment));
            self.notice_chords("arcs that the control has no words for", tolerance);
            return self.chords(path, tolerance, pace);
        };
        if self.control.arc_planes() == [2] && arc.rise != 0.0 {
            // A helix that the control can only say by an angle: see its file.
            self.force = [true, true, false];
        }
        let count = (arc.sweep.0.abs() / LONGEST_SWEEP).ceil().max(1.0);
        let count = if count > 1.0 {
            (arc.sweep.0.abs() / std::f64::consts::PI).ceil()
        } else {
            count
        };
        if !count.is_finite() || count > MOST_CHORDS as f64 {
            return Err(Refusal::new(
                "too-many-turns",
                format!("a helix of {} turns", arc.sweep.0.abs() / std::f64::consts::TAU),
                "correct the program",
            ));
        }
        let pieces = count as u32;
        let [first, second] = [[1, 2], [2, 0], [0, 1]][normal];
        let sign = arc.normal.xyz[normal].signum();
        for piece in 0..pieces {
            let (start, end) = (path.at(f64::from(piece) / count), path.at(f64::from(piece + 1) / count));
            let (start_units, to) = (self.rounded(start)?, self.rounded(end)?);
            let mut from = start_units;
            for (from, at) in from.iter_mut().zip(self.at) {
                *from = at.unwrap_or(*from);
            }
            if self.axes().iter().any(|&k| k != normal && self.at[k].is_none()) {
                return Err(Refusal::new(
                    "arc-from-nowhere",
                    "an arc begins where no word of the program has said the tool to be",
                    "begin with a straight move",
                ));
            }
            let places = self.sheet.paper().lengths.places;
            let value = |units: i64, k: usize| units as f64 / scale(places) / self.word_factor(k);
            let mut to_centre = [0.0; 3];
            for k in [first, second] {
                to_centre[k] = arc.centre.xyz[k] - value(from[k], k);
            }
            let way = arc.sweep.0 * sign;
            let sweep = arc.sweep.0.abs() / count;
            // What the control will make of the rounded numbers.
            let angle = |units: [i64; 3]| {
                let [a, b] = [first, second].map(|k| value(units[k], k) - arc.centre.xyz[k]);
                libm::atan2(b, a)
            };
            let mut read = (angle(to) - angle(from)) * way.signum();
            if read <= 0.0 {
                read += std::f64::consts::TAU;
            }
            let short = [first, second].iter().all(|&k| (to[k] - from[k]).abs() < 3);
            if short || (read - sweep).abs() > 0.2 {
                // Too short to be an arc for the control: straight, and still within an increment of it.
                if short && sweep < 1.0 {
                    self.straight(start, end, pace)?;
                } else {
                    let piece = part(path, f64::from(piece) / count, f64::from(piece + 1) / count);
                    self.chords(&piece, increment, pace)?;
                }
                continue;
            }
            let rises = to[normal] != from[normal] && self.axes().contains(&normal);
            for k in [first, second] {
                self.at[k] = Some(to[k]);
            }
            if self.axes().contains(&normal) && (rises || self.at[normal].is_some()) {
                self.at[normal] = Some(to[normal]);
            }
            self.write(&Statement::Arc(&Arc {
                normal,
                counterclockwise: way > 0.0,
                to,
                rises,
                from,
                to_centre,
                sweep: sweep.to_degrees(),
                pace,
            }))?;
        }
        Ok(())
    }

    /// Pieces of the path, each with the feed that the profile has in its middle.
    fn by_profile(&mut self, path: &Path<Setup>, profile: &SpeedProfile, pace: Pace) -> Result<(), Refusal> {
        self.sheet
            .notice("feeds that change along a path are steps of at most a tenth of the feed");
        let scaled = |factor: f64| match pace {
            Pace::PerMinute(feed) => Pace::PerMinute(feed * factor),
            Pace::PerRevolution(feed) => Pace::PerRevolution(feed * factor),
            Pace::Rapid => Pace::Rapid,
        };
        if profile.points.iter().any(|point| !(point.1.is_finite() && point.1 > 0.0)) {
            return Err(Refusal::new(
                "feed",
                "a speed profile has a factor that is not above 0",
                "correct the profile",
            ));
        }
        let mut borders: Vec<f64> = vec![0.0];
        for pair in profile.points.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let steps = ((b.1 - a.1).abs() / PROFILE_STEP).ceil().clamp(1.0, 1000.0);
            borders.extend((0..steps as u32).map(|k| a.0 + (b.0 - a.0) * f64::from(k) / steps));
            borders.push(b.0);
        }
        borders.push(1.0);
        borders.retain(|border| (0.0..=1.0).contains(border));
        borders.sort_by(f64::total_cmp);
        borders.dedup_by(|a, b| *a - *b < 1e-9);
        if let Path::Spline(_) = path {
            return self.chords_by_profile(path, profile, &borders, &scaled);
        }
        for pair in borders.windows(2) {
            let factor = profile.factor((pair[0] + pair[1]) / 2.0);
            self.follow(&part(path, pair[0], pair[1]), scaled(factor))?;
        }
        Ok(())
    }

    /// The same for a curve whose parameter is not its length.
    fn chords_by_profile(
        &mut self,
        path: &Path<Setup>,
        profile: &SpeedProfile,
        borders: &[f64],
        scaled: &dyn Fn(f64) -> Pace,
    ) -> Result<(), Refusal> {
        let tolerance = self.options.chord;
        self.notice_chords("splines", tolerance);
        let mut places = Vec::new();
        path.flatten(tolerance, MOST_CHORDS, |_, place| places.push(place));
        if places.len() > MOST_CHORDS {
            return Err(too_many_chords(tolerance));
        }
        let total: f64 = places.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let mut travelled = 0.0;
        for pair in places.windows(2) {
            let length = pair[0].distance(pair[1]);
            let (from, to) = (travelled / total, (travelled + length) / total);
            travelled += length;
            if to <= from || !total.is_normal() {
                continue;
            }
            let mut cuts = vec![from];
            cuts.extend(borders.iter().filter(|border| **border > from && **border < to));
            cuts.push(to);
            for cut in cuts.windows(2) {
                let at = |fraction: f64| pair[0].toward(pair[1], (fraction - from) / (to - from));
                let factor = profile.factor((cut[0] + cut[1]) / 2.0);
                self.straight(at(cut[0]), at(cut[1]), scaled(factor))?;
            }
        }
        Ok(())
    }
}

fn too_many_chords(tolerance: f64) -> Refusal {
    Refusal::new(
        "too-many-chords",
        format!("a curve takes more than {MOST_CHORDS} chords to stay within {tolerance} mm"),
        "allow a larger deviation with --chord, or cut the curve into several",
    )
}

/// The part of a line or an arc between two fractions of its length.
fn part(path: &Path<Setup>, from: f64, to: f64) -> Path<Setup> {
    match path {
        Path::Arc(arc) => Path::Arc(plan::Arc {
            from: path.at(from),
            centre: arc.centre + arc.normal * (arc.rise * from),
            normal: arc.normal,
            sweep: arc.sweep * (to - from),
            rise: arc.rise * (to - from),
        }),
        _ => Path::Line {
            from: path.at(from),
            to: path.at(to),
        },
    }
}
