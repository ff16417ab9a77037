//! A job that is cut while its operations are still coming: a CAM add-in gives them one at a time, and no file passes between.
//!
//! [`protocol`] is what the add-in says, [`program`] makes a STEP-NC plan of it that grows, [`planner`] plans what is new on a thread of its
//! own, [`server`] is the socket.

pub mod job;
pub mod planner;
pub mod program;
pub mod protocol;
pub mod server;

#[cfg(test)]
mod tests;
