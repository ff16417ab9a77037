//! The columns and the metadata of a record file; the one place that writer and reader share.

use arrow_schema::{DataType, Field, Schema, TimeUnit};
use ledger::Hash;
use machine::CHANNELS;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::Result;
use parquet::file::metadata::{KeyValue, SortingColumn};
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use units::Timestamp;

/// What is known of a record before its first row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// The machine's name.
    pub machine: String,
    /// True when a simulator made the rows.
    pub simulated: bool,
    /// The moment of tick 0.
    pub start: Timestamp,
    /// The seed of a simulated run.
    pub seed: u64,
}

impl Header {
    /// What a record says about itself before its first row: the metadata of its segments.
    pub fn metadata(&self) -> BTreeMap<String, String> {
        metadata(self)
    }
}

/// Version of this layout, in the file's metadata.
pub(crate) const LAYOUT: &str = "1";
/// Rows of a row group.
const ROW_GROUP: usize = 262_144;
/// Rows of a page, and of a batch handed to the encoder.
pub(crate) const PAGE: usize = 8192;

/// Keys of the file's metadata.
pub(crate) mod key {
    pub const LAYOUT: &str = "toolmark.record";
    pub const VERSION: &str = "toolmark.version";
    pub const MACHINE: &str = "toolmark.machine";
    pub const SIMULATED: &str = "toolmark.simulated";
    pub const START: &str = "toolmark.start";
    pub const START_NS: &str = "toolmark.start_ns";
    pub const SEED: &str = "toolmark.seed";
    pub const FRAME: &str = "toolmark.frame";
    pub const LENGTH_UNIT: &str = "toolmark.length_unit";
    pub const ROWS: &str = "toolmark.rows";
    pub const UNAVAILABLE: &str = "toolmark.unavailable_values";
    pub const EVENTS: &str = "toolmark.events";
    /// Rows that are missing, when there are any: a JSON list of first, last, count, cause.
    pub const GAPS: &str = "toolmark.gaps";
    /// What of its segments could not be read, when there is any.
    pub const LOST: &str = "toolmark.lost";
    /// Length and SHA-256 of everything before the Parquet footer.
    pub const DATA: &str = "toolmark.data";
    /// SHA-256 of all other pairs of the metadata.
    pub const DIGEST: &str = "toolmark.metadata_sha256";
    /// Where the Parquet library keeps the Arrow schema.
    pub const ARROW_SCHEMA: &str = "ARROW:schema";
    /// Keys of a column's metadata.
    pub const UNIT: &str = "unit";
    pub const SCALE: &str = "scale";
    pub const OFFSET: &str = "offset";
}

/// Columns before the channels.
pub(crate) const TS: &str = "ts";
pub(crate) const TICK: &str = "tick";
pub(crate) const STEP: &str = "step";
pub(crate) const WORKINGSTEP: &str = "workingstep";
pub(crate) const TOOL: &str = "tool";
pub(crate) const PHASE: &str = "phase";
pub(crate) const QUALITY: &str = "quality";

/// The Arrow schema of a record.
pub(crate) fn arrow_schema() -> Arc<Schema> {
    let mut fields = vec![
        Field::new(TS, DataType::Timestamp(TimeUnit::Microsecond, Some("UTC".into())), false),
        Field::new(TICK, DataType::Int64, false),
        Field::new(STEP, DataType::Int32, false),
        Field::new(WORKINGSTEP, DataType::Int32, false),
        Field::new(TOOL, DataType::Int32, false),
        Field::new(PHASE, DataType::UInt8, false),
        Field::new(QUALITY, DataType::UInt8, false),
    ];
    // Nullable: a reading that is not a number, or beyond the column, is unavailable and not 0. Costs nothing while none is.
    fields.extend(CHANNELS.iter().map(|channel| {
        Field::new(channel.name, DataType::Int32, true).with_metadata(HashMap::from([
            (key::UNIT.to_owned(), channel.unit.to_owned()),
            (key::SCALE.to_owned(), channel.scale.to_string()),
            (key::OFFSET.to_owned(), "0".to_owned()),
        ]))
    }));
    Arc::new(Schema::new(fields))
}

/// How the file is written; measured, see the head of the module for what it buys.
pub(crate) fn properties(columns: &Schema, metadata: &BTreeMap<String, String>) -> Result<WriterProperties> {
    let mut builder = WriterProperties::builder()
        // Our version and not the library's: an update of the library alone must not change the bytes of a record.
        .set_created_by(format!("toolmark {}", env!("CARGO_PKG_VERSION")))
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .set_dictionary_enabled(false)
        .set_encoding(Encoding::DELTA_BINARY_PACKED)
        .set_statistics_enabled(EnabledStatistics::Page)
        .set_max_row_group_row_count(Some(ROW_GROUP))
        .set_data_page_row_count_limit(PAGE)
        .set_write_batch_size(PAGE)
        .set_key_value_metadata(Some(
            metadata
                .iter()
                .map(|(key, value)| KeyValue::new(key.clone(), value.clone()))
                .collect(),
        ));
    // Samples rise with time. Observations stand in the order of an agent's numbers, and its adapters' clocks are not one clock.
    if let (Ok(place), Ok(_)) = (columns.index_of(TS), columns.index_of(TICK)) {
        builder = builder.set_sorting_columns(Some(vec![SortingColumn {
            column_idx: i32::try_from(place).unwrap_or_default(),
            descending: false,
            nulls_first: false,
        }]));
    }
    for field in columns.fields() {
        let path = ColumnPath::from(field.name().as_str());
        builder = match field.data_type() {
            // Few different values in long runs.
            DataType::UInt8 | DataType::Dictionary(..) => builder.set_column_dictionary_enabled(path, true),
            DataType::Int32 if [WORKINGSTEP, TOOL].contains(&field.name().as_str()) => {
                builder.set_column_dictionary_enabled(path, true)
            }
            DataType::Utf8 => builder
                .set_column_dictionary_enabled(path.clone(), true)
                .set_column_encoding(path, Encoding::DELTA_BYTE_ARRAY),
            // Numbers without a scale: mostly decimal fractions that come again, which byte streams make longer (measured).
            DataType::Float64 => builder
                .set_column_dictionary_enabled(path.clone(), true)
                .set_column_encoding(path, Encoding::PLAIN),
            DataType::Boolean => builder.set_column_encoding(path, Encoding::PLAIN),
            _ => builder,
        };
        if matches!(field.data_type(), DataType::Dictionary(..)) {
            // Where the dictionary grows too large for one.
            let path = ColumnPath::from(field.name().as_str());
            builder = builder.set_column_encoding(path, Encoding::DELTA_BYTE_ARRAY);
        }
    }
    Ok(builder.build())
}

/// What the file says about itself before its first row.
pub(crate) fn metadata(header: &Header) -> BTreeMap<String, String> {
    let start = jiff::Timestamp::from_nanosecond(i128::from(header.start.0)).map_or_else(|_| String::new(), |t| t.to_string());
    [
        (key::LAYOUT, LAYOUT.to_owned()),
        (key::VERSION, env!("CARGO_PKG_VERSION").to_owned()),
        (key::MACHINE, header.machine.clone()),
        (key::SIMULATED, header.simulated.to_string()),
        (key::START, start),
        (key::START_NS, header.start.0.to_string()),
        (key::SEED, header.seed.to_string()),
        (key::FRAME, "machine".to_owned()),
        (key::LENGTH_UNIT, "mm".to_owned()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into()
}

/// The hash of all pairs but itself. A flipped bit in a Parquet footer is otherwise read as good, or makes the decoder panic.
pub(crate) fn digest(metadata: &BTreeMap<String, String>) -> Hash {
    let mut bytes = Vec::new();
    for (key, value) in metadata.iter().filter(|(key, _)| *key != key::DIGEST) {
        for text in [key, value] {
            bytes.extend((text.len() as u64).to_le_bytes());
            bytes.extend(text.as_bytes());
        }
    }
    Hash::of(&bytes)
}
