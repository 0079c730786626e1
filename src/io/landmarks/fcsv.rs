//! Tables of fiducials (`.fcsv`), which 3D Slicer wrote before it had markups JSON.

use csv::{ReaderBuilder, StringRecord};

use super::error::{LandmarkFileProblem, shown};
use super::{ControlPoint, CoordinateSystem, PointList, Position};

/// Slicer's columns, where a file does not name its own.
const COLUMNS: &str = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID";

/// Behind the columns that the header names, later versions write a point's status and whether it was
/// created automatically.
const STATUS_COLUMN: usize = 14;

/// What the numbers of the status column say; 2 is `defined`.
const NOT_DEFINED: [(&str, &str); 3] = [("0", "undefined"), ("1", "preview"), ("3", "missing")];

pub(super) fn parse(text: &str) -> Result<PointList, LandmarkFileProblem> {
    let mut system = None;
    let mut columns = Columns::named(COLUMNS);
    for line in text.lines().map(str::trim) {
        let Some(comment) = line.strip_prefix('#') else {
            continue;
        };
        let Some((key, value)) = comment.split_once('=') else {
            continue;
        };
        match key.trim() {
            "CoordinateSystem" => system = Some(value.trim()),
            "columns" => columns = Columns::named(value),
            _ => {}
        }
    }
    let system = system_of(system)?;
    let columns = columns.ok_or_else(|| LandmarkFileProblem::Table {
        line: 1,
        what: "`# columns` names no `x`, `y`, `z` and `label`".to_owned(),
    })?;
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let mut points = Vec::new();
    for row in reader.records() {
        let row = row.map_err(|error| LandmarkFileProblem::Table {
            line: error.position().map_or(0, csv::Position::line),
            what: "this is not a row of values between commas".to_owned(),
        })?;
        // A line of spaces.
        if row.iter().all(|value| value.trim().is_empty()) {
            continue;
        }
        points.push(columns.point(&row)?);
    }
    Ok(PointList { system, points })
}

fn system_of(written: Option<&str>) -> Result<CoordinateSystem, LandmarkFileProblem> {
    let Some(written) = written else {
        // Versions of Slicer differ over what that meant, so neither is taken.
        return Err(LandmarkFileProblem::System {
            found: "has no line `# CoordinateSystem = …`".to_owned(),
        });
    };
    match written {
        // Slicer's developer guide: "numeric codes were used: RAS = 0, LPS = 1".
        "0" => return Ok(CoordinateSystem::Ras),
        "1" => return Ok(CoordinateSystem::Lps),
        _ => {}
    }
    CoordinateSystem::from_name(written).ok_or_else(|| LandmarkFileProblem::System {
        found: format!("gives `CoordinateSystem` as `{}`", shown(written)),
    })
}

/// The places of what is used.
#[derive(Debug, Clone, Copy)]
struct Columns {
    position: [usize; 3],
    label: usize,
}

impl Columns {
    fn named(names: &str) -> Option<Self> {
        let names: Vec<&str> = names.split(',').map(str::trim).collect();
        let place = |wanted: &str| names.iter().position(|&name| name == wanted);
        Some(Self {
            position: [place("x")?, place("y")?, place("z")?],
            label: place("label")?,
        })
    }

    fn point(self, row: &StringRecord) -> Result<ControlPoint, LandmarkFileProblem> {
        let cells = self.position.map(|place| row.get(place).map(str::trim));
        let ([Some(x), Some(y), Some(z)], Some(label)) = (cells, row.get(self.label)) else {
            return Err(LandmarkFileProblem::Table {
                line: row.position().map_or(0, csv::Position::line),
                what: format!("{} values, too few for a point", row.len()),
            });
        };
        let status = row.get(STATUS_COLUMN).map(str::trim);
        let not_defined = NOT_DEFINED.iter().find(|(code, _)| Some(*code) == status);
        let position = match not_defined {
            Some((_, word)) => Position::NotPlaced((*word).to_owned()),
            None => position([x, y, z]),
        };
        Ok(ControlPoint {
            label: label.to_owned(),
            position,
        })
    }
}

fn position(written: [&str; 3]) -> Position {
    let numbers = written.map(|cell| cell.parse::<f64>().ok().filter(|n| n.is_finite()));
    match numbers {
        [Some(x), Some(y), Some(z)] => Position::At([x, y, z]),
        _ => Position::Bad(format!("({})", written.join(", "))),
    }
}
