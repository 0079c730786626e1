//! Markups JSON (3D Slicer's schema `markups-schema-v1.0.x`).

use serde::Deserialize;
use serde_json::Value;

use super::error::{LandmarkFileProblem, shown};
use super::{ControlPoint, CoordinateSystem, PointList, Position};

/// What of the schema is used.
#[derive(Debug, Deserialize)]
struct Document {
    markups: Vec<Markup>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Markup {
    coordinate_system: Option<String>,
    coordinate_units: Option<Value>,
    #[serde(default)]
    control_points: Vec<Point>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Point {
    #[serde(default)]
    label: String,
    /// Looked at only where it is defined: Slicer leaves anything or nothing in the place of others.
    position: Option<Value>,
    position_status: Option<String>,
}

pub(super) fn parse(text: &str) -> Result<PointList, LandmarkFileProblem> {
    let document: Document = serde_json::from_str(text).map_err(LandmarkFileProblem::Json)?;
    let mut system = None;
    let mut points = Vec::new();
    for markup in document.markups {
        if markup.control_points.is_empty() {
            continue;
        }
        check_units(markup.coordinate_units.as_ref())?;
        let this = system_of(markup.coordinate_system.as_deref())?;
        let first = *system.get_or_insert(this);
        if first != this {
            return Err(LandmarkFileProblem::Systems(first, this));
        }
        points.extend(markup.control_points.into_iter().map(Point::read));
    }
    Ok(PointList {
        system: system.unwrap_or(CoordinateSystem::Lps),
        points,
    })
}

fn system_of(written: Option<&str>) -> Result<CoordinateSystem, LandmarkFileProblem> {
    // The schema's default.
    let Some(written) = written else {
        return Ok(CoordinateSystem::Lps);
    };
    CoordinateSystem::from_name(written).ok_or_else(|| LandmarkFileProblem::System {
        found: format!("gives `coordinateSystem` as `{}`", shown(written)),
    })
}

/// mm, as a word or as a code of a terminology, `["mm", "UCUM", "millimeter"]`.
fn check_units(units: Option<&Value>) -> Result<(), LandmarkFileProblem> {
    let Some(units) = units else {
        return Ok(());
    };
    let word = match units {
        Value::Array(code) => code.first().and_then(Value::as_str),
        other => other.as_str(),
    };
    if word == Some("mm") {
        return Ok(());
    }
    let found = word.map_or_else(|| units.to_string(), str::to_owned);
    Err(LandmarkFileProblem::Units {
        found: format!("`{}`", shown(&found)),
    })
}

impl Point {
    fn read(self) -> ControlPoint {
        let position = match self.position_status {
            Some(status) if status != "defined" => Position::NotPlaced(status),
            _ => position(self.position.as_ref()),
        };
        ControlPoint {
            label: self.label,
            position,
        }
    }
}

fn position(written: Option<&Value>) -> Position {
    let Some(written) = written else {
        return Position::NotPlaced("not given".to_owned());
    };
    let numbers: Option<Vec<f64>> = written
        .as_array()
        .and_then(|items| items.iter().map(Value::as_f64).collect());
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|n| n.is_finite()) => Position::At([x, y, z]),
        _ => Position::Bad(written.to_string()),
    }
}
