//! The real CTs that some tests need; they are not part of the project.

use std::io::Write;
use std::path::PathBuf;

/// A file or folder of the real data, if it is there. If not, says that what needs it is skipped.
pub fn path(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../shared/data")
        .join(name);
    if path.exists() {
        return path.canonicalize().ok();
    }
    // Past the capture of passing tests, which `println!` would not get.
    let _ = writeln!(
        std::io::stderr(),
        "skipped: {} is not there",
        path.display()
    );
    None
}
