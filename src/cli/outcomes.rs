//! The table at the end of a run of many candidates: what was done, what was kept, what failed and why.

use crate::exec::CandidateOutcome;

/// More candidates are counted and not listed, but for those that failed.
const MOST_LISTED: usize = 40;

/// What became of the candidates of all plans.
#[derive(Debug, Default)]
pub(super) struct Outcomes {
    rows: Vec<[String; 4]>,
    done: usize,
    kept: usize,
    failed: usize,
}

impl Outcomes {
    /// Adds those of a plan.
    pub fn add(&mut self, plan: &str, candidates: &[CandidateOutcome]) {
        for candidate in candidates {
            let (result, why) = match candidate {
                CandidateOutcome {
                    error: Some(error), ..
                } => ("failed", error.clone()),
                CandidateOutcome { computed: 0, .. } => ("kept", "nothing changed".to_owned()),
                CandidateOutcome { kept: 0, .. } => ("done", String::new()),
                CandidateOutcome { computed, kept, .. } => {
                    ("done", format!("{kept} of {} stages kept", computed + kept))
                }
            };
            self.count(result);
            self.rows
                .push([plan, &candidate.name, result, &why].map(str::to_owned));
        }
    }

    /// Adds a plan of which nothing came.
    pub fn add_failed(&mut self, plan: &str, why: &str) {
        self.count("failed");
        self.rows.push([plan, "", "failed", why].map(str::to_owned));
    }

    fn count(&mut self, result: &str) {
        match result {
            "failed" => self.failed += 1,
            "kept" => self.kept += 1,
            _ => self.done += 1,
        }
    }

    /// Whether there is more to say than that one candidate was done.
    pub fn are_worth_a_table(&self) -> bool {
        self.rows.len() > 1 || self.kept > 0
    }

    /// The table, and the sums below it.
    pub fn table(&self) -> String {
        let listed = self
            .rows
            .iter()
            .filter(|[_, _, result, _]| self.rows.len() <= MOST_LISTED || result == "failed");
        let header = ["plan", "candidate", "result", "why"].map(str::to_owned);
        let rows: Vec<&[String; 4]> = std::iter::once(&header).chain(listed).collect();
        let width = |column: usize| {
            let widths = rows.iter().map(|row| row[column].chars().count());
            widths.max().unwrap_or_default()
        };
        let widths = [width(0), width(1), width(2)];
        let mut text = String::new();
        if rows.len() > 1 {
            for [plan, candidate, result, why] in rows {
                let line = format!(
                    "{plan:<0$}  {candidate:<1$}  {result:<2$}  {why}",
                    widths[0], widths[1], widths[2]
                );
                text.push_str(line.trim_end());
                text.push('\n');
            }
        }
        text.push_str(&format!(
            "{} done, {} kept, {} failed",
            self.done, self.kept, self.failed
        ));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(name: &str, computed: usize, kept: usize, error: Option<&str>) -> CandidateOutcome {
        CandidateOutcome {
            name: name.to_owned(),
            computed,
            kept,
            error: error.map(str::to_owned),
        }
    }

    #[test]
    fn columns_are_aligned_and_failures_say_why() {
        let mut outcomes = Outcomes::default();
        outcomes.add(
            "plan",
            &[
                outcome("a", 2, 0, None),
                outcome("longer", 1, 1, None),
                outcome("b", 0, 2, None),
                outcome("c", 0, 0, Some("there is no nose")),
            ],
        );
        outcomes.add_failed("other", "no CT");
        assert!(outcomes.are_worth_a_table());
        assert_eq!(
            outcomes.table(),
            "plan   candidate  result  why\n\
             plan   a          done\n\
             plan   longer     done    1 of 2 stages kept\n\
             plan   b          kept    nothing changed\n\
             plan   c          failed  there is no nose\n\
             other             failed  no CT\n\
             2 done, 1 kept, 2 failed"
        );
    }

    #[test]
    fn of_many_only_failures_are_listed() {
        let mut outcomes = Outcomes::default();
        let many: Vec<_> = (0..200)
            .map(|at| outcome(&format!("c{at}"), 1, 0, (at == 7).then_some("folded")))
            .collect();
        outcomes.add("plan", &many);
        let table = outcomes.table();
        assert_eq!(table.lines().count(), 3, "{table}");
        assert!(table.contains("c7") && table.ends_with("199 done, 0 kept, 1 failed"));
        let mut one = Outcomes::default();
        one.add("plan", &many[..1]);
        assert!(!one.are_worth_a_table());
    }
}
