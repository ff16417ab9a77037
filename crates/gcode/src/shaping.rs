//! Programmable mirror image, scaling, rotation and polar coordinates of a mill: G51.1, G51, G68, G16.
//!
//! The order is the control's: polar words become places, places are mirrored, then scaled, then rotated. What comes out is a place in the
//! work system; everything behind (compensation, cycles, #5001) sees that. Codes that name the work system anew while it is scaled or
//! rotated are alarm 412, as on the control: where they would count from is not defined.

use crate::block::Block;
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Interpreter, g_name, missing_word};
use crate::profile::Plane;

/// What is in force of these codes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Shaping {
    polar: Option<Polar>,
    /// The place of the mirror along each axis.
    mirror: [Option<f64>; 3],
    scale: Option<Scale>,
    rotation: Option<Rotation>,
}

/// G16: radius, and angle in degrees, as they were written last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Polar {
    radius: f64,
    angle: f64,
    centre: [f64; 2],
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Scale {
    centre: [f64; 3],
    factor: [f64; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Rotation {
    plane: Plane,
    centre: [f64; 2],
    sine: f64,
    cosine: f64,
}

/// What a block says of a place: by axis, mm, and whether it adds.
pub(crate) type Said = [Option<(f64, bool)>; 3];

impl Shaping {
    /// True when a written place is the place.
    pub(crate) fn is_plain(&self) -> bool {
        self.polar.is_none() && self.is_straight()
    }

    /// True when there is neither mirror, scale nor rotation.
    fn is_straight(&self) -> bool {
        self.mirror == [None; 3] && self.scale.is_none() && self.rotation.is_none()
    }

    pub(crate) fn is_polar(&self) -> bool {
        self.polar.is_some()
    }

    pub(crate) fn is_scaled(&self) -> bool {
        self.scale.is_some()
    }

    pub(crate) fn is_rotated(&self) -> bool {
        self.rotation.is_some()
    }

    pub(crate) fn is_mirrored(&self) -> bool {
        self.mirror != [None; 3]
    }

    fn place(&self, mut at: [f64; 3]) -> [f64; 3] {
        for (k, mirror) in self.mirror.iter().enumerate() {
            if let Some(place) = mirror {
                at[k] = 2.0 * place - at[k];
            }
        }
        if let Some(scale) = &self.scale {
            at = std::array::from_fn(|k| scale.centre[k] + (at[k] - scale.centre[k]) * scale.factor[k]);
        }
        if let Some(r) = &self.rotation {
            let [a, b, _] = r.plane.axes();
            let (x, y) = (at[a] - r.centre[0], at[b] - r.centre[1]);
            at[a] = r.centre[0] + x * r.cosine - y * r.sine;
            at[b] = r.centre[1] + x * r.sine + y * r.cosine;
        }
        at
    }

    fn written(&self, mut at: [f64; 3]) -> [f64; 3] {
        if let Some(r) = &self.rotation {
            let [a, b, _] = r.plane.axes();
            let (x, y) = (at[a] - r.centre[0], at[b] - r.centre[1]);
            at[a] = r.centre[0] + x * r.cosine + y * r.sine;
            at[b] = r.centre[1] - x * r.sine + y * r.cosine;
        }
        if let Some(scale) = &self.scale {
            at = std::array::from_fn(|k| scale.centre[k] + (at[k] - scale.centre[k]) / scale.factor[k]);
        }
        for (k, mirror) in self.mirror.iter().enumerate() {
            if let Some(place) = mirror {
                at[k] = 2.0 * place - at[k];
            }
        }
        at
    }

    /// A direction with its length, such as the way from an arc's start to its centre.
    pub(crate) fn way(&self, way: [f64; 3]) -> [f64; 3] {
        let (to, from) = (self.place(way), self.place([0.0; 3]));
        std::array::from_fn(|k| to[k] - from[k])
    }

    /// True when what goes clockwise in a plane goes the other way round.
    pub(crate) fn turns_round(&self, plane: Plane) -> bool {
        let [a, b, _] = plane.axes();
        [a, b].iter().fold(false, |turned, k| {
            turned ^ self.mirror[*k].is_some() ^ self.scale.is_some_and(|s| s.factor[*k] < 0.0)
        })
    }

    /// By how much radii in a plane grow; `None` when circles become ellipses.
    pub(crate) fn radius_factor(&self, plane: Plane) -> Option<f64> {
        let [a, b, _] = plane.axes();
        match &self.scale {
            None => Some(1.0),
            Some(s) => ((s.factor[a].abs() - s.factor[b].abs()).abs() < 1e-12).then_some(s.factor[a].abs()),
        }
    }
}

impl Interpreter {
    /// Where the words of a block point.
    pub(crate) fn place_of(&mut self, said: Said) -> [f64; 3] {
        let mut to = if self.shaping.is_straight() {
            self.tip
        } else {
            self.shaping.written(self.tip)
        };
        let [a, b, _] = self.plane.axes();
        let polar = self.shaping.polar;
        for (k, word) in said.iter().enumerate() {
            if polar.is_some() && (k == a || k == b) {
                continue;
            }
            if let Some((value, adds)) = word {
                to[k] = if *adds { to[k] + value } else { *value };
            }
        }
        if let Some(mut polar) = polar {
            // The radius counts from the work zero, incremental from where the tip was.
            if let Some((radius, adds)) = said[a] {
                polar.radius = radius;
                polar.centre = if adds { [to[a], to[b]] } else { [0.0; 2] };
            }
            if let Some((angle, adds)) = said[b] {
                polar.angle = if adds { polar.angle + angle } else { angle };
            }
            if said[a].is_some() || said[b].is_some() {
                let angle = polar.angle.to_radians();
                to[a] = polar.centre[0] + polar.radius * libm::cos(angle);
                to[b] = polar.centre[1] + polar.radius * libm::sin(angle);
                self.shaping.polar = Some(polar);
            }
        }
        if self.shaping.is_straight() {
            to
        } else {
            self.shaping.place(to)
        }
    }

    /// The words of a block that name places, taken. Of polar coordinates the second axis of the plane is an angle and no length.
    pub(crate) fn said(&mut self, block: &mut Block, site: Site<'_>, without: Option<usize>) -> Outcome<Said> {
        let mut said: Said = [None; 3];
        let angle = self.shaping.is_polar().then(|| self.plane.axes()[1]);
        for word in self.profile.axes.iter().filter(|w| Some(w.axis) != without) {
            let Some(w) = block.take(word.letter) else { continue };
            if said[word.axis].is_some() {
                let letter = char::from(word.letter);
                return Err(Fault::new(
                    w.at,
                    0,
                    "axis-twice",
                    format!("{letter} names an axis that another word of this block names"),
                    "keep one of them",
                ));
            }
            let value = match angle == Some(word.axis) {
                true => w.value,
                false => self.length(word.letter, w, site) * word.factor,
            };
            said[word.axis] = Some((value, word.incremental.unwrap_or(self.incremental)));
        }
        Ok(said)
    }

    /// G15 and G16.
    pub(crate) fn set_polar(&mut self, on: bool) {
        if on != self.shaping.is_polar() {
            let [a, b, _] = self.plane.axes();
            let from = self.shaping.written(self.tip);
            let angle = libm::atan2(from[b], from[a]).to_degrees();
            let radius = libm::hypot(from[a], from[b]);
            self.shaping.polar = on.then_some(Polar {
                radius,
                angle: if angle < 0.0 { angle + 360.0 } else { angle },
                centre: [0.0; 2],
            });
        }
    }

    /// The compensation in force would be on the other side from one move to the next.
    fn not_compensated(&self, at: usize, code: &str) -> Outcome<()> {
        match self.compensation.is_wanted() {
            false => Ok(()),
            true => Err(Fault::new(
                at,
                412,
                "shape-compensated",
                format!("{code} while cutter compensation is in force"),
                "cancel it with G40 first",
            )),
        }
    }

    /// G68: X Y the centre, R the angle counterclockwise in degrees.
    pub(crate) fn begin_rotation(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        self.not_compensated(at, "G68")?;
        let Some(r) = block.take(b'R') else {
            return Err(missing_word(at, "G68", "R, the angle"));
        };
        let [a, b, _] = self.plane.axes();
        self.shaping.rotation = None;
        let here = self.shaping.written(self.tip);
        let said = self.said(block, site, None)?;
        let centre = [a, b].map(|k| match said[k] {
            None => here[k],
            Some((value, _)) => value,
        });
        // The centre is written before mirror and scale as any place is.
        let mut whole = here;
        (whole[a], whole[b]) = (centre[0], centre[1]);
        let whole = self.shaping.place(whole);
        let (sine, cosine) = (
            crate::evaluate::sin_degrees(r.value),
            crate::evaluate::sin_degrees(r.value + 90.0),
        );
        self.shaping.rotation = Some(Rotation {
            plane: self.plane,
            centre: [whole[a], whole[b]],
            sine,
            cosine,
        });
        Ok(())
    }

    /// G69.
    pub(crate) fn end_rotation(&mut self) {
        self.shaping.rotation = None;
    }

    /// G51: X Y Z the centre, P one factor, or I J K one for each axis; without a point they count thousandths.
    pub(crate) fn begin_scale(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        self.not_compensated(at, "G51")?;
        if self.shaping.rotation.is_some() {
            return Err(Fault::new(
                at,
                412,
                "shape-order",
                "G51 while G68 is in force",
                "scale first, then rotate",
            ));
        }
        let read = |w: crate::block::Word| if w.has_point || w.computed { w.value } else { w.value * 0.001 };
        let one = block.take(b'P').map(read);
        let each = [b'I', b'J', b'K'].map(|letter| block.take(letter).map(read));
        if one.is_none() && each == [None; 3] {
            return Err(missing_word(at, "G51", "P, or I J K, the scale"));
        }
        let factor = each.map(|own| own.or(one).unwrap_or(1.0));
        if factor.iter().any(|f| *f == 0.0 || !f.is_finite()) {
            return Err(Fault::new(
                at,
                0,
                "scale-zero",
                "a scale of 0 makes everything one point",
                "correct P, I, J or K",
            ));
        }
        self.shaping.scale = None;
        let here = self.shaping.written(self.tip);
        let said = self.said(block, site, None)?;
        let centre: [f64; 3] = std::array::from_fn(|k| said[k].map_or(here[k], |(value, _)| value));
        self.shaping.scale = Some(Scale {
            centre: self.shaping.place(centre),
            factor,
        });
        Ok(())
    }

    /// G50.
    pub(crate) fn end_scale(&mut self) {
        self.shaping.scale = None;
    }

    /// G51.1: a mirror at the place of each axis that is named.
    pub(crate) fn begin_mirror(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        self.not_compensated(at, "G51.1")?;
        if self.shaping.rotation.is_some() || self.shaping.scale.is_some() {
            return Err(Fault::new(
                at,
                412,
                "shape-order",
                "G51.1 while G51 or G68 is in force",
                "mirror first, then scale, then rotate",
            ));
        }
        let said = self.said(block, site, None)?;
        if said == [None; 3] {
            return Err(missing_word(at, "G51.1", "an axis word, the place of the mirror"));
        }
        for (k, word) in said.iter().enumerate() {
            if let Some((place, _)) = word {
                self.shaping.mirror[k] = Some(*place);
            }
        }
        Ok(())
    }

    /// G50.1: no mirror on the axes that are named, or on none.
    pub(crate) fn end_mirror(&mut self, block: &mut Block) {
        let named: Vec<usize> = self
            .profile
            .axes
            .iter()
            .filter(|w| block.take(w.letter).is_some())
            .map(|w| w.axis)
            .collect();
        for k in 0..3 {
            if named.is_empty() || named.contains(&k) {
                self.shaping.mirror[k] = None;
            }
        }
    }

    /// Refuses a code that names the work system anew while it is scaled or rotated.
    pub(crate) fn only_unshaped(&self, code: u16, at: usize) -> Outcome<()> {
        if self.shaping.is_straight() {
            return Ok(());
        }
        Err(Fault::new(
            at,
            412,
            "shaped-system",
            format!("{} while G51, G51.1 or G68 is in force", g_name(code)),
            "cancel them first: G69, G50, G50.1",
        ))
    }
}
