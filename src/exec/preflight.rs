//! Everything that can be checked without computing: all plans, their CTs' headers, all faults at once.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::batch::Part;
use super::ct::{self, CtHeader};
use super::error::ExitCode;
use crate::plan::{Diagnostic, Diagnostics, Plan, PlanFile};

/// A plan that can run.
#[derive(Debug, Clone)]
pub struct Ready {
    /// The file, as the user named it.
    pub file: String,
    /// SHA-256 of the plan file's bytes, hexadecimal.
    pub sha256: String,
    /// SHA-256 of the file of landmarks that the plan names, hexadecimal.
    pub landmarks_sha256: Option<String>,
    /// The plan as written, to be resolved again where its landmarks move.
    pub source: PlanFile,
    /// The plan, resolved on its CT's grid.
    pub plan: Plan,
    /// The CT's header.
    pub ct: CtHeader,
}

/// Every reason why some plans cannot run.
#[derive(Debug, Default)]
pub struct Refusal {
    /// Plan files that cannot be read at all.
    pub unreadable: Vec<String>,
    /// Faults of plans.
    pub faults: Diagnostics,
    /// CTs that cannot be used, at the place of the plan that names them.
    pub cts: Diagnostics,
    /// Folders that two plans would write into.
    pub folders: Vec<String>,
}

impl Refusal {
    fn is_empty(&self) -> bool {
        self.unplaced().next().is_none() && self.faults.is_empty() && self.cts.is_empty()
    }

    /// What the process ends with: a fault of a plan outweighs one of its CT.
    pub fn exit_code(&self) -> ExitCode {
        if self.unplaced().next().is_none() && self.faults.is_empty() {
            ExitCode::Input
        } else {
            ExitCode::Usage
        }
    }

    /// What has no place in a plan.
    pub fn unplaced(&self) -> impl Iterator<Item = &String> {
        self.unreadable.iter().chain(&self.folders)
    }

    /// Every placed fault, plans' before CTs'.
    pub fn diagnostics(&self) -> impl Iterator<Item = &Diagnostic> {
        self.faults.iter().chain(self.cts.iter())
    }
}

/// Reads and checks plans and the headers of their CTs. No voxel is read.
///
/// # Errors
/// [`Refusal`] with every fault of every plan.
pub fn prepare(files: &[PathBuf]) -> Result<Vec<Ready>, Refusal> {
    let mut refusal = Refusal::default();
    let mut ready = Vec::with_capacity(files.len());
    let mut names: HashMap<String, String> = HashMap::new();
    for path in files {
        let file = match PlanFile::read(path) {
            Ok(file) => file,
            Err(error) => {
                refusal.unreadable.push(error.to_string());
                continue;
            }
        };
        if let Some(name) = file.name()
            && let Some(first) = names.insert(name.to_owned(), file.shown_name().to_owned())
        {
            let fault = file.name_fault(
                format!("two plans of one run have the name `{name}`"),
                format!("the other is {first}; both would write into one folder"),
            );
            refusal.faults.extend([fault]);
        }
        if let Some(plan) = prepare_one(&file, &mut refusal) {
            ready.push(plan);
        }
    }
    if refusal.is_empty() {
        Ok(ready)
    } else {
        Err(refusal)
    }
}

fn prepare_one(file: &PlanFile, refusal: &mut Refusal) -> Option<Ready> {
    let Some(source) = file.ct() else {
        refusal.faults.extend(file.faults());
        return None;
    };
    let header = match ct::header(&source) {
        Ok(header) => header,
        Err(error) => {
            refusal.faults.extend(file.faults());
            let fault = file.ct_fault(error.to_string(), None);
            refusal.cts.extend([fault]);
            return None;
        }
    };
    match file.resolve(&header.grid) {
        Ok(plan) => Some(Ready {
            file: file.shown_name().to_owned(),
            sha256: file.sha256().to_owned(),
            source: file.clone(),
            landmarks_sha256: file.landmarks_sha256().map(str::to_owned),
            plan,
            ct: header,
        }),
        Err(faults) => {
            refusal.faults.extend(faults);
            None
        }
    }
}

/// Whether each plan has an output folder of its own. Plans of one run have different names, but their folders can
/// be links to the same one.
///
/// # Errors
/// [`Refusal`] that names the plans.
pub fn check_folders(plans: &[Ready], out: &Path, part: Option<&Part>) -> Result<(), Refusal> {
    let mut refusal = Refusal::default();
    let mut folders: HashMap<PathBuf, &Ready> = HashMap::new();
    for ready in plans {
        // One that is not there is no link, and is told apart by its name.
        let Ok(folder) = output_folder(out, &ready.plan, part).canonicalize() else {
            continue;
        };
        if let Some(first) = folders.insert(folder, ready) {
            refusal.folders.push(format!(
                "`{}` and `{}`, of {} and {}, are the same folder; give the plans folders of their own",
                output_folder(out, &first.plan, part).display(),
                output_folder(out, &ready.plan, part).display(),
                first.file,
                ready.file,
            ));
        }
    }
    if refusal.is_empty() {
        Ok(())
    } else {
        Err(refusal)
    }
}

/// The folder that the outputs of a plan go to, or of a part of its candidates: `<plan>`, `<plan>.2-of-5`. No plan has
/// a name with a point in it.
pub fn output_folder(out: &Path, plan: &Plan, part: Option<&Part>) -> PathBuf {
    match part {
        None => out.join(&plan.name),
        Some(Part { number, of, .. }) => out.join(format!("{}.{number}-of-{of}", plan.name)),
    }
}
