//! How much faster than real time the simulated world runs on one thread, with the record attached: every channel quantised into a column.
//!
//! `cargo run --release -p cell --example world_speed`
#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a measurement of speed needs a clock"
)]

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/common/program.rs"]
mod program;

use cell::{CommandSource, RecordSink, World, WorldConfig};
use ledger::Event;
use machine::{CHANNELS, Sample};
use motion::{Limits, Trajectory};
use std::time::Instant;
use units::{Millimetres, Point};

/// Columns as a record keeps them, without the file.
#[derive(Default)]
struct Columns {
    ticks: Vec<u64>,
    steps: Vec<u32>,
    channels: Vec<Vec<i32>>,
    events: usize,
}

impl RecordSink for Columns {
    fn sample(&mut self, sample: &Sample) {
        self.ticks.push(sample.tick.0);
        self.steps.push(sample.step.0);
        for (column, channel) in self.channels.iter_mut().zip(CHANNELS) {
            column.push(channel.quantise(sample));
        }
    }
    fn event(&mut self, _event: &Event) {
        self.events += 1;
    }
}

fn main() {
    for _ in 0..3 {
        let mut w = common::Writer::default();
        w.tool(1, 10.0);
        w.spindle(6000.0);
        for k in 0..40 {
            w.rectangle("pass", [10.0, 10.0], [40.0, 25.0], -0.1 * f64::from(k));
        }
        measure("planned before", w.finish());
    }
    for _ in 0..3 {
        let machine = WorldConfig::default().machine;
        let limits = Limits {
            v_max: machine.axes.map(|a| a.v_max),
            a_max: machine.axes.map(|a| a.a_max),
            j_max: None,
            tolerance: Millimetres(0.01),
        };
        let source = Trajectory::new(Box::new(program::program(25)), Point::ORIGIN, limits);
        measure("planned on the way", source);
    }
}

fn measure(what: &str, source: impl CommandSource) {
    let mut columns = Columns {
        channels: vec![Vec::new(); CHANNELS.len()],
        ..Columns::default()
    };
    let mut world = match World::new(WorldConfig::default(), source) {
        Ok(world) => world,
        Err(error) => return println!("no machine: {error}"),
    };
    let begun = Instant::now();
    let outcome = world.run(&mut columns);
    let taken = begun.elapsed().as_secs_f64();
    println!(
        "{what}: {:.1} s of machining in {taken:.3} s: {:.0} x real time, {:.2} us a cycle; {} rows of {} channels, {} events, {}",
        outcome.time.0,
        outcome.time.0 / taken,
        1e6 * taken / outcome.samples as f64,
        columns.ticks.len(),
        columns.channels.len(),
        columns.events,
        outcome.ended.text(),
    );
}
