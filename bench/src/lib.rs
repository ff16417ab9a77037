//! Benches that hold us against other people's crates: `cargo bench -p bench`. There is nothing else in here.
//!
//! A package of its own, outside of the default members, so that a newcomer's build and the crates' tests need none of the peers.
