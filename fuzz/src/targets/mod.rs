//! One file for each reader.

pub mod apt;
pub mod gcode;
pub mod link_frames;
pub mod link_order;
pub mod link_text;
pub mod mtconnect_client;
pub mod mtconnect_document;
pub mod mtconnect_http;
pub mod mtconnect_shdr;
pub mod mtconnect_streams;
pub mod mtconnect_text;
pub mod part21;
pub mod stepnc;
