//! Checks that result files are complete, and that two folders hold the same files.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

/// Prefix of the names of files that are still being written.
const TEMPORARY: &str = ".vamvs-";

/// All files in a folder and its subfolders, by their paths relative to it.
pub fn files(folder: &Path) -> Result<BTreeMap<String, PathBuf>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).with_context(|| next.display().to_string())? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(folder)?.display().to_string(), path);
            }
        }
    }
    Ok(files)
}

fn is_temporary(name: &str) -> bool {
    name.rsplit('/').next().is_some_and(|name| name.starts_with(TEMPORARY))
}

/// One sentence for each file in a folder that is incomplete. Temporary files count as incomplete unless
/// `may_have_temporary`.
pub fn half_written(folder: &Path, may_have_temporary: bool) -> Result<Vec<String>> {
    let mut findings = Vec::new();
    for (name, path) in files(folder)? {
        let problem = if is_temporary(&name) {
            (!may_have_temporary).then_some("it is a temporary file that stayed behind")
        } else {
            problem(&name, &fs::read(path)?)
        };
        findings.extend(problem.map(|problem| format!("{name}: {problem}")));
    }
    Ok(findings)
}

/// What is wrong with a file of this name and content; `None` if nothing, or if the format is not checked.
fn problem(name: &str, content: &[u8]) -> Option<&'static str> {
    let says = |holds: bool, otherwise| (!holds).then_some(otherwise);
    let text = || std::str::from_utf8(content).unwrap_or_default();
    match name.rsplit('.').next()? {
        _ if content.is_empty() => Some("it is empty"),
        "pfm" => {
            says(pfm_is_whole(content).is_some_and(|whole| whole), "its length is not what its header tells")
        }
        "ply" => {
            says(ply_is_whole(content).is_some_and(|whole| whole), "its length is not what its header tells")
        }
        "png" => says(content.ends_with(b"IEND\xAE\x42\x60\x82"), "it has no end"),
        "json" => says(serde_json::from_slice::<serde_json::Value>(content).is_ok(), "it is no JSON"),
        "html" => says(text().trim_end().ends_with("</html>"), "it has no end"),
        "txt" if name.ends_with("_cam.txt") => says(text().lines().count() >= 11, "lines are missing"),
        _ => None,
    }
}

/// Whether a PFM file has as many bytes as its header announces; `None` if the header is incomplete.
fn pfm_is_whole(content: &[u8]) -> Option<bool> {
    let mut lines = content.splitn(4, |&byte| byte == b'\n');
    let channels = if lines.next()? == b"PF" { 3 } else { 1 };
    let size = std::str::from_utf8(lines.next()?).ok()?;
    let sides: Vec<usize> = size.split_whitespace().filter_map(|side| side.parse().ok()).collect();
    let data = lines.nth(1)?;
    Some(data.len() == 4 * channels * sides.iter().product::<usize>())
}

/// Whether a binary PLY file has as many bytes as its header announces; `None` if the header is incomplete. A file with
/// list properties must have at least the bytes that it has with empty lists.
fn ply_is_whole(content: &[u8]) -> Option<bool> {
    const END: &[u8] = b"end_header\n";
    let end = content.windows(END.len()).position(|window| window == END)? + END.len();
    let header = std::str::from_utf8(&content[..end]).ok()?;
    let count: usize =
        header.lines().find_map(|line| line.strip_prefix("element vertex "))?.trim().parse().ok()?;
    let has_lists = header.contains("property list");
    let bytes = |line: &str| match line.split_whitespace().nth(1) {
        Some("double" | "float64") => 8,
        Some("float" | "float32" | "int" | "uint" | "int32" | "uint32") => 4,
        Some("short" | "ushort" | "int16" | "uint16") => 2,
        Some(_) => 1,
        None => 0,
    };
    let stride: usize = header.lines().filter(|line| line.starts_with("property ")).map(bytes).sum();
    let found = content.len() - end;
    Some(if has_lists { found >= count * stride } else { found == count * stride })
}

/// How the files of two folders differ, at most seven sentences. Temporary files and `ignored` ones do not count.
pub fn differences(expected: &Path, found: &Path, ignored: &[&str]) -> Result<Vec<String>> {
    let counts = |name: &String| !is_temporary(name) && !ignored.contains(&name.as_str());
    let (expected, found) = (files(expected)?, files(found)?);
    let names: BTreeSet<&String> = expected.keys().chain(found.keys()).filter(|name| counts(name)).collect();
    let mut findings = Vec::new();
    for name in names {
        let problem = match (expected.get(name), found.get(name)) {
            (Some(a), Some(b)) if fs::read(a)? == fs::read(b)? => continue,
            (Some(_), Some(_)) => "it differs from that of the undisturbed run",
            (Some(_), None) => "it is missing, but is there after the undisturbed run",
            (None, _) => "it is not there after the undisturbed run",
        };
        findings.push(format!("{name}: {problem}"));
    }
    let more = findings.len().saturating_sub(6);
    findings.truncate(6);
    findings.extend((more > 0).then(|| format!("and {more} other files")));
    Ok(findings)
}
