//! Reports for people: one HTML file that needs nothing else, and the pictures in it.

pub mod plot;
