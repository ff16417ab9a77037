//! Points that know in which frame their numbers are, and the transforms between frames.
//!
//! Names read `target_from_source`, so that a product reads itself: `machine_from_setup * point_in_setup` is a point in the machine.
//! Three frames: [`Machine`] (home = 0, what axes and records speak), [`Setup`] (what a program is written in), [`Part`].
//! Lathe X is a radius everywhere in here.

use core::fmt;
use core::marker::PhantomData;
use core::ops::{Add, Mul, Neg, Sub};

/// A frame of reference; only the types below are.
pub trait Frame: Copy + Clone + fmt::Debug + PartialEq + 'static {
    /// How the frame is called in reports.
    const NAME: &'static str;
}

/// The machine's own frame: home is 0, units are axis positions of the gauge point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Machine;
/// The frame a program is written in: a work offset of G-code, the nearest enclosing set-up of STEP-NC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup;
/// The frame of the part's drawing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part;

impl Frame for Machine {
    const NAME: &'static str = "machine";
}
impl Frame for Setup {
    const NAME: &'static str = "setup";
}
impl Frame for Part {
    const NAME: &'static str = "part";
}

/// A place, in millimetres, in frame `F`.
#[derive(Clone, Copy, PartialEq)]
pub struct Point<F> {
    /// X, Y, Z in millimetres.
    pub xyz: [f64; 3],
    frame: PhantomData<F>,
}

/// A displacement, in millimetres, in frame `F`; directions are vectors of length 1.
#[derive(Clone, Copy, PartialEq)]
pub struct Vector<F> {
    /// X, Y, Z in millimetres.
    pub xyz: [f64; 3],
    frame: PhantomData<F>,
}

impl<F> Point<F> {
    /// The origin.
    pub const ORIGIN: Self = Self::new(0.0, 0.0, 0.0);
    /// A place from its coordinates in millimetres.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self {
            xyz: [x, y, z],
            frame: PhantomData,
        }
    }
    /// A place from its coordinates in millimetres.
    pub const fn from_xyz(xyz: [f64; 3]) -> Self {
        Self { xyz, frame: PhantomData }
    }
}
impl<F: Frame> Point<F> {
    /// Distance to another place, mm.
    pub fn distance(self, other: Self) -> f64 {
        (self - other).length()
    }
    /// The place a fraction `t` of the way to `other`.
    pub fn toward(self, other: Self, t: f64) -> Self {
        self + (other - self) * t
    }
    /// False when a coordinate is infinite or not a number.
    pub fn is_finite(self) -> bool {
        self.xyz.iter().all(|c| c.is_finite())
    }
}

impl<F> Vector<F> {
    /// No displacement.
    pub const ZERO: Self = Self::new(0.0, 0.0, 0.0);
    /// The direction of X.
    pub const X: Self = Self::new(1.0, 0.0, 0.0);
    /// The direction of Y.
    pub const Y: Self = Self::new(0.0, 1.0, 0.0);
    /// The direction of Z.
    pub const Z: Self = Self::new(0.0, 0.0, 1.0);
    /// A displacement from its components in millimetres.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self {
            xyz: [x, y, z],
            frame: PhantomData,
        }
    }
    /// A displacement from its components in millimetres.
    pub const fn from_xyz(xyz: [f64; 3]) -> Self {
        Self { xyz, frame: PhantomData }
    }
}
impl<F: Frame> Vector<F> {
    /// Inner product.
    pub fn dot(self, o: Self) -> f64 {
        self.xyz[0] * o.xyz[0] + self.xyz[1] * o.xyz[1] + self.xyz[2] * o.xyz[2]
    }
    /// Outer product, right-handed.
    pub fn cross(self, o: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.xyz, o.xyz);
        Self::new(b * z - c * y, c * x - a * z, a * y - b * x)
    }
    /// Length in millimetres.
    pub fn length(self) -> f64 {
        libm::sqrt(self.dot(self))
    }
    /// The same direction with length 1; `None` when there is no direction.
    pub fn unit(self) -> Option<Self> {
        let length = self.length();
        (length > 0.0 && length.is_finite()).then(|| self * (1.0 / length))
    }
}

impl<F: Frame> Add<Vector<F>> for Point<F> {
    type Output = Point<F>;
    fn add(self, v: Vector<F>) -> Point<F> {
        Point::new(self.xyz[0] + v.xyz[0], self.xyz[1] + v.xyz[1], self.xyz[2] + v.xyz[2])
    }
}
impl<F: Frame> Sub<Vector<F>> for Point<F> {
    type Output = Point<F>;
    fn sub(self, v: Vector<F>) -> Point<F> {
        self + -v
    }
}
impl<F: Frame> Sub for Point<F> {
    type Output = Vector<F>;
    fn sub(self, o: Point<F>) -> Vector<F> {
        Vector::new(self.xyz[0] - o.xyz[0], self.xyz[1] - o.xyz[1], self.xyz[2] - o.xyz[2])
    }
}
impl<F: Frame> Add for Vector<F> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Vector::new(self.xyz[0] + o.xyz[0], self.xyz[1] + o.xyz[1], self.xyz[2] + o.xyz[2])
    }
}
impl<F: Frame> Sub for Vector<F> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}
impl<F: Frame> Neg for Vector<F> {
    type Output = Self;
    fn neg(self) -> Self {
        Vector::new(-self.xyz[0], -self.xyz[1], -self.xyz[2])
    }
}
impl<F: Frame> Mul<f64> for Vector<F> {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        Vector::new(self.xyz[0] * k, self.xyz[1] * k, self.xyz[2] * k)
    }
}
impl<F: Frame> fmt::Debug for Point<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{:?}", F::NAME, self.xyz)
    }
}
impl<F: Frame> fmt::Debug for Vector<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-vector{:?}", F::NAME, self.xyz)
    }
}

/// A rigid motion that takes places of frame `Source` into frame `Target`.
#[derive(Clone, Copy, PartialEq)]
pub struct Transform<Target, Source> {
    /// Rows of the rotation matrix.
    pub rotation: [[f64; 3]; 3],
    /// The source's origin, in the target frame, mm.
    pub origin: [f64; 3],
    frames: PhantomData<(Target, Source)>,
}

impl<T: Frame, S: Frame> Transform<T, S> {
    /// Both frames coincide.
    pub const IDENTITY: Self = Self {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        origin: [0.0; 3],
        frames: PhantomData,
    };

    /// A shift without rotation: `origin` is the source's origin in the target frame.
    pub const fn shift(origin: [f64; 3]) -> Self {
        Self {
            origin,
            ..Self::IDENTITY
        }
    }

    /// From the place of the source's origin and the directions of its Z and X axes, all in the target frame. X is projected square to
    /// Z, as ISO 10303-42 axis2_placement_3d asks; when it has no part square to Z, another direction is chosen.
    /// `None` when `z` has no direction.
    pub fn from_axes(origin: Point<T>, z: Vector<T>, x: Vector<T>) -> Option<Self> {
        let z = z.unit()?;
        let x = (x - z * x.dot(z))
            .unit()
            .or_else(|| (Vector::X - z * Vector::X.dot(z)).unit())
            .or_else(|| Vector::Y.unit())?;
        let y = z.cross(x);
        let rotation = core::array::from_fn(|row| [x.xyz[row], y.xyz[row], z.xyz[row]]);
        Some(Self {
            rotation,
            origin: origin.xyz,
            frames: PhantomData,
        })
    }

    /// The same motion backwards.
    pub fn inverse(&self) -> Transform<S, T> {
        let r = &self.rotation;
        let rotation = core::array::from_fn(|row| [r[0][row], r[1][row], r[2][row]]);
        let mut back = Transform {
            rotation,
            origin: [0.0; 3],
            frames: PhantomData,
        };
        let o = back.turn(self.origin);
        back.origin = [-o[0], -o[1], -o[2]];
        back
    }

    fn turn(&self, v: [f64; 3]) -> [f64; 3] {
        core::array::from_fn(|row| {
            let r = &self.rotation[row];
            r[0] * v[0] + r[1] * v[1] + r[2] * v[2]
        })
    }

    /// True when axes stay parallel: a plain work offset.
    pub fn is_shift(&self) -> bool {
        self.rotation == Self::IDENTITY.rotation
    }
}
impl<T: Frame, S: Frame> Mul<Point<S>> for Transform<T, S> {
    type Output = Point<T>;
    fn mul(self, p: Point<S>) -> Point<T> {
        let v = self.turn(p.xyz);
        Point::new(v[0] + self.origin[0], v[1] + self.origin[1], v[2] + self.origin[2])
    }
}
impl<T: Frame, S: Frame> Mul<Vector<S>> for Transform<T, S> {
    type Output = Vector<T>;
    fn mul(self, v: Vector<S>) -> Vector<T> {
        Vector::from_xyz(self.turn(v.xyz))
    }
}
impl<T: Frame, M: Frame, S: Frame> Mul<Transform<M, S>> for Transform<T, M> {
    type Output = Transform<T, S>;
    fn mul(self, inner: Transform<M, S>) -> Transform<T, S> {
        let columns: [[f64; 3]; 3] = core::array::from_fn(|c| self.turn(core::array::from_fn(|r| inner.rotation[r][c])));
        let rotation = core::array::from_fn(|r| core::array::from_fn(|c| columns[c][r]));
        let o = self.turn(inner.origin);
        let origin = core::array::from_fn(|k| o[k] + self.origin[k]);
        Transform {
            rotation,
            origin,
            frames: PhantomData,
        }
    }
}
impl<T: Frame, S: Frame> fmt::Debug for Transform<T, S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}_from_{} {:?}", T::NAME, S::NAME, self.origin)?;
        if self.is_shift() {
            Ok(())
        } else {
            write!(f, " turned {:?}", self.rotation)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quarter_turn() -> Transform<Machine, Setup> {
        Transform::from_axes(Point::new(100.0, 50.0, 0.0), Vector::Z, Vector::Y).expect("Z has a direction")
    }

    #[test]
    fn a_setup_turned_a_quarter_takes_its_x_to_the_machines_y() {
        assert_eq!(
            quarter_turn() * Point::<Setup>::new(10.0, 0.0, 5.0),
            Point::<Machine>::new(100.0, 60.0, 5.0)
        );
    }

    #[test]
    fn there_and_back_is_the_same_place() {
        let p = Point::<Setup>::new(1.0, 2.0, 3.0);
        let m = quarter_turn();
        assert!((m.inverse() * (m * p)).distance(p) < 1e-12);
        let id: Transform<Setup, Setup> = m.inverse() * m;
        assert!((id * p).distance(p) < 1e-12);
    }

    #[test]
    fn a_reference_direction_along_the_axis_does_not_break_the_placement() {
        let t = Transform::<Machine, Setup>::from_axes(Point::ORIGIN, Vector::X, Vector::X).expect("X has a direction");
        let z = t * Vector::<Setup>::Z;
        assert_eq!(z.xyz, [1.0, 0.0, 0.0]);
        assert!((t * Vector::<Setup>::X).dot(t * Vector::<Setup>::Y).abs() < 1e-12);
    }
}
