//! Parts of one plan, which several machines ran, as the one run that they are of.

use std::collections::{BTreeMap, HashMap};

use super::error::CompareError;
use super::finished::FinishedRun;
use crate::report::comparison::{ComparedParts, listed};
use crate::report::record::PartRecord;

/// Runs, where those that are parts of one plan are one, in the order in which each was first given; and what is to
/// be known of that.
pub(super) struct Joined {
    pub runs: Vec<FinishedRun>,
    pub warnings: Vec<String>,
}

/// Joins runs that are parts of the same plan file, on the same CT and with the same landmarks.
///
/// # Errors
/// [`CompareError::Parts`] where a part is given twice, or they are not parts of one whole.
pub(super) fn join(given: Vec<FinishedRun>) -> Result<Joined, CompareError> {
    let mut groups: Vec<Vec<FinishedRun>> = Vec::new();
    let mut places: HashMap<[String; 4], usize> = HashMap::new();
    for run in given {
        if run.part.is_none() {
            groups.push(vec![run]);
            continue;
        }
        let place = *places.entry(run.whole()).or_insert(groups.len());
        match groups.get_mut(place) {
            Some(group) => group.push(run),
            None => groups.push(vec![run]),
        }
    }
    let mut joined = Joined {
        runs: Vec::with_capacity(groups.len()),
        warnings: Vec::new(),
    };
    for group in groups {
        if let Some(run) = one(group, &mut joined.warnings)? {
            joined.runs.push(run);
        }
    }
    Ok(joined)
}

/// One run of all that are of the same plan.
fn one(
    mut group: Vec<FinishedRun>,
    warnings: &mut Vec<String>,
) -> Result<Option<FinishedRun>, CompareError> {
    group.sort_by_key(|run| run.part.as_ref().map(|part| part.number));
    let parts: Vec<PartRecord> = group.iter().filter_map(|run| run.part.clone()).collect();
    let Some(first) = parts.first().cloned() else {
        return Ok(group.into_iter().next());
    };
    let plan = group
        .first()
        .map_or(String::new(), |run| run.plan.name.clone());
    let problem = |problem: String| CompareError::Parts {
        plan: plan.clone(),
        problem,
    };
    if let Some(other) = parts.iter().find(|part| part.of != first.of) {
        return Err(problem(format!(
            "one is a part of {}, another of {}; give parts of one and the same number",
            first.of, other.of
        )));
    }
    let neighbours = parts.iter().zip(parts.iter().skip(1));
    if let Some((twice, _)) = neighbours.into_iter().find(|(a, b)| a.number == b.number) {
        return Err(problem(format!(
            "part {} of {} is given twice",
            twice.number, twice.of
        )));
    }
    let places = places(&parts).map_err(problem)?;
    let missing = missing(&first, &places);
    if !missing.is_empty() {
        let numbers: Vec<u32> = missing.keys().copied().collect();
        let count: usize = missing.values().sum();
        let (noun, verb) = match numbers.len() {
            1 => ("part", "is"),
            _ => ("parts", "are"),
        };
        warnings.push(format!(
            "{noun} {} of {} of `{plan}` {verb} missing: {count} of its {} candidates are not here",
            listed(&numbers),
            first.of,
            first.candidates
        ));
    }
    let mut versions: Vec<String> = group
        .iter()
        .map(|run| run.program.version.clone())
        .collect();
    versions.sort();
    versions.dedup();
    if versions.len() > 1 {
        warnings.push(format!(
            "the parts of `{plan}` were made by different versions of the program: {}",
            versions.join(", ")
        ));
    }
    let place = |name: &str| places.get(name).copied();
    let mut group = group.into_iter();
    let Some(mut whole) = group.next() else {
        return Ok(None);
    };
    for part in group {
        whole.candidates.extend(part.candidates);
        whole.failed.extend(part.failed);
        whole.surface_differences.extend(part.surface_differences);
        whole.folders.extend(part.folders);
    }
    whole.candidates.sort_by_key(|of| place(&of.name));
    whole.failed.sort_by_key(|of| place(&of.candidate));
    let pair = |[one, other]: &[String; 2]| (place(one), place(other));
    whole
        .surface_differences
        .sort_by_key(|of| pair(&of.candidates));
    // All parts together are a run in one go.
    whole.parts = (!missing.is_empty()).then(|| ComparedParts {
        given: parts.iter().map(|part| part.number).collect(),
        of: first.of,
    });
    Ok(Some(whole))
}

/// Where every candidate is in the plan. Candidates are dealt out one by one, so that a place tells the part.
fn places(parts: &[PartRecord]) -> Result<BTreeMap<&str, usize>, String> {
    let mut places = BTreeMap::new();
    let mut offset = None;
    for part in parts {
        if parts.first().map(|first| first.candidates) != Some(part.candidates) {
            return Err("they do not agree on how many candidates the plan has".to_owned());
        }
        for (name, &place) in &part.places {
            let of_place = dealt(part, place);
            if *offset.get_or_insert(of_place) != of_place {
                return Err(
                    "candidates were dealt out in different ways; run all parts with the same plans in the same order"
                        .to_owned(),
                );
            }
            if places.insert(name.as_str(), place).is_some() {
                return Err(format!("candidate `{name}` is in two parts"));
            }
        }
    }
    Ok(places)
}

/// What has to be added to a place so that the sum, divided by the number of parts, leaves the part that it is in.
fn dealt(part: &PartRecord, place: usize) -> usize {
    let of = part.of.max(1) as usize;
    (part.number as usize + of - place % of) % of
}

/// How many candidates are missing of which parts.
fn missing(part: &PartRecord, places: &BTreeMap<&str, usize>) -> BTreeMap<u32, usize> {
    let of = part.of.max(1) as usize;
    let mut is_there = vec![false; part.candidates];
    for &place in places.values() {
        if let Some(found) = is_there.get_mut(place) {
            *found = true;
        }
    }
    let offset = part.places.values().next().map(|&place| dealt(part, place));
    let mut missing = BTreeMap::new();
    let absent = is_there.iter().enumerate().filter(|(_, there)| !**there);
    for (place, _) in absent {
        // Parts count from 1, so that the last leaves nothing.
        let number = match (place + offset.unwrap_or_default()) % of {
            0 => of,
            number => number,
        };
        *missing.entry(number as u32).or_default() += 1;
    }
    missing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exec::batch::Part;

    /// The parts of a plan of so many candidates, as `Part` deals them out.
    fn dealt_out(of: u32, before: usize, candidates: usize) -> Vec<PartRecord> {
        let part = |number: u32| {
            let part = Part { number, of, before };
            PartRecord {
                number,
                of,
                candidates,
                places: (0..candidates)
                    .filter(|&place| part.has(place))
                    .map(|place| (format!("c{place}"), place))
                    .collect(),
            }
        };
        (1..=of).map(part).collect()
    }

    #[test]
    fn what_is_missing_is_told_by_its_part() {
        for (of, before, candidates) in [(3, 0, 7), (3, 5, 7), (1, 2, 4), (5, 3, 12)] {
            let all = dealt_out(of, before, candidates);
            let places = places(&all).unwrap();
            assert_eq!(places.len(), candidates);
            for (name, place) in places {
                assert_eq!(name, format!("c{place}"));
            }
            for left_out in &all {
                let mut some = all.clone();
                some.retain(|part| part.number != left_out.number);
                let Some(first) = some.first() else { continue };
                let found = missing(first, &super::places(&some).unwrap());
                assert_eq!(
                    found,
                    BTreeMap::from([(left_out.number, left_out.places.len())])
                );
            }
        }
        // More parts than candidates: one without any is not missed.
        let all = dealt_out(5, 0, 3);
        let three = &all[..3];
        assert!(missing(&three[0], &places(three).unwrap()).is_empty());
    }

    #[test]
    fn parts_that_do_not_belong_together_are_refused() {
        let (one, other) = (dealt_out(3, 0, 7), dealt_out(3, 1, 7));
        let mixed = [one[0].clone(), other[1].clone()];
        assert!(places(&mixed).unwrap_err().contains("different ways"));
        let longer = dealt_out(3, 0, 8);
        let mixed = [one[0].clone(), longer[1].clone()];
        assert!(places(&mixed).unwrap_err().contains("how many"));
        let mut twice = [one[0].clone(), one[1].clone()];
        twice[1].places.insert("c0".to_owned(), 4);
        assert!(places(&twice).unwrap_err().contains("`c0` is in two parts"));
    }
}
