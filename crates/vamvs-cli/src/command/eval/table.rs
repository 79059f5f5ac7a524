//! Tables on the terminal.

use vamvs::eval::RegionErrors;
use vamvs::eval::page::{length, percent, region, threshold};

/// Rows in columns: the first is left-aligned, the others right-aligned.
pub struct Table(Vec<Vec<String>>);

impl Table {
    /// A table with a head.
    pub fn new(head: &[&str]) -> Self {
        Self(vec![head.iter().map(|&cell| cell.to_owned()).collect()])
    }

    /// A table of depth errors with the thresholds of `example`.
    pub fn of_depth(example: &RegionErrors) -> Self {
        let mut head = ["", "pixels", "true", "with depth", "mean", "median", "rel. mean", "rel. median"]
            .map(str::to_owned)
            .to_vec();
        head.extend(example.errors.within.iter().map(|within| format!("≤ {}", threshold(within.threshold))));
        Self(vec![head])
    }

    /// Adds a row.
    pub fn row(&mut self, cells: Vec<String>) {
        self.0.push(cells);
    }

    /// Adds the errors of a view or scene, a row a region.
    pub fn depth_rows(&mut self, name: &str, regions: &[RegionErrors]) {
        for (index, part) in regions.iter().enumerate() {
            let errors = &part.errors;
            let name = if index == 0 { name } else { "" };
            let mut row =
                vec![name.to_owned(), region(part.region).to_owned(), errors.true_pixels.to_string()];
            row.push(percent(errors.coverage));
            row.extend([errors.absolute.mean, errors.absolute.median].map(length));
            row.extend([errors.relative.mean, errors.relative.median].map(percent));
            row.extend(errors.within.iter().map(|within| percent(within.share)));
            self.row(row);
        }
    }

    /// Prints the table on standard output.
    pub fn print(&self) {
        let columns = self.0.iter().map(Vec::len).max().unwrap_or(0);
        let length =
            |row: &Vec<String>, column: usize| row.get(column).map_or(0, |cell| cell.chars().count());
        let widths: Vec<usize> = (0..columns)
            .map(|column| self.0.iter().map(|row| length(row, column)).max().unwrap_or(0))
            .collect();
        for row in &self.0 {
            let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| {
                if column == 0 { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
            });
            say!("{}", cells.collect::<Vec<_>>().join("  ").trim_end());
        }
    }
}
