//! Rows as Apache Parquet, for dataframes and databases.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, Float64Array, RecordBatch, StringArray, UInt64Array};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;

use super::FormatError;
use crate::report::columns::{COLUMNS, Cell, Column, Kind};
use crate::report::{SweepReport, SweepRow};

impl SweepReport {
    /// Apache Parquet: a column per field as [`SweepReport::to_csv`] has them, all nullable, each with its `unit` as metadata of the field;
    /// text is UTF-8, counts and bytes unsigned 64-bit integers, other figures doubles. `iterations` is null where they went on until the
    /// solver converged (and where `linear`). A figure that is not finite is null. The file's own metadata has the report's `schema`,
    /// `version` and `machine` (JSON). Not compressed, but equal values of a column are stored once.
    ///
    /// # Errors
    /// [`FormatError::Parquet`], which would be a fault of Pliant.
    pub fn to_parquet(&self) -> Result<Vec<u8>, FormatError> {
        let machine = serde_json::to_string(&self.machine).expect("every key is a string and no value can fail");
        let about = [("schema", &self.schema), ("version", &self.version), ("machine", &machine)];
        let about = about.map(|(key, value)| (key.to_owned(), value.clone()));
        // Twice, as readers built on Arrow take it from Arrow's schema and all others from the file's footer.
        let footer = about.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone())).collect();
        let fields: Vec<Field> = COLUMNS.iter().map(field).collect();
        let schema = Arc::new(Schema::new_with_metadata(fields, HashMap::from(about)));
        let arrays = COLUMNS.iter().map(|column| array(column, &self.rows)).collect();
        let batch = RecordBatch::try_new(Arc::clone(&schema), arrays).map_err(parquet::errors::ParquetError::from)?;
        let properties = WriterProperties::builder()
            .set_created_by(format!("pliant {}", env!("CARGO_PKG_VERSION")))
            .set_key_value_metadata(Some(footer))
            .build();
        let mut bytes = Vec::new();
        let mut writer = ArrowWriter::try_new(&mut bytes, schema, Some(properties))?;
        writer.write(&batch)?;
        writer.close()?;
        Ok(bytes)
    }
}

fn field(column: &Column) -> Field {
    let kind = match column.kind {
        Kind::Text => DataType::Utf8,
        Kind::Flag => DataType::Boolean,
        Kind::Count | Kind::Bytes => DataType::UInt64,
        Kind::Share | Kind::Length | Kind::Number | Kind::Time => DataType::Float64,
    };
    let unit = column.kind.unit().map(|unit| ("unit".to_owned(), unit.to_owned()));
    Field::new(column.key, kind, true).with_metadata(unit.into_iter().collect::<HashMap<_, _>>())
}

fn array(column: &Column, rows: &[SweepRow]) -> ArrayRef {
    let cells = rows.iter().map(column.cell);
    match column.kind {
        Kind::Text => Arc::new(StringArray::from_iter(cells.map(|cell| match cell {
            Cell::Text(text) => Some(text),
            _ => None,
        }))),
        Kind::Flag => Arc::new(BooleanArray::from_iter(cells.map(|cell| match cell {
            Cell::Flag(flag) => Some(flag),
            _ => None,
        }))),
        Kind::Count | Kind::Bytes => Arc::new(UInt64Array::from_iter(cells.map(|cell| match cell {
            Cell::Count(count) => Some(count as u64),
            Cell::Bytes(bytes) => Some(bytes),
            _ => None,
        }))),
        Kind::Share | Kind::Length | Kind::Number | Kind::Time => {
            Arc::new(Float64Array::from_iter(cells.map(|cell| match cell {
                Cell::Share(x) | Cell::Number(x) | Cell::Time(x) => Some(x).filter(|x| x.is_finite()),
                _ => None,
            })))
        }
    }
}
