//! The controls that programs are posted to: one file each, and one line here.

mod fanuc;
mod haas;
mod heidenhain;
mod linuxcnc;
mod siemens_840d;

use crate::control::Control;

/// Every control, in the order of the manual.
pub const CONTROLS: &[&dyn Control] = &[
    &siemens_840d::Siemens840d,
    &fanuc::Fanuc,
    &heidenhain::Heidenhain,
    &haas::Haas,
    &linuxcnc::LinuxCnc,
];

/// The control of this name.
pub fn by_name(name: &str) -> Option<&'static dyn Control> {
    CONTROLS.iter().copied().find(|control| control.name() == name)
}
