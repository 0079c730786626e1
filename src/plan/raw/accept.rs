//! `[accept]`: the limits that candidates must keep.

use super::super::decode::{Faults, Table, Value, one_of};
use super::super::diagnostic::{Code, Fault};
use super::super::format;
use crate::compare::{Accept, BareNumber, Limit, MEASURES, Measure, Quantity};

const INTERVAL: &str = "[least, most], two numbers, the first not above the second";

/// The limits; none where none are given.
pub(super) fn accept(plan: &Table<'_, '_>, faults: &mut Faults) -> Option<Accept> {
    let value = plan.get("accept")?;
    let table = faults.table(value, &format::ACCEPT)?;
    if value
        .get_ref()
        .as_table()
        .is_some_and(|table| table.is_empty())
    {
        let fault = Fault::new(Code::MissingKey, table.span, "[accept] gives no limit");
        let hint = "remove [accept], or give a limit".to_owned();
        let expected = "a measure and its limits, as in `gamma = [70, 110]`";
        faults.push(fault.expected(expected).hint(hint));
    }
    let mut limits = Vec::new();
    for measure in &MEASURES {
        if let Some(value) = table.get(measure.name) {
            limits.extend(limits_of(measure, value, faults).into_iter().flatten());
        }
    }
    Some(Accept { limits })
}

/// The limits of one measure, as far as they can be read.
fn limits_of(
    measure: &'static Measure,
    value: &Value<'_>,
    faults: &mut Faults,
) -> Option<Vec<Limit>> {
    let what = format!("`accept.{}`", measure.name);
    let limit = |of, min, max| Limit {
        measure,
        of,
        min,
        max,
    };
    let written = value.get_ref();
    if written.is_array() {
        let [min, max] = interval(value, &what, faults)?;
        return Some(vec![limit(Quantity::Value, Some(min), Some(max))]);
    }
    if written.is_table() {
        return table_of(measure, &what, value, faults);
    }
    let bare = match measure.bare {
        BareNumber::Least => "a number, the least that is allowed; ",
        BareNumber::Most => "a number, the most that is allowed; ",
        BareNumber::Nothing => "",
    };
    let expected = format!(
        "{bare}[least, most]; or a table of {}",
        one_of(&format::limit_of(measure).names(), '`')
    );
    let is_number = written.is_integer() || written.is_float();
    if is_number && measure.bare == BareNumber::Nothing {
        let hint = "say whether it is the least or the most: `{ min = … }` or `{ max = … }`";
        faults.wrong_type(value, &what, &expected, Some(hint.to_owned()));
        return None;
    }
    let number = faults.number(value, &what, &expected)?;
    Some(vec![match measure.bare {
        BareNumber::Least => limit(Quantity::Value, Some(number), None),
        BareNumber::Most | BareNumber::Nothing => limit(Quantity::Value, None, Some(number)),
    }])
}

fn table_of(
    measure: &'static Measure,
    what: &str,
    value: &Value<'_>,
    faults: &mut Faults,
) -> Option<Vec<Limit>> {
    let format = format::limit_of(measure);
    let table = faults.table(value, format)?;
    let keys = format.names();
    if value
        .get_ref()
        .as_table()
        .is_some_and(|table| table.is_empty())
    {
        let fault = Fault::new(
            Code::MissingKey,
            table.span,
            format!("{what} gives no limit"),
        );
        faults.push(fault.expected(format!("one or more of {}", one_of(&keys, '`'))));
        return None;
    }
    let mut end = |key: &str| match table.get(key) {
        None => Some(None),
        Some(value) => {
            let what = format!("{what}, `{key}`,");
            faults.number(value, &what, "a number").map(Some)
        }
    };
    let ends = (end("min"), end("max"));
    let mut limits = Vec::new();
    if let (Some(min), Some(max)) = ends
        && (min.is_some() || max.is_some())
    {
        if let (Some(low), Some(high)) = (min, max)
            && low > high
        {
            let message = format!("{what} allows nothing");
            let fault = Fault::new(Code::BadValue, table.place("min"), message);
            let found = format!("min = {low}, max = {high}");
            faults.push(fault.found(found).expected("`min` not above `max`"));
        }
        limits.push(Limit {
            measure,
            of: Quantity::Value,
            min,
            max,
        });
    }
    for (key, of) in [
        ("change", Quantity::Change),
        ("change_percent", Quantity::ChangePercent),
    ] {
        let Some(value) = table.get(key) else {
            continue;
        };
        let what = format!("{what}, `{key}`,");
        if let Some([min, max]) = interval(value, &what, faults) {
            limits.push(Limit {
                measure,
                of,
                min: Some(min),
                max: Some(max),
            });
        }
    }
    Some(limits)
}

/// Two numbers in order.
fn interval(value: &Value<'_>, what: &str, faults: &mut Faults) -> Option<[f64; 2]> {
    let Some(array) = value.get_ref().as_array() else {
        faults.wrong_type(value, what, INTERVAL, None);
        return None;
    };
    let [low, high] = &**array else {
        let problem = format!("has {} values instead of two", array.len());
        faults.bad_value(value, what, &problem, INTERVAL);
        return None;
    };
    let ends = [low, high].map(|item| faults.number(item, what, "a finite number"));
    let [Some(low), Some(high)] = ends else {
        return None;
    };
    if low > high {
        faults.bad_value(
            value,
            what,
            "allows nothing: it ends below its beginning",
            INTERVAL,
        );
        return None;
    }
    Some([low, high])
}
