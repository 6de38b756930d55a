//! Cases explained, one row a case: the work of `gearwatch batch --cases`.
//!
//! A case is a folder with `bench.toml`, `recordings/` and, where there is one, `reference/`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray, UInt32Array};
use arrow_schema::{ArrowError, DataType, Field, Schema};
use gearwatch_core::recording::Recording;
use gearwatch_explain::explain::{Input, explain};
use gearwatch_explain::judge::report::Explanation;
use gearwatch_io::{OpenOptions, bench_file, read_recording, sidecar_path};
use sha2::{Digest, Sha256};

use crate::part::{Identity, PieceWriter, Table, hex, sha256_of};
use crate::run::{Trouble, Unreadable, Work};
use crate::worklist::{CASE_BENCH, WorkListError, from_folders};

/// How cases are explained.
pub struct Explaining<'a> {
    /// Endings of the names of recordings, without the dot.
    pub endings: &'a [&'a str],
}

const TEXTS: [&str; 6] = ["version", "status", "effect", "place", "advice", "explanation"];
const COUNTS: [&str; 2] = ["effects", "indistinguishable"];
const NUMBERS: [&str; 7] =
    ["probability", "p_null", "train_before", "train_after", "held_out_before", "held_out_after", "noise_floor"];

impl Work for Explaining<'_> {
    type Bench = ();

    fn table(&self) -> Table {
        let text = |name: &str| Field::new(name, DataType::Utf8, false);
        let mut fields = vec![text("case"), text("case_sha256")];
        fields.extend(TEXTS.map(text));
        fields.extend(COUNTS.map(|name| Field::new(name, DataType::UInt32, false)));
        fields.extend(NUMBERS.map(|name| Field::new(name, DataType::Float64, true)));
        Table { schema: Arc::new(Schema::new(fields)), keys: 2 }
    }

    fn bench(&self) {}

    /// The digest covers the bench file, and the name and content of each recording and its sidecar
    /// file.
    fn identify(&self, path: &Path) -> Result<Identity, Unreadable> {
        let mut digest = Sha256::new();
        let mut files = vec![path.join(CASE_BENCH)];
        for recording in self.recordings(path, RECORDINGS)?.into_iter().chain(self.recordings(path, REFERENCE)?) {
            let sidecar = sidecar_path(&recording);
            files.push(recording);
            files.extend(Some(sidecar).filter(|sidecar| sidecar.is_file()));
        }
        for file in files {
            let name = file.strip_prefix(path).unwrap_or(&file).to_string_lossy();
            let content = sha256_of(&file)?;
            digest.update(format!("{name}\0{content}\n"));
        }
        Ok(Identity(vec![path.to_string_lossy().into_owned(), hex(&digest.finalize())]))
    }

    fn work(&self, (): &mut (), path: &Path, of: &Identity, piece: &mut PieceWriter) -> Result<usize, Trouble> {
        let bench = bench_file::read(&path.join(CASE_BENCH)).map_err(|error| Trouble::Item(error.to_string()))?;
        let (recordings, reference) = (self.read(path, RECORDINGS)?, self.read(path, REFERENCE)?);
        let input = Input { bench: &bench, recordings: &recordings, reference: &reference, without: &[] };
        let answer = explain(&input, &mut |_| {}).map_err(|error| Trouble::Item(error.to_string()))?;
        let row = row(self.table(), of, &answer.explanation).map_err(|error| Trouble::Item(error.to_string()))?;
        piece.write(&row)?;
        Ok(1)
    }
}

const RECORDINGS: &str = "recordings";
const REFERENCE: &str = "reference";

impl Explaining<'_> {
    /// Recordings in a folder of a case; a case need not have a reference.
    fn recordings(&self, case: &Path, folder: &str) -> Result<Vec<PathBuf>, WorkListError> {
        let folder = case.join(folder);
        if folder.ends_with(REFERENCE) && !folder.exists() {
            return Ok(Vec::new());
        }
        from_folders(&[folder], self.endings)
    }

    fn read(&self, case: &Path, folder: &str) -> Result<Vec<Recording>, Trouble> {
        let files = self.recordings(case, folder).map_err(|error| Trouble::Item(error.to_string()))?;
        let read = |file: &PathBuf| read_recording(file, &OpenOptions::default());
        files.iter().map(read).collect::<Result<_, _>>().map_err(|error| Trouble::Item(error.to_string()))
    }
}

/// Why an answer makes no row.
#[derive(Debug, thiserror::Error)]
enum RowError {
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    #[error(transparent)]
    Columns(#[from] ArrowError),
}

/// The most probable effect has columns of its own; all of the answer is in `explanation`, as
/// `gearwatch explain` writes it.
fn row(table: Table, of: &Identity, answer: &Explanation) -> Result<RecordBatch, RowError> {
    let json = serde_json::to_string(answer)?;
    let first = answer.effects.first();
    let texts = [
        env!("CARGO_PKG_VERSION"),
        answer.status.code(),
        first.map_or("", |effect| &effect.effect),
        first.map_or("", |effect| &effect.place),
        &answer.advice.join("\n"),
        &json,
    ];
    let counts = [answer.effects.len(), first.map_or(0, |effect| effect.indistinguishable_from.len())];
    let fit = answer.fit.as_ref();
    let numbers = [
        first.map(|effect| effect.probability),
        answer.p_null,
        fit.map(|fit| fit.train_before),
        fit.map(|fit| fit.train_after),
        fit.map(|fit| fit.held_out_before),
        fit.map(|fit| fit.held_out_after),
        fit.map(|fit| fit.noise_floor),
    ];
    let mut columns: Vec<ArrayRef> = Vec::with_capacity(table.schema.fields().len());
    let text = |text: &str| Arc::new(StringArray::from_iter_values([text])) as ArrayRef;
    columns.extend(of.0.iter().map(|key| text(key)));
    columns.extend(texts.map(text));
    columns.extend(counts.map(|n| Arc::new(UInt32Array::from(vec![u32::try_from(n).unwrap_or(u32::MAX)])) as ArrayRef));
    let known = |value: Option<f64>| value.filter(|value| value.is_finite());
    columns.extend(numbers.map(|value| Arc::new(Float64Array::from(vec![known(value)])) as ArrayRef));
    Ok(RecordBatch::try_new(table.schema, columns)?)
}
