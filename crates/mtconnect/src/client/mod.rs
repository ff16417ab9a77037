//! The client side of MTConnect, sans-io: what to ask an agent, what its answers say, and what to do when it does not answer.
//!
//! [`Client`](session::Client) is the machine: it says when to connect, what to send, how long to wait, and hands out observations in
//! the agent's order, each once, and a [`Gap`](gap::Gap) for whatever could not be had. It opens no socket and reads no clock.
//!
//! Read on: [`session`] for the machine, [`query`] for what can be asked, [`document`] for answers, [`live`] for places as they come, [`http`] and [`multipart`] for
//! what stands around them.

pub mod document;
pub mod gap;
pub mod http;
pub mod items;
pub mod live;
pub mod multipart;
pub mod query;
pub mod session;
