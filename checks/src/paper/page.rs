//! The Markdown page of all tables, docs/paper.md.

use super::networks::REFERENCES;
use super::{HALF_WIDTH, HOLD_OUT, LARGE};

/// A table with its title and text.
pub struct Section {
    pub title: &'static str,
    /// The paper's finding, and how our table was made where that differs from the introduction.
    pub text: &'static str,
    pub head: Vec<&'static str>,
    pub rows: Vec<Vec<String>>,
}

impl Section {
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let head: Vec<String> = self.head.iter().map(|&cell| cell.to_owned()).collect();
        let rule = "|---".repeat(self.head.len()) + "|\n";
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        format!("## {}\n\n{}\n\n{}{rule}{rows}", self.title, self.text, line(&head))
    }
}

/// The heading at which the generated part of the page begins.
const WRITTEN: &str = "## How the tables were made\n\n";

/// The whole page. `before` is the page as it was: its hand-written part, above the generated one, is kept.
pub fn markdown(before: &str, sections: &[Section], steps: usize) -> String {
    let people = before.split_once(WRITTEN).map_or("# The paper's experiments\n\n", |(people, _)| people);
    let sections: Vec<String> = sections.iter().map(Section::markdown).collect();
    format!("{people}{WRITTEN}{}\n{}", introduction(steps), sections.join("\n"))
}

fn introduction(steps: usize) -> String {
    format!(
        "Written by `cargo xtask paper`; `cargo xtask paper table1` and so on run one of them.\n\n\
         Every network here has half the paper's channels (`models/export.py --thin {thin}`) and was trained for \
         {steps} steps of one sample: 160×128 pixels, 3 views, 48 planes at most, AdamW; a few minutes on two \
         processor cores, where the paper's trained for days on four GPUs. The scenes are clutter of generated \
         objects, {train} to learn from and {held} to measure on ({TRAINING_SIZE}, 9 views), and one of {large_size} for \
         time, memory and clouds. So rows are to be compared with one another, and their order with the paper's, \
         not their values; with one short run a row, differences of a point or two are chance. `<d` and `<3d` are \
         the shares of pixels whose depth is within d and 3d of the true one, d = 0.375 distances of planes, on \
         {REFERENCES} depth maps; `Invis` counts pixels that some source view does not see, `Fully-vis` those \
         that all see. – stands for figures of the paper that are not at hand.\n",
        thin = HALF_WIDTH.thin,
        train = HALF_WIDTH.training.scenes,
        held = HOLD_OUT.scenes,
        TRAINING_SIZE = HOLD_OUT.size.replace('x', "×"),
        large_size = LARGE.size.replace('x', "×"),
    )
}

/// A share with three decimals, as in the paper.
pub fn share(value: f64) -> String {
    format!("{value:.3}")
}
