//! The parameters of a round, drawn from its seed.

use std::fmt;
use std::path::Path;

use super::random::Random;

/// The lens model that is written into the scene's camera files. The photographs are always rendered with a pinhole:
/// rounds check that results are the same, not that they are accurate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    Pinhole,
    /// Radial distortion k₁, k₂.
    Radial([f64; 2]),
    /// k₁ to k₄ of the equidistant fisheye model.
    Fisheye([f64; 4]),
}

impl Lens {
    /// A random lens with distortion that the layout can express.
    pub fn draw(random: &mut Random, layout: Layout) -> Self {
        let mut small = || random.between(-0.1, 0.1);
        let (radial, fisheye) = ([small(), small()], [small(), small(), 0.0, 0.0]);
        if layout == Layout::Bundler || random.chance(0.5) {
            Self::Radial(radial)
        } else {
            Self::Fisheye(fisheye)
        }
    }
}

/// The file format of the scene's cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Layout {
    Mvsnet,
    Nerfstudio,
    Bundler,
    Colmap,
}

/// How the run is disturbed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Disturbance {
    /// kill -9 this many times, each at a random time.
    Killed(usize),
    /// SIGTERM at a random time.
    Terminated,
    /// SIGSTOP and, some time later, SIGCONT, this many times.
    Paused(usize),
    /// A disk with room for this share of the results.
    FullDisk(f64),
    /// A photograph that cannot be read.
    BadPhotograph,
    /// This many result files are truncated, emptied or removed after the run.
    DamagedResults(usize),
    /// A memory budget, bytes.
    Budget(u64),
    /// kill -9 of `vamvs synth`.
    SynthKilled,
}

/// The parameters of a round.
#[derive(Clone, Debug)]
pub struct Case {
    pub seed: u64,
    /// Width and height of the photographs, pixels.
    pub size: (usize, usize),
    /// Number of photographs.
    pub views: usize,
    pub layout: Layout,
    pub lens: Lens,
    /// Whether masks leave only the objects.
    pub masks: bool,
    /// Further flags of `vamvs reconstruct`.
    options: Vec<String>,
    pub disturbance: Disturbance,
}

impl Case {
    /// Draws the round of a seed.
    pub fn draw(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let layout = random.one_of(&[Layout::Mvsnet, Layout::Nerfstudio, Layout::Bundler, Layout::Colmap]);
        let distorted = layout != Layout::Mvsnet && random.chance(0.6);
        Self {
            seed,
            size: (64 + 4 * random.below(20), 48 + 4 * random.below(20)),
            views: 2 + random.below(5),
            layout,
            lens: if distorted { Lens::draw(&mut random, layout) } else { Lens::Pinhole },
            masks: random.chance(0.25),
            options: options(&mut random),
            disturbance: disturbance(&mut random),
        }
    }

    /// The generator of the random choices during the round, such as the times of signals.
    pub fn random(&self) -> Random {
        Random::new(self.seed ^ 0x5EED_0FD1_5755_4BA7)
    }

    /// The arguments of `vamvs` that reconstruct the scene into `out`.
    pub fn arguments(&self, scene: &[String], out: &Path) -> Vec<String> {
        let mut arguments = vec!["reconstruct".to_owned()];
        arguments.extend(scene.iter().cloned());
        arguments.extend(["--weights", "photometric", "--out"].map(str::to_owned));
        arguments.push(out.display().to_string());
        arguments.extend(self.options.iter().cloned());
        arguments
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (width, height) = self.size;
        write!(f, "{} views of {width}×{height}, {:?}, {:?}", self.views, self.layout, self.lens)?;
        write!(
            f,
            "{}, {}: {:?}",
            if self.masks { ", masks" } else { "" },
            self.options.join(" "),
            self.disturbance
        )
    }
}

fn options(random: &mut Random) -> Vec<String> {
    let mut options = Vec::new();
    let mut give = |texts: &[String]| options.extend(texts.iter().cloned());
    let text = |text: &str| text.to_owned();
    give(&[text("--planes"), (8 + random.below(17)).to_string()]);
    give(&[text("--threads"), (1 + random.below(2)).to_string()]);
    give(&[text("--min-views"), (1 + random.below(3)).to_string()]);
    if random.chance(0.5) {
        give(&["--confidence", "0", "--coarse-confidence", "0"].map(str::to_owned));
    }
    if random.chance(0.7) {
        give(&[
            text("--coarse-stride"),
            text("8"),
            text("--iterations"),
            random.one_of(&[text("1"), text("2")]),
        ]);
    }
    for (option, values) in [
        ("--views", &["2", "3", "4"][..]),
        ("--spacing", &["depth", "inverse-depth"]),
        ("--max-size", &["64", "80"]),
        ("--enlarge", &["1.5"]),
        ("--export", &["colmap", "openmvs", "colmap,openmvs"]),
        ("--depth-format", &["exr", "npy", "exr,png"]),
        ("--neighbours", &["1", "3"]),
    ] {
        if random.chance(0.25) {
            give(&[text(option), text(random.one_of(values))]);
        }
    }
    if random.chance(0.2) {
        give(&[text("--no-report")]);
    }
    options
}

fn disturbance(random: &mut Random) -> Disturbance {
    // Log-uniform from 1 MiB to 4 GiB.
    let budget = 2f64.powf(random.between(20.0, 32.0)) as u64;
    let several = 1 + random.below(3);
    let share = random.between(0.0, 1.1);
    random.one_of(&[
        Disturbance::Killed(several),
        Disturbance::Killed(several),
        Disturbance::Terminated,
        Disturbance::Paused(several),
        Disturbance::FullDisk(share),
        Disturbance::BadPhotograph,
        Disturbance::DamagedResults(several),
        Disturbance::Budget(budget),
        Disturbance::Budget(budget),
        Disturbance::SynthKilled,
    ])
}
