//! From a record of positions to what really happened.
//!
//! A [`Recording`] is matched with a [`PlannedProgram`], cut into its workingsteps and toolpaths, and becomes a
//! [`plan::executed::AsExecuted`]; a [`Report`] says how far the run was from the plan, whether that is good, and what a person should
//! know. Without a plan the record is cut by speed. Pure: no files, no clock; the same record and plan give the same result.
//!
//! Deviations are distances of the tool tip from the true planned curve, in the plan's own set-up frame, with tool and wear offsets
//! taken out. A set-up that was shifted on the machine therefore shows, and is named.
//!
//! Read on: [`rebuild()`] for the one entry, [`planned`] for the plan's side, [`recording`] for the record's, [`report`] for the JSON
//! contract. The matching is in `align` (which place of the plan each sample is) and `labels` (where toolpaths begin and end), the
//! split by speed in `speed`.

mod align;
mod coarse;
pub mod compare;
mod curve;
mod flat;
mod labels;
pub mod planned;
mod plot;
pub mod rebuild;
pub mod recording;
pub mod report;
mod shift;
mod speed;
mod vec3;

pub use compare::compare;
pub use planned::{PlanEnd, PlanOptions, PlannedProgram, PlannedSegment, PlannedToolpath, PlannedWorkingstep};
pub use rebuild::{DEFAULT_TOLERANCE, Options, Rebuild, rebuild};
pub use recording::{InForce, RecordFrame, RecordGap, RecordPoint, Recording, Setting};
pub use report::{Plot, PlotLine, Report, Settings, Shift, ToleranceSource, ToolpathReport, Verdict, WorkingstepReport, Worst};
