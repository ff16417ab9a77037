//! `start_sensor_recording`.

use super::TraceId;
use super::{Block, Call, Definition, LOG, REQUIRED, key, required};
use crate::sensor::Statistic;
use crate::value::{Kind, Sampling};

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "start_sensor_recording",
    also: &[],
    block: Block::Sensors,
    groups: &[
        &[
            required("its_function_id", Kind::Text, "names it, for its stop"),
            required("its_sensors", Kind::List, "streams or aliases"),
            key("its_axes", Kind::List, "axes, where the names have none"),
            key(
                "its_sampling",
                Kind::Sampling,
                "when samples are taken; by default every cycle",
            ),
            key(
                "its_statistic",
                Kind::Word(&["last", "min", "max", "avg", "rms"]),
                "what is kept of the cycles between two samples; by default last",
            ),
            key("its_filter", Kind::Text, "a filter of the sensor; kept with the record"),
            key("max_samples", Kind::Integer(1, 2_147_483_647), "it ends after so many"),
        ],
        LOG,
        REQUIRED,
    ],
    doc: "Records sensors from here to its stop, or to the end of its workplan.",
    record: "samples with unit, quality and context; why it ended",
    example: "trace:1 start_sensor_recording its_function_id=1 its_sensors=LOAD its_axes=X,Y,Z its_sampling=4",
    is_action: false,
    measure: None,
    call: |given| {
        Call::StartSensorRecording(Recording {
            id: given.id("its_function_id"),
            sensors: given.list("its_sensors"),
            axes: given.list("its_axes"),
            sampling: given.sampling("its_sampling"),
            statistic: Statistic::ALL
                .into_iter()
                .find(|s| given.word("its_statistic") == Some(s.word()))
                .unwrap_or_default(),
            filter: given.text("its_filter"),
            max_samples: given.integer("max_samples").and_then(|n| u32::try_from(n).ok()),
        })
    },
};

/// A recording of sensors.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Its name.
    pub id: TraceId,
    /// Streams or aliases.
    pub sensors: Vec<String>,
    /// Axes for names without component.
    pub axes: Vec<String>,
    /// When samples are taken.
    pub sampling: Sampling,
    /// What is kept between two samples.
    pub statistic: Statistic,
    /// A filter of the sensor, by name.
    pub filter: Option<String>,
    /// It ends after so many.
    pub max_samples: Option<u32>,
}
