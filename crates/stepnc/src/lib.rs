//! STEP-NC (ISO 10303-238, "AP238"): a machining program that says what is machined and not only how axes move.
//!
//! [`Program::read`] opens the stored form (AIM) of editions 1 to 3, and files of ISO 14649 (ARM), and answers in the words of the shop:
//! projects, workplans, workingsteps, operations, features, toolpaths, tools, set-ups. [`StepNcStream`] runs it as a
//! [`plan::ProgramStream`]. [`inspect`](inspect::inspect) gives the tree that `toolmark inspect` prints. [`twin`] writes what really
//! happened back into the file and reads it again.
//!
//! ```
//! use plan::{Next, ProgramStream, StepKind};
//! use stepnc::{Program, StepNcStream, StreamOptions};
//!
//! let text = "ISO-10303-21;HEADER;FILE_SCHEMA(('MACHINING_SCHEMA'));ENDSEC;DATA;\
//!     #1=PROJECT('PLATE',#2,(),$,$,$); #2=WORKPLAN('main',(#3),$,$,$);\
//!     #3=MACHINING_WORKINGSTEP('slot',$,$,#4,$); #4=FREEFORM_OPERATION(#5,$,'cut',$,$,#7,#8,$,$,$,$,$);\
//!     #5=TOOLPATH_LIST((#6)); #6=CUTTER_LOCATION_TRAJECTORY(.T.,.CONTACT.,$,$,$,$,#9,$,$);\
//!     #7=MILLING_CUTTING_TOOL('T1',$,(),$,$,$); #8=MILLING_TECHNOLOGY(0.01,.TCP.,$,-50.,$,.F.,.F.,.F.,$);\
//!     #9=POLYLINE('',(#10,#11)); #10=CARTESIAN_POINT('',(0.,0.,0.)); #11=CARTESIAN_POINT('',(30.,40.,0.));\
//!     ENDSEC;END-ISO-10303-21;";
//! let program = Program::read("plate.stp", text.as_bytes().to_vec())?;
//! let tree = stepnc::inspect::inspect(&program);
//! assert_eq!(tree.summary.workingsteps_enabled, 1);
//! assert_eq!(tree.tree[0].children[0].toolpaths[0].length_mm, Some(50.0));
//!
//! let mut stream = StepNcStream::new(program.into(), StreamOptions::default());
//! let mut feeds = Vec::new();
//! while let Next::Step(step) = stream.next(None) {
//!     if let StepKind::Move(go) = &step.kind
//!         && let plan::Speed::Feed(plan::Feed::PerTime(feed)) = go.speed
//!     {
//!         feeds.push((go.path.end().xyz, feed.0));
//!     }
//! }
//! assert_eq!(feeds, [([30.0, 40.0, 0.0], 10.0)]); // mm in the set-up, mm/s
//! # Ok::<(), stepnc::ReadError>(())
//! ```
//!
//! **Units** are taken out where a number is read: mm, s, mm/s, revolutions per minute, radians; the types say which. **Frames**: see
//! [`stream`]. **Errors**: readers are tolerant, so what is odd becomes one [`plan::Diagnostic`] a kind with file, line and column, what
//! cannot be run becomes an alarm when the stream comes to it, and nothing that the file does not say is made up.
//!
//! Read on: [`model`] for what a program consists of, [`levels`] for who may change which part, [`stream`] for running it, [`twin`] for as-executed models.

mod aim;
mod arm;
pub mod curve;
mod date;
pub mod dimensions;
pub mod edit;
mod expression;
mod function_form;
pub mod inspect;
pub mod levels;
pub mod model;
mod named;
mod points;
pub mod problems;
pub mod select;
pub mod stream;
pub mod twin;
mod unit;
pub mod write;

pub use function_form::FunctionForm;
pub use model::{
    Dwell, Executable, ExecutableKind, Feature, FeedSetting, Fixture, Function, MachineFunctions, Operation, Program, Project,
    Setup, SpindleSetting, Technology, Tool, Toolpath, ToolpathKind, TwinFacts,
};
pub use part21::ReadError;
pub use plan::inspection::{NamedValue, Quantity};
pub use stream::{PathFrame, StepNcStream, StreamOptions, StructuredStream};
pub use twin::write_new;
