//! `measurements.csv`: candidate, stage, measure, value, unit; one row for each number.

use std::io::Write;

use super::record::RunRecord;

/// Writes every measure of every stage of every candidate. Values have as many digits as it takes to read
/// back the same number.
///
/// # Errors
/// Those of `to`.
pub fn write(to: impl Write, run: &RunRecord) -> Result<(), csv::Error> {
    let mut table = csv::Writer::from_writer(to);
    table.write_record(["candidate", "stage", "measure", "value", "unit"])?;
    for candidate in &run.candidates {
        for stage in &candidate.stages {
            for (measure, value, unit) in stage.named_measures() {
                table.write_record([
                    &candidate.name,
                    &stage.name,
                    &measure,
                    &value.to_string(),
                    unit,
                ])?;
            }
        }
    }
    table.flush()?;
    Ok(())
}
