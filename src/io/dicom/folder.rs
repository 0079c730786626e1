//! What lies in a folder: series that can be read, and what is left out of them and why.

use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::fmt::Write;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;

use super::elements::DataSet;
use super::error::{DicomError, DicomProblem, SliceProblem};
use super::geometry::Stack;
use super::panics::caught;
use super::series::Series;
use super::slice::{Kind, MAX_FILE_BYTES, Membership, Skip, Slice, classify};
use crate::text::shown_name;

/// How many entries of a folder are looked at. An examination has some thousands.
const MAX_FILES: usize = 100_000;

/// How far cosines of two slices may differ for one orientation: 0.05 mm over a field of 500 mm.
const SAME_ORIENTATION: f64 = 1e-4;

/// As a part of itself, how far pixel spacings may differ for one: the same 0.05 mm.
const SAME_SPACING: f64 = 1e-4;

const BUFFER: usize = 32 << 10;

/// A folder that has been looked through, headers only.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// The file that the user named in place of its folder.
    named: Option<OsString>,
    stacks: Vec<Candidate>,
    faulty: Vec<Faulty>,
    skipped: Vec<Skipped>,
}

/// Slices of one series, orientation, size and pixel spacing.
#[derive(Debug)]
struct Candidate {
    member: Membership,
    /// By name, which gives them an order before they have another.
    slices: Vec<(OsString, Slice)>,
}

impl Candidate {
    fn takes(&self, member: &Membership, slice: &Slice) -> bool {
        // First, as this is asked of every file for every stack.
        if self.member.uid != member.uid {
            return false;
        }
        let Some((_, first)) = self.slices.first() else {
            return true;
        };
        let axes = |slice: &Slice| [slice.along_row, slice.along_column];
        let turned = axes(first)
            .into_iter()
            .zip(axes(slice))
            .any(|(a, b)| (a - b).abs().max_element() > SAME_ORIENTATION);
        let stretched = first
            .spacing
            .iter()
            .zip(slice.spacing)
            .any(|(a, b)| (a - b).abs() > SAME_SPACING * a);
        let size = |slice: &Slice| (slice.format.rows, slice.format.columns);
        size(first) == size(slice) && !turned && !stretched
    }

    fn stack(&self) -> Result<Stack, DicomProblem> {
        let slices: Vec<&Slice> = self.slices.iter().map(|(_, slice)| slice).collect();
        Stack::new(&slices)
    }
}

/// A file that is, or may be, of a series, and cannot be used.
#[derive(Debug)]
struct Faulty {
    file: OsString,
    /// Empty where not even that could be read.
    member: Membership,
    problem: Arc<SliceProblem>,
}

#[derive(Debug)]
struct Skipped {
    file: OsString,
    member: Membership,
    reason: Skip,
}

/// A line about a series: what `info` shows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeriesLine {
    /// SeriesInstanceUID.
    pub uid: String,
    /// SeriesNumber.
    pub number: Option<String>,
    /// Modality.
    pub modality: String,
    /// How many files.
    pub files: usize,
    /// Columns and rows; not of what is left out.
    pub size: Option<[usize; 2]>,
    /// Between columns, between rows and between slices, mm; the last is not there in an irregular stack.
    pub spacing_mm: Option<(f64, f64, Option<f64>)>,
    /// Whether it can be chosen.
    pub state: SeriesState,
    /// Why it is left out or cannot be used.
    pub because: Option<String>,
}

/// What can be done with files of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SeriesState {
    /// They can be read.
    Usable,
    /// They are of a CT, and cannot be read.
    Unusable,
    /// They are something else.
    Skipped,
}

/// Files that belong to no series.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OtherFiles {
    /// What they are.
    pub because: String,
    /// How many.
    pub files: usize,
    /// One of them.
    pub first: String,
}

impl Folder {
    /// Looks through a folder, or through that of a file: every file's header is read, in parallel, no pixel.
    /// Pipes and devices are not opened, folders within are not searched.
    ///
    /// # Errors
    /// [`DicomError`] where it cannot be listed.
    pub fn scan(path: &Path) -> Result<Self, DicomError> {
        let fail = |problem| DicomError::new(path, problem);
        let io = |error| fail(DicomProblem::Io(error));
        let (folder, named) = if fs::metadata(path).map_err(io)?.is_dir() {
            (path.to_owned(), None)
        } else {
            let name = path.file_name().unwrap_or_default();
            let folder = match path.parent() {
                Some(folder) if folder != Path::new("") => folder.to_owned(),
                _ => PathBuf::from("."),
            };
            (folder, Some(name.to_owned()))
        };
        let mut names = Vec::new();
        for entry in fs::read_dir(&folder).map_err(io)? {
            names.push(entry.map_err(io)?.file_name());
            if names.len() > MAX_FILES {
                let limit = MAX_FILES;
                return Err(fail(DicomProblem::TooManyFiles { limit }));
            }
        }
        // The order in which a system lists them is chance.
        names.sort();
        let looked: Vec<_> = names
            .par_iter()
            .map(|name| look(&folder.join(name)))
            .collect();
        let mut found = Self {
            path: folder,
            named,
            stacks: Vec::new(),
            faulty: Vec::new(),
            skipped: Vec::new(),
        };
        for (name, (member, kind)) in names.into_iter().zip(looked) {
            found.add(name, member, kind);
        }
        found.leave_out_single_slices();
        Ok(found)
    }

    fn add(&mut self, file: OsString, member: Membership, kind: Kind) {
        match kind {
            Kind::Slice(slice) => {
                let stack = self.stacks.iter_mut().find(|c| c.takes(&member, &slice));
                match stack {
                    Some(stack) => stack.slices.push((file, *slice)),
                    None => self.stacks.push(Candidate {
                        member,
                        slices: vec![(file, *slice)],
                    }),
                }
            }
            Kind::Skipped(reason) => self.skipped.push(Skipped {
                file,
                member,
                reason,
            }),
            Kind::Faulty(problem) => self.faulty.push(Faulty {
                file,
                member,
                problem: Arc::new(problem),
            }),
        }
    }

    /// A scout view that does not say so is one slice beside a stack.
    fn leave_out_single_slices(&mut self) {
        let is_stack = |candidate: &Candidate| candidate.slices.len() > 1;
        if !self.stacks.iter().any(is_stack) {
            return;
        }
        let (stacks, single) = std::mem::take(&mut self.stacks)
            .into_iter()
            .partition(is_stack);
        self.stacks = stacks;
        for Candidate { member, slices } in single {
            self.skipped
                .extend(slices.into_iter().map(|(file, _)| Skipped {
                    file,
                    member: member.clone(),
                    reason: Skip::Single,
                }));
        }
    }

    /// The series to read: the only one, the one with the UID, or that of the file that the user named.
    ///
    /// # Errors
    /// [`DicomError`] where there is none or a choice, where a file of it cannot be used, and where its slices
    /// are no regular stack.
    pub fn choose(&self, uid: Option<&str>) -> Result<Series<'_>, DicomError> {
        let fail = |problem| DicomError::new(&self.path, problem);
        let chosen: Vec<&Candidate> = match (&self.named, uid) {
            (Some(file), uid) => vec![self.of_file(file, uid)?],
            (None, Some(uid)) => {
                let of_uid = |c: &&Candidate| c.member.uid == uid;
                self.stacks.iter().filter(of_uid).collect()
            }
            (None, None) => {
                // A series that cannot be read may be the one that is meant.
                let count = self.uids().len();
                if count > 1 {
                    let table = self.table_of_ct();
                    return Err(fail(DicomProblem::Several { count, table }));
                }
                self.stacks.iter().collect()
            }
        };
        if chosen.len() < 2
            && let Some(faulty) = self.fault_of(&chosen, uid)
        {
            return Err(self.slice_error(&faulty.file, &faulty.problem));
        }
        match chosen.as_slice() {
            [only] => {
                let stack = only.stack().map_err(fail)?;
                Series::new(&self.path, &only.slices, stack).map_err(fail)
            }
            [] => Err(fail(match uid {
                Some(wanted) if !self.stacks.is_empty() => DicomProblem::NoSuchSeries {
                    wanted: wanted.escape_default().to_string(),
                    table: self.table_of_ct(),
                },
                _ => DicomProblem::NoSeries {
                    found: self.what_else(),
                },
            })),
            several => Err(fail(DicomProblem::Mixed {
                count: several.len(),
                table: table(&lines_of(several)),
            })),
        }
    }

    /// The series of a CT in the folder, whether they can be read or not.
    fn uids(&self) -> BTreeSet<&str> {
        let stacks = self.stacks.iter().map(|stack| &stack.member.uid);
        let faulty = self.faulty.iter().map(|faulty| &faulty.member.uid);
        let all = stacks.chain(faulty).map(String::as_str);
        all.filter(|uid| !uid.is_empty()).collect()
    }

    fn of_file(&self, file: &OsStr, uid: Option<&str>) -> Result<&Candidate, DicomError> {
        let path = self.path.join(file);
        let fail = |problem| DicomError::new(&path, problem);
        if let Some(faulty) = self.faulty.iter().find(|faulty| faulty.file == file) {
            return Err(self.slice_error(file, &faulty.problem));
        }
        let holds = |c: &&Candidate| c.slices.iter().any(|(name, _)| name == file);
        let Some(candidate) = self.stacks.iter().find(holds) else {
            let skipped = self.skipped.iter().find(|skipped| skipped.file == file);
            let found = skipped.map_or("gone".to_owned(), |skipped| skipped.reason.to_string());
            return Err(fail(DicomProblem::NotASlice { found }));
        };
        match uid {
            Some(wanted) if wanted != candidate.member.uid => {
                Err(fail(DicomProblem::OtherSeries {
                    found: candidate.member.uid.clone(),
                    wanted: wanted.escape_default().to_string(),
                }))
            }
            _ => Ok(candidate),
        }
    }

    /// The first file that keeps a choice from being whole: of the series chosen, or of who knows which.
    fn fault_of(&self, chosen: &[&Candidate], uid: Option<&str>) -> Option<&Faulty> {
        let of_choice = |faulty: &&Faulty| {
            let theirs = &faulty.member.uid;
            theirs.is_empty()
                || Some(theirs.as_str()) == uid
                || chosen.iter().any(|c| c.member.uid == *theirs)
                || uid.is_none() && chosen.is_empty()
        };
        self.faulty.iter().find(of_choice)
    }

    fn slice_error(&self, file: &OsStr, problem: &Arc<SliceProblem>) -> DicomError {
        let problem = DicomProblem::Slice {
            file: shown_name(file),
            problem: Arc::clone(problem),
        };
        DicomError::new(&self.path, problem)
    }

    /// A line for each stack that may be chosen, then for each series that may not.
    pub fn series(&self) -> Vec<SeriesLine> {
        let mut lines = lines_of(&self.stacks.iter().collect::<Vec<_>>());
        let skipped = self.skipped.iter().map(|skipped| {
            (
                &skipped.member,
                skipped.reason.to_string(),
                SeriesState::Skipped,
            )
        });
        let faulty = self.faulty.iter().map(|faulty| {
            let reason = format!("file `{}` {}", shown_name(&faulty.file), faulty.problem);
            (&faulty.member, reason, SeriesState::Unusable)
        });
        let mut others: Vec<SeriesLine> = Vec::new();
        for (member, because, state) in skipped.chain(faulty) {
            if member.uid.is_empty() {
                continue;
            }
            let same = |line: &&mut SeriesLine| {
                line.uid == member.uid && line.because.as_ref() == Some(&because)
            };
            match others.iter_mut().find(same) {
                Some(line) => line.files += 1,
                None => others.push(SeriesLine {
                    uid: member.uid.clone(),
                    number: member.number.clone(),
                    modality: member.modality.clone(),
                    files: 1,
                    size: None,
                    spacing_mm: None,
                    state,
                    because: Some(because),
                }),
            }
        }
        lines.append(&mut others);
        lines
    }

    /// Files that belong to no series, by what they are.
    pub fn others(&self) -> Vec<OtherFiles> {
        let mut others: Vec<OtherFiles> = Vec::new();
        let skipped = self
            .skipped
            .iter()
            .map(|skipped| (&skipped.file, &skipped.member, skipped.reason.to_string()));
        let faulty = self
            .faulty
            .iter()
            .map(|faulty| (&faulty.file, &faulty.member, faulty.problem.to_string()));
        for (file, member, because) in skipped.chain(faulty) {
            if !member.uid.is_empty() {
                continue;
            }
            match others.iter_mut().find(|other| other.because == because) {
                Some(other) => other.files += 1,
                None => others.push(OtherFiles {
                    because,
                    files: 1,
                    first: shown_name(file),
                }),
            }
        }
        others
    }

    /// The series as a table for people.
    pub fn table(&self) -> String {
        table(&self.series())
    }

    /// Those of it that are of a CT.
    fn table_of_ct(&self) -> String {
        let mut lines = self.series();
        lines.retain(|line| line.state != SeriesState::Skipped);
        table(&lines)
    }

    fn what_else(&self) -> String {
        let mut parts: Vec<(String, usize)> = Vec::new();
        for skipped in &self.skipped {
            let reason = skipped.reason.to_string();
            match parts.iter_mut().find(|(known, _)| *known == reason) {
                Some((_, count)) => *count += 1,
                None => parts.push((reason, 1)),
            }
        }
        if parts.is_empty() && self.faulty.is_empty() {
            return "it is empty".to_owned();
        }
        if !self.faulty.is_empty() {
            parts.push(("damaged".to_owned(), self.faulty.len()));
        }
        let parts = parts.iter().map(|(reason, count)| match count {
            1 => format!("one file is {reason}"),
            n => format!("{n} files are {reason}"),
        });
        parts.collect::<Vec<_>>().join(", ")
    }
}

fn lines_of(candidates: &[&Candidate]) -> Vec<SeriesLine> {
    let line = |candidate: &&Candidate| {
        let (_, first) = candidate.slices.first()?;
        let stack = candidate.stack();
        let between = stack.as_ref().ok().map(|stack| stack.spacing);
        let [columns, rows] = first.spacing;
        Some(SeriesLine {
            uid: candidate.member.uid.clone(),
            number: candidate.member.number.clone(),
            modality: candidate.member.modality.clone(),
            files: candidate.slices.len(),
            size: Some([first.format.columns, first.format.rows]),
            spacing_mm: Some((columns, rows, between)),
            state: match stack {
                Ok(_) => SeriesState::Usable,
                Err(_) => SeriesState::Unusable,
            },
            because: stack.err().map(|problem| problem.to_string()),
        })
    };
    candidates.iter().filter_map(line).collect()
}

fn table(lines: &[SeriesLine]) -> String {
    let wide = lines.iter().map(|line| line.uid.len()).max();
    let wide = wide.unwrap_or(0).max("series".len());
    let mut text = format!(
        "  {:wide$}  number  modality  files  size       spacing (mm)",
        "series"
    );
    for line in lines {
        let size = line
            .size
            .map_or("-".to_owned(), |[x, y]| format!("{x}×{y}"));
        let spacing = line.spacing_mm.map_or("-".to_owned(), |(x, y, z)| {
            let z = z.map_or("?".to_owned(), |z| short(z).to_string());
            format!("{}×{}×{z}", short(x), short(y))
        });
        // Writing to a string does not fail.
        let _ = write!(
            text,
            "\n  {:wide$}  {:6}  {:8}  {:5}  {size:9}  {spacing}",
            line.uid,
            line.number.as_deref().unwrap_or("-"),
            line.modality,
            line.files
        );
        if let Some(because) = &line.because {
            let what = match line.state {
                SeriesState::Skipped => "left out",
                _ => "unusable",
            };
            let _ = write!(text, "\n    {what}: {because}");
        }
    }
    text
}

/// A spacing for people.
fn short(mm: f64) -> f64 {
    (mm * 1e4).round() / 1e4
}

/// What a file is. Nothing but a plain file is opened, for a pipe would wait for someone to write to it.
fn look(path: &Path) -> (Membership, Kind) {
    let unknown = Membership::default;
    let metadata = match fs::metadata(path) {
        Ok(metadata) => metadata,
        Err(_) if path.is_symlink() => return (unknown(), Kind::Skipped(Skip::DanglingLink)),
        Err(error) => return (unknown(), Kind::Faulty(SliceProblem::Io(error))),
    };
    if metadata.is_dir() {
        return (unknown(), Kind::Skipped(Skip::Folder));
    }
    if !metadata.is_file() {
        return (unknown(), Kind::Skipped(Skip::Special));
    }
    let len = metadata.len();
    let file = match File::open(path) {
        Ok(file) => BufReader::with_capacity(BUFFER, file),
        Err(error) => return (unknown(), Kind::Faulty(SliceProblem::Io(error))),
    };
    match caught(|| DataSet::open(file)) {
        Some(Ok(data_set)) => {
            let (member, kind) = classify(&data_set, len);
            if len > MAX_FILE_BYTES && matches!(kind, Kind::Slice(_)) {
                let (bytes, limit) = (len, MAX_FILE_BYTES);
                return (
                    member,
                    Kind::Faulty(SliceProblem::TooLarge { bytes, limit }),
                );
            }
            (member, kind)
        }
        Some(Err(SliceProblem::NotDicom)) => (unknown(), Kind::Skipped(Skip::NotDicom)),
        Some(Err(problem)) => (unknown(), Kind::Faulty(problem)),
        None => (unknown(), Kind::Faulty(SliceProblem::misfit())),
    }
}

/// Whether a path is for this module: a folder, or a file that says that it is DICOM. What cannot be opened is
/// not.
pub fn is_dicom(path: &Path) -> bool {
    let Ok(metadata) = fs::metadata(path) else {
        return false;
    };
    if metadata.is_dir() {
        return true;
    }
    metadata.is_file()
        && File::open(path).is_ok_and(|mut file| super::elements::has_magic(&mut file))
}
