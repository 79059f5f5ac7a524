//! Checks that sources and documents use the terms of the field (see `CONTRIBUTING.md`).

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;
use std::process::Command;

/// Pairs of a word that must not occur, in lower case, and the term to write instead.
const TERMS: [(&str, &str); 33] = [
    ("made scene", "synthetic scene"),
    ("made scenes", "synthetic scenes"),
    ("hand-made", "handcrafted"),
    ("made by hand", "handcrafted"),
    ("held out", "hold-out"),
    ("held-out", "hold-out"),
    ("truth", "ground truth"),
    ("failures", "outliers"),
    ("off by more than", "error > …"),
    ("right depths", "inliers"),
    ("blank surface", "textureless surface"),
    ("blank surfaces", "textureless surfaces"),
    ("blank wall", "textureless wall"),
    ("images are blank", "images are textureless"),
    ("coarse cells", "coarse stride"),
    ("cells of 4", "coarse stride of 4"),
    ("cells of 8", "coarse stride of 8"),
    ("--cells", "--coarse-stride"),
    ("bend least", "depth completion"),
    ("bent least", "depth completion"),
    ("along the photograph's edges", "joint bilateral upsampling"),
    ("lattice", "dilation phase, or grid"),
    ("lattices", "dilation phases, or grids"),
    ("residue", "dilation phase"),
    ("residue class", "dilation phase"),
    ("not confirmed by other views", "inconsistent with other views"),
    ("unconfirmed", "inconsistent"),
    ("fate", "outcome"),
    ("fates", "outcomes"),
    ("mangle", "malformed"),
    ("manners", "terminal"),
    ("fn beside", "a name that says of what"),
    ("fn fitting", "a name that says of what"),
];

#[test]
fn terms_are_the_fields() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let listed =
        Command::new("git").args(["ls-files", "*.rs", "*.md", "*.py", "*.pyi"]).current_dir(root).output();
    let listed = String::from_utf8(listed.expect("git lists the files").stdout).unwrap();
    assert!(listed.lines().count() > 100, "git lists no files");
    // The changelog names former terms, and this file lists them.
    let others = ["CHANGELOG.md", "xtask/tests/terms.rs"];
    let found: Vec<String> = listed
        .lines()
        .filter(|name| !others.contains(name) && root.join(name).is_file())
        .flat_map(|name| problems(name, &std::fs::read_to_string(root.join(name)).unwrap()))
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// One message for each word of [`TERMS`] in a line of a file.
fn problems(name: &str, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    // Former names stay as aliases, so that old files can still be read.
    let lines = text.lines().enumerate().filter(|(_, line)| !line.contains("alias = \""));
    for (number, line) in lines {
        let line = line.to_lowercase();
        let used = TERMS.iter().filter(|(word, _)| occurs(&line, word));
        found.extend(used.map(|(word, term)| format!("{name}:{}: {word:?}: write {term:?}", number + 1)));
    }
    found
}

/// Whether a line contains `word`, which may be several words, other than inside a longer word. For "truth", the term
/// "ground truth" does not count.
fn occurs(line: &str, word: &str) -> bool {
    let is_part = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    line.match_indices(word).any(|(at, _)| {
        let (before, after) = (&line[..at], &line[at + word.len()..]);
        let is_term = word == "truth" && (before.ends_with("ground ") || before.ends_with("ground-"));
        !is_part(before.chars().next_back()) && !is_part(after.chars().next()) && !is_term
    })
}

#[test]
fn a_word_is_found_where_it_stands_alone() {
    let found = |line: &str| problems("a.rs", line).len();
    assert_eq!([found("the truth"), found("the ground truth"), found("let ground_truth = 1;")], [1, 0, 0]);
    assert_eq!(
        [found("Held-out scenes"), found("percolates"), found("#[serde(alias = \"failures\")]")],
        [1, 0, 0]
    );
}
