//! Planned set-points on disk, as `toolmark plan --out` writes them: 1 ms apart, f64, as CSV or Parquet.
//!
//! Not a record: a plan is what shall be, without tick, load or events, in full precision for checking limits by differences.

use crate::StoreError;
use crate::whole_file::WholeFile;
use arrow_array::builder::{Float64Builder, UInt32Builder};
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use units::StepId;

/// The columns, in order.
pub const COLUMNS: [&str; 7] = ["t_s", "x_mm", "y_mm", "z_mm", "step_id", "s_mm", "feed_mm_s"];

/// Rows handed to the encoder at once.
const BATCH: usize = 8192;

/// One planned set-point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Time since the start, s.
    pub t: f64,
    /// Where, mm, in the frame that was asked for.
    pub position: [f64; 3],
    /// The step it belongs to.
    pub step: StepId,
    /// Path length since the start, mm.
    pub path_length: f64,
    /// Speed along the path, mm/s.
    pub path_speed: f64,
}

/// A file in the making; it appears under its name when [`Writer::finish`] returns.
pub struct Writer {
    path: PathBuf,
    form: Form,
}

enum Form {
    Csv(WholeFile),
    Parquet(Box<ParquetForm>),
}

struct ParquetForm {
    writer: ArrowWriter<WholeFile>,
    numbers: [Float64Builder; 6],
    step: UInt32Builder,
}

impl Writer {
    /// Starts the form that the name's ending asks for: `.parquet`, else CSV.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path) -> Result<Writer, StoreError> {
        match path.extension() {
            Some(extension) if extension.eq_ignore_ascii_case("parquet") => Writer::parquet(path),
            _ => Writer::csv(path),
        }
    }

    /// Starts a CSV file. Numbers are the shortest decimals that read back as the same double.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn csv(path: &Path) -> Result<Writer, StoreError> {
        let mut file = WholeFile::create(path)?;
        writeln!(file, "{}", COLUMNS.join(",")).map_err(StoreError::io("write", path))?;
        Ok(Writer {
            path: path.to_owned(),
            form: Form::Csv(file),
        })
    }

    /// Starts a Parquet file: f64 columns, `step_id` as a 32-bit integer.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn parquet(path: &Path) -> Result<Writer, StoreError> {
        let file = WholeFile::create(path)?;
        let writer = properties()
            .and_then(|properties| ArrowWriter::try_new(file, arrow_schema(), Some(properties)))
            .map_err(unwritable(path))?;
        Ok(Writer {
            path: path.to_owned(),
            form: Form::Parquet(Box::new(ParquetForm {
                writer,
                numbers: std::array::from_fn(|_| Float64Builder::with_capacity(BATCH)),
                step: UInt32Builder::with_capacity(BATCH),
            })),
        })
    }

    /// Adds one set-point.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write(&mut self, point: &Point) -> Result<(), StoreError> {
        let [x, y, z] = point.position;
        match &mut self.form {
            Form::Csv(file) => {
                let (t, step, s, feed) = (point.t, point.step.0, point.path_length, point.path_speed);
                writeln!(file, "{t},{x},{y},{z},{step},{s},{feed}").map_err(StoreError::io("write", &self.path))
            }
            Form::Parquet(form) => {
                for (column, number) in form
                    .numbers
                    .iter_mut()
                    .zip([point.t, x, y, z, point.path_length, point.path_speed])
                {
                    column.append_value(number);
                }
                form.step.append_value(point.step.0);
                if form.numbers[0].values_slice().len() >= BATCH {
                    form.flush().map_err(unwritable(&self.path))?;
                }
                Ok(())
            }
        }
    }

    /// Makes the file last under its name.
    ///
    /// # Errors
    /// The disk refuses; there is no file then.
    pub fn finish(self) -> Result<(), StoreError> {
        let file = match self.form {
            Form::Csv(file) => file,
            Form::Parquet(mut form) => {
                form.flush().map_err(unwritable(&self.path))?;
                form.writer.into_inner().map_err(unwritable(&self.path))?
            }
        };
        file.finish().map(|_| ())
    }
}

impl ParquetForm {
    fn flush(&mut self) -> Result<(), ParquetError> {
        let step: ArrayRef = Arc::new(self.step.finish());
        let mut columns: Vec<ArrayRef> = self.numbers.iter_mut().map(|c| Arc::new(c.finish()) as ArrayRef).collect();
        columns.insert(4, step);
        self.writer.write(&RecordBatch::try_new(arrow_schema(), columns)?)
    }
}

fn arrow_schema() -> Arc<Schema> {
    let kind = |name| {
        if name == "step_id" {
            DataType::UInt32
        } else {
            DataType::Float64
        }
    };
    Arc::new(Schema::new(COLUMNS.map(|name| Field::new(name, kind(name), false)).to_vec()))
}

fn properties() -> Result<WriterProperties, ParquetError> {
    Ok(WriterProperties::builder()
        .set_created_by(format!("toolmark {}", env!("CARGO_PKG_VERSION")))
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .set_dictionary_enabled(false)
        // Of the lossless forms for doubles the one that zstd likes best for smooth curves.
        .set_encoding(Encoding::BYTE_STREAM_SPLIT)
        .set_column_encoding(ColumnPath::from("step_id"), Encoding::DELTA_BINARY_PACKED)
        .set_statistics_enabled(EnabledStatistics::Page)
        .set_write_batch_size(BATCH)
        .build())
}

fn unwritable(path: &Path) -> impl Fn(ParquetError) -> StoreError + use<> {
    let path = path.to_owned();
    move |e| StoreError::Unwritable {
        path: path.clone(),
        what: e.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arrow_array::cast::AsArray;
    use arrow_array::types::{Float64Type, UInt32Type};
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    /// Numbers that a shorter decimal would change.
    fn points() -> Vec<Point> {
        (0..20_000)
            .map(|k| {
                let t = f64::from(k) * 0.001;
                Point {
                    t,
                    position: [t / 3.0, -t / 7.0, 0.1 + 0.2],
                    step: StepId(k / 100 + 1),
                    path_length: t * 1e-9,
                    path_speed: 1.0 / 3.0,
                }
            })
            .collect()
    }

    fn write(path: &Path) {
        let mut writer = Writer::create(path).expect("made");
        points().iter().for_each(|p| writer.write(p).expect("written"));
        assert!(!path.exists(), "half a file must not stand under the name");
        writer.finish().expect("finished");
    }

    #[test]
    fn csv_reads_back_with_all_its_bits() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("plan.csv");
        write(&path);
        let text = std::fs::read_to_string(&path).expect("reads");
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("t_s,x_mm,y_mm,z_mm,step_id,s_mm,feed_mm_s"));
        let read: Vec<Point> = lines
            .map(|line| {
                let n: Vec<f64> = line.split(',').map(|c| c.parse().expect("a number")).collect();
                Point {
                    t: n[0],
                    position: [n[1], n[2], n[3]],
                    step: StepId(n[4] as u32),
                    path_length: n[5],
                    path_speed: n[6],
                }
            })
            .collect();
        assert_eq!(read, points());
    }

    #[test]
    fn parquet_reads_back_with_all_its_bits() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("plan.parquet");
        write(&path);
        let file = std::fs::File::open(&path).expect("opens");
        let reader = ParquetRecordBatchReaderBuilder::try_new(file)
            .expect("Parquet")
            .build()
            .expect("reads");
        let mut read = Vec::new();
        for batch in reader.map(|b| b.expect("a batch")) {
            assert_eq!(
                batch.schema().fields().iter().map(|f| f.name().as_str()).collect::<Vec<_>>(),
                COLUMNS
            );
            let number = |k: usize, row: usize| batch.column(k).as_primitive::<Float64Type>().value(row);
            read.extend((0..batch.num_rows()).map(|row| Point {
                t: number(0, row),
                position: [number(1, row), number(2, row), number(3, row)],
                step: StepId(batch.column(4).as_primitive::<UInt32Type>().value(row)),
                path_length: number(5, row),
                path_speed: number(6, row),
            }));
        }
        assert_eq!(read, points());
    }

    #[test]
    fn a_plan_that_is_given_up_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut writer = Writer::create(&folder.path().join("plan.csv")).expect("made");
        writer.write(&Point::default()).expect("written");
        drop(writer);
        assert_eq!(std::fs::read_dir(folder.path()).expect("lists").count(), 0);
    }
}
