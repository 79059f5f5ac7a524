//! The benchmark's tables.

use serde::Serialize;

use super::ground_truth::Scores;
use super::held_back::Explained;
use super::scenes::Role;

/// What was measured of a scene, reconstructed in one way.
#[derive(Serialize)]
pub struct Row {
    pub scene: String,
    pub role: Role,
    /// The way it was reconstructed.
    pub label: String,
    pub points: usize,
    /// The share of the points that is sky; `None` if the scene has no known sky.
    pub sky: Option<f64>,
    /// Scores against ground truth, and their thresholds.
    pub ground_truth: Option<(Scores, [f64; 5])>,
    /// The mean over the photographs that were held back.
    pub held_back: Option<Explained>,
    /// Time of a view, the whole program included.
    pub seconds: Option<f64>,
    pub peak_bytes: Option<u64>,
}

/// All tables.
pub fn markdown(rows: &[Row], failed: &[String]) -> String {
    let mut lines = vec![
        "| scene | | points | sky | held back: covered | error | right | s a view | GiB |".to_owned(),
        "|---|---|---|---|---|---|---|---|---|".to_owned(),
    ];
    lines.extend(rows.iter().map(Row::line));
    for (role, name) in [(Role::Choose, "chosen on"), (Role::Last, "measured last")] {
        lines.extend(means(rows, role).into_iter().map(|(label, mean)| {
            let Explained { covered, error, right } = mean;
            let (covered, right) = (percent(covered), percent(right));
            format!("| **mean, {name}** | {label} | | | {covered} | {error:.2} | {right} | | |")
        }));
    }
    if rows.iter().any(|row| row.ground_truth.is_some()) {
        lines.push(
            "\nAgainst ground truth: depths within shares of the depth, and F, precision and recall of the cloud at these shares of \
             the median depth, in per cent.\n"
                .to_owned(),
        );
        lines.push("| scene | | shares | depths | F | precision | recall |".to_owned());
        lines.push("|---|---|---|---|---|---|---|".to_owned());
        lines.extend(rows.iter().filter_map(Row::ground_truth_line));
    }
    lines.extend(failed.iter().map(|problem| format!("\nFailed: {problem}")));
    lines.join("\n") + "\n"
}

/// The means of held-back photographs over the scenes of a role, for each label.
fn means(rows: &[Row], role: Role) -> Vec<(&str, Explained)> {
    let mut labels: Vec<&str> = Vec::new();
    for row in rows.iter().filter(|row| row.role == role && row.held_back.is_some()) {
        if !labels.contains(&row.label.as_str()) {
            labels.push(&row.label);
        }
    }
    let of = |label: &str| {
        let these = rows.iter().filter(|row| row.role == role && row.label == label);
        Explained::mean(&these.filter_map(|row| row.held_back).collect::<Vec<_>>())
    };
    labels.into_iter().filter_map(|label| Some((label, of(label)?))).collect()
}

impl Row {
    fn line(&self) -> String {
        let Self { scene, label, points, .. } = self;
        let sky = self.sky.map_or(String::new(), percent);
        let held = self.held_back.map_or("| | ".to_owned(), |Explained { covered, error, right }| {
            format!("{} | {error:.2} | {}", percent(covered), percent(right))
        });
        let seconds = self.seconds.map_or(String::new(), |seconds| format!("{seconds:.1}"));
        let peak = self
            .peak_bytes
            .map_or(String::new(), |peak| format!("{:.2}", peak as f64 / 1_f64.exp2().powi(30)));
        format!("| {scene} | {label} | {points} | {sky} | {held} | {seconds} | {peak} |")
    }

    fn ground_truth_line(&self) -> Option<String> {
        let (scores, thresholds) = self.ground_truth.as_ref()?;
        let list = |values: [f64; 5]| values.map(|value| format!("{:.1}", 100.0 * value)).join(" ");
        let shares = thresholds.map(|share| format!("{}", 100.0 * share)).join(" ");
        let f = std::array::from_fn(|i| scores.f(i));
        let Self { scene, label, .. } = self;
        let (depths, f) = (list(scores.within), list(f));
        let (precision, recall) = (list(scores.precision), list(scores.recall));
        Some(format!("| {scene} | {label} | {shares} % | {depths} | {f} | {precision} | {recall} |"))
    }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}
