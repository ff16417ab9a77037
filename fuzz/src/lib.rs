//! Every reader of foreign bytes, as a function that must come back whatever the bytes are.
//!
//! A target panics when a promise is broken; what it reads is thrown away. A new reader is one file in `targets/` and one line in
//! [`TARGETS`]. The program of this crate feeds them ([`mutate`]); `libfuzzer/` does the same with cargo-fuzz.

pub mod mutate;
mod targets;

/// A reader under test: its name and its function.
pub type Target = (&'static str, fn(&[u8]));

/// The readers.
pub const TARGETS: &[Target] = &[
    ("apt", targets::apt::run),
    ("gcode", targets::gcode::run),
    ("link_frames", targets::link_frames::run),
    ("link_order", targets::link_order::run),
    ("link_text", targets::link_text::run),
    ("mtconnect_client", targets::mtconnect_client::run),
    ("mtconnect_document", targets::mtconnect_document::run),
    ("mtconnect_http", targets::mtconnect_http::run),
    ("mtconnect_shdr", targets::mtconnect_shdr::run),
    ("mtconnect_streams", targets::mtconnect_streams::run),
    ("mtconnect_text", targets::mtconnect_text::run),
    ("part21", targets::part21::run),
    ("stepnc", targets::stepnc::run),
];

/// Files of the corpus that a target begins with besides its own seeds, by their ending.
pub const CORPUS: &[(&str, &str)] = &[("gcode", "nc"), ("part21", "stpnc"), ("stepnc", "stpnc")];

/// Runs the target of that name.
///
/// # Panics
/// There is none, or a promise is broken.
pub fn run(name: &str, bytes: &[u8]) {
    let (_, run) = TARGETS.iter().find(|t| t.0 == name).expect("a target of that name");
    run(bytes);
}
