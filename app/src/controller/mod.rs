//! The machine side as a process of its own: [`realtime`] moves it through its [`drives`], [`serving`] and [`text_serving`] speak with who drives it, [`gamepad`] is
//! what a person holds.

pub mod drives;
pub mod gamepad;
pub mod realtime;
pub mod recording;
pub mod serving;
pub mod text_serving;
