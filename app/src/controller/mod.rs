//! The machine side as a process of its own: [`realtime`] moves it, [`serving`] speaks with who drives it.

pub mod realtime;
pub mod serving;
