//! Checkpoints: folders with everything that the next step depends on. A folder is renamed to its final name only when
//! it is complete.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tch::{Kind, Tensor};
use vamvs_io::{IoError, atomic};
use vamvs_net::{Device, Network};

use crate::TrainError;
use crate::optimizer::Optimizer;
use crate::options::{TrainOptions, Validation};

/// Number of checkpoints that are kept.
const KEPT: usize = 3;

const MODULE: &str = "module.pt";
const OPTIMIZER: &str = "optimizer.safetensors";
const STATE: &str = "state.json";

/// The state of a run, apart from the network and the optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Steps done. Together with the seed and the batch size this is the position in the sequence of samples.
    pub step: usize,
    /// The hash of the network that the run began with.
    pub network: String,
    /// The options that the run began with.
    pub options: TrainOptions,
    /// The names of the training scenes.
    pub scenes: Vec<String>,
    /// The names of the validation scenes, and the options of validation.
    pub measured: (Vec<String>, Validation),
    /// The lowest outlier rate so far (see [`crate::Scores::outliers`]).
    pub best: Option<f64>,
}

/// The checkpoints of a run.
pub struct Checkpoints {
    folder: PathBuf,
}

impl Checkpoints {
    /// The checkpoints in the folder `checkpoints` of a run's folder.
    #[must_use]
    pub fn of(run: &Path) -> Self {
        Self { folder: run.join("checkpoints") }
    }

    /// The folder of the last checkpoint, if there is one.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn last(&self) -> Result<Option<PathBuf>, TrainError> {
        Ok(self.all()?.pop())
    }

    /// The folders of all complete checkpoints, in the order of their steps.
    fn all(&self) -> Result<Vec<PathBuf>, TrainError> {
        if !self.folder.is_dir() {
            return Ok(Vec::new());
        }
        let mut found = Vec::new();
        for entry in fs::read_dir(&self.folder).map_err(|source| system("list", &self.folder, source))? {
            let path = entry.map_err(|source| system("list", &self.folder, source))?.path();
            let step = path.file_name().and_then(|name| name.to_str()?.strip_prefix("step-"));
            if step.is_some_and(|step| step.bytes().all(|byte| byte.is_ascii_digit())) {
                found.push(path);
            }
        }
        found.sort();
        Ok(found)
    }

    /// Writes a checkpoint and then removes the oldest ones, so that three are left. Returns its folder.
    ///
    /// # Errors
    /// If a file cannot be written; earlier checkpoints then stay as they were.
    pub fn save(
        &self,
        network: &Network,
        optimizer: &Optimizer,
        state: &State,
    ) -> Result<PathBuf, TrainError> {
        let folder = self.folder.join(format!("step-{:08}", state.step));
        let unfinished = self.folder.join("unfinished");
        if unfinished.exists() {
            fs::remove_dir_all(&unfinished).map_err(|source| system("remove", &unfinished, source))?;
        }
        fs::create_dir_all(&unfinished).map_err(|source| system("make the folder", &unfinished, source))?;
        network.save(&unfinished.join(MODULE))?;
        Tensor::write_safetensors(&optimizer.state(), unfinished.join(OPTIMIZER))?;
        write_json(&unfinished.join(STATE), state)?;
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(|source| system("remove", &folder, source))?;
        }
        fs::rename(&unfinished, &folder).map_err(|source| system("rename", &unfinished, source))?;
        let all = self.all()?;
        for old in &all[..all.len().saturating_sub(KEPT)] {
            fs::remove_dir_all(old).map_err(|source| system("remove", old, source))?;
        }
        Ok(folder)
    }
}

/// A hash of a network's manifest and trainable parameters, by which runs are told apart.
///
/// # Errors
/// If the module does not list its parameters.
pub fn hash(network: &Network) -> Result<String, TrainError> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(serde_json::to_string(network.manifest()).expect("a manifest is plain data").as_bytes());
    for (name, value) in network.parameters()? {
        let value = Vec::<f32>::try_from(value.f_to_kind(Kind::Float)?.f_flatten(0, -1)?)?;
        hasher.update(name.as_bytes());
        let bytes: Vec<u8> = value.iter().flat_map(|value| value.to_le_bytes()).collect();
        hasher.update(&bytes);
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Loads the network of a checkpoint.
///
/// # Errors
/// If the folder is not a complete checkpoint.
pub fn load_network(folder: &Path, device: Device) -> Result<Network, TrainError> {
    Ok(Network::load(&folder.join(MODULE), device)?)
}

/// Loads the rest of a checkpoint: restores the optimiser's state and returns the run's.
///
/// # Errors
/// If the folder is not a complete checkpoint of this network.
pub fn load_state(folder: &Path, optimizer: &mut Optimizer) -> Result<State, TrainError> {
    let tensors = Tensor::read_safetensors(folder.join(OPTIMIZER))?;
    optimizer.set_state(&tensors).map_err(|problem| TrainError::Run {
        folder: folder.to_owned(),
        problem: format!("{OPTIMIZER} belongs to another network: {problem}"),
    })?;
    let path = folder.join(STATE);
    let text = fs::read_to_string(&path).map_err(|source| system("read", &path, source))?;
    serde_json::from_str(&text).map_err(|error| TrainError::Run {
        folder: folder.to_owned(),
        problem: format!("{STATE} is not the state of a run of this version: {error}"),
    })
}

/// Writes indented JSON.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), TrainError> {
    let text = serde_json::to_string_pretty(value).expect("the value is plain data");
    Ok(atomic::write(path, |out| writeln!(out, "{text}"))?)
}

pub(crate) fn system(action: &'static str, path: &Path, source: std::io::Error) -> TrainError {
    TrainError::Io(IoError::System { action, path: path.to_owned(), source })
}
