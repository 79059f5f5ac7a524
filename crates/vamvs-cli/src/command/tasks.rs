//! `vamvs tasks`: a reconstruction as a graph of commands.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::Serialize;
use vamvs::core::Part;
use vamvs::depth::{DepthJob, DepthStep, record_file};
use vamvs::{MemoryLimit, OutputFolder, PartialFusion, PartialMesh, Prepared};

use super::depth;
use crate::arguments::TasksArguments;
use crate::progress::Progress;
use crate::settings::Settings;

/// A command that does a part of a reconstruction.
#[derive(Serialize)]
struct Task {
    id: String,
    argv: Vec<String>,
    /// Files that must be there before: photographs, or outputs of the tasks it depends on.
    inputs: Vec<PathBuf>,
    /// Files that are there when it is done, and only then.
    outputs: Vec<PathBuf>,
    /// The ids of tasks that must be done first.
    dependencies: Vec<String>,
    cores: usize,
    /// Bytes.
    memory: u64,
    /// Whether it runs on a GPU.
    gpu: bool,
}

/// Runs the command.
pub fn run(arguments: &TasksArguments) -> Result<()> {
    let reconstruct = &arguments.reconstruct;
    if reconstruct.depth.force {
        bail!(
            "--force: tasks do what is not done; to do all of it again, choose another --out or remove the old folder"
        );
    }
    let mut settings = depth::settings(&reconstruct.depth)?.absolute()?;
    settings.apply_fusion(&reconstruct.fusion);
    settings.apply_export(&reconstruct.export);
    settings.fusion.validate()?;
    settings.export.validate()?;
    // Memory differs between machines, but depth maps must not.
    let memory = MemoryLimit::Bytes(settings.depth.max_memory.bytes());
    (settings.depth.max_memory, settings.fusion.max_memory) = (memory, memory);
    let progress = Progress::of(&reconstruct.depth.common);
    let out = std::path::absolute(reconstruct.depth.out()).context("--out")?;
    let output = OutputFolder::new(&out);
    let work = depth::prepared(&settings, &output, (&reconstruct.depth.common, &progress))?;
    let job = DepthJob { work: &work, output: &output, force: false };
    depth::begin(&job, &settings)?;
    progress.finish();
    let parts = work.scene.views.len().div_ceil(arguments.batch.get());
    let graph = Graph {
        work: &work,
        output: &output,
        out: &out,
        settings: &settings,
        report: !reconstruct.no_report,
        mesh: reconstruct.mesh,
        strict: reconstruct.depth.common.strict,
        parts,
    };
    for task in graph.tasks()? {
        say!("{}", serde_json::to_string(&task)?);
    }
    Ok(())
}

/// What the tasks are made of.
struct Graph<'a> {
    work: &'a Prepared,
    output: &'a OutputFolder,
    out: &'a Path,
    settings: &'a Settings,
    report: bool,
    mesh: bool,
    /// Whether views that are left out are an error.
    strict: bool,
    parts: usize,
}

impl Graph<'_> {
    /// All tasks, each after those it depends on.
    fn tasks(&self) -> Result<Vec<Task>> {
        let parts = self.work.parts(self.parts)?;
        let part_of: BTreeMap<usize, usize> = parts
            .iter()
            .enumerate()
            .flat_map(|(index, (_, views))| views.iter().map(move |&view| (view, index)))
            .collect();
        let mut tasks = Vec::new();
        tasks.extend(parts.iter().map(|(part, own)| self.photometric(*part, own)));
        if self.work.steps().contains(&DepthStep::Geometric) {
            for (part, own) in &parts {
                let needed = self.with_sources(own).iter().map(|view| part_of[view]).collect();
                tasks.push(self.geometric(*part, &needed));
            }
        }
        tasks.push(self.collect());
        tasks.extend(Part::all(self.parts).map(|part| self.confirm(part)));
        tasks.extend(Part::all(self.parts).map(|part| self.merge(part)));
        if self.mesh {
            tasks.extend(Part::all(self.parts).map(|part| self.outline(part)));
            tasks.extend(Part::all(self.parts).map(|part| self.surface(part)));
            tasks.push(self.join());
        }
        tasks.push(self.concatenate());
        Ok(tasks)
    }

    fn photometric(&self, part: Part, own: &BTreeSet<usize>) -> Task {
        let photograph = |view: &usize| {
            self.work.photographs.folder().map(|folder| folder.join(self.work.scene.views[*view].file()))
        };
        let sources = self.with_sources(own);
        // The views of photographs that are missing will be left out.
        let mut inputs: Vec<_> =
            sources.iter().filter_map(photograph).filter(|path| path.is_file()).collect();
        // Views that are cut out of one photograph follow each other.
        inputs.dedup();
        Task { inputs, ..self.depth_step(DepthStep::Photometric, part) }
    }

    fn geometric(&self, part: Part, needed: &BTreeSet<usize>) -> Task {
        let needed = || Part::all(self.parts).enumerate().filter(|(index, _)| needed.contains(index));
        Task {
            inputs: needed()
                .map(|(_, part)| record_file(self.output, DepthStep::Photometric, part))
                .collect(),
            dependencies: needed().map(|(_, part)| depth_id(DepthStep::Photometric, part)).collect(),
            ..self.depth_step(DepthStep::Geometric, part)
        }
    }

    fn depth_step(&self, step: DepthStep, part: Part) -> Task {
        let flags = step_of(&step.to_string(), part);
        Task {
            outputs: vec![record_file(self.output, step, part)],
            ..self.depth_task(depth_id(step, part), self.depth_command(flags))
        }
    }

    /// A task of depth maps. Only the network uses a GPU, but hashes of depth maps tell whether one was used, and all tasks
    /// must compute the same ones.
    fn depth_task(&self, id: String, argv: Vec<String>) -> Task {
        Task { gpu: self.work.method.is_on_gpu(), ..self.task(id, argv) }
    }

    fn collect(&self) -> Task {
        let last = self.work.steps().last().copied().unwrap_or(DepthStep::Photometric);
        let flags = self.step_for_all("collect");
        Task {
            inputs: Part::all(self.parts).map(|part| record_file(self.output, last, part)).collect(),
            outputs: vec![self.output.pairs()],
            dependencies: Part::all(self.parts).map(|part| depth_id(last, part)).collect(),
            ..self.depth_task("collect".to_owned(), self.if_strict(self.depth_command(flags)))
        }
    }

    fn confirm(&self, part: Part) -> Task {
        let flags = step_of("confirm", part);
        Task {
            inputs: vec![self.output.pairs()],
            outputs: vec![PartialFusion::confirmed_file(self.out, part)],
            dependencies: vec!["collect".to_owned()],
            ..self.task(fusion_id("confirm", part), self.output_command("fuse", flags))
        }
    }

    fn merge(&self, part: Part) -> Task {
        let flags = step_of("merge", part);
        Task {
            inputs: self.files(PartialFusion::confirmed_file),
            outputs: vec![PartialFusion::merged_file(self.out, part)],
            dependencies: self.ids("confirm"),
            ..self.task(fusion_id("merge", part), self.output_command("fuse", flags))
        }
    }

    fn outline(&self, part: Part) -> Task {
        let flags = step_of("outline", part);
        Task {
            inputs: vec![PartialFusion::confirmed_file(self.out, part)],
            outputs: vec![PartialMesh::outlines_file(self.out, part)],
            dependencies: vec![fusion_id("confirm", part)],
            ..self.task(fusion_id("outline", part), self.output_command("mesh", flags))
        }
    }

    fn surface(&self, part: Part) -> Task {
        let flags = step_of("surface", part);
        Task {
            inputs: self.files(PartialMesh::outlines_file),
            outputs: vec![PartialMesh::surfaces_file(self.out, part)],
            dependencies: self.ids("outline"),
            ..self.task(fusion_id("surface", part), self.output_command("mesh", flags))
        }
    }

    fn join(&self) -> Task {
        let flags = self.step_for_all("join");
        Task {
            inputs: self.files(PartialMesh::surfaces_file),
            outputs: vec![self.mesh_file()],
            dependencies: self.ids("surface"),
            ..self.task("join".to_owned(), self.output_command("mesh", flags))
        }
    }

    fn mesh_file(&self) -> PathBuf {
        self.out.join("mesh.ply")
    }

    /// It removes the confirmed pixels, which the mesh needs too.
    fn concatenate(&self) -> Task {
        let flags = self.step_for_all("concatenate");
        let mut argv = self.output_command("fuse", flags);
        argv.extend((!self.report).then(|| "--no-report".to_owned()));
        let (mut inputs, mut dependencies) = (self.files(PartialFusion::merged_file), self.ids("merge"));
        if self.mesh {
            inputs.push(self.mesh_file());
            dependencies.push("join".to_owned());
        }
        Task {
            inputs,
            outputs: vec![self.output.cloud()],
            dependencies,
            ..self.task("concatenate".to_owned(), argv)
        }
    }

    /// The files that all parts of a step leave.
    fn files(&self, of_part: impl Fn(&Path, Part) -> PathBuf) -> Vec<PathBuf> {
        Part::all(self.parts).map(|part| of_part(self.out, part)).collect()
    }

    /// The ids of all parts of a step of fusion or meshing.
    fn ids(&self, step: &str) -> Vec<String> {
        Part::all(self.parts).map(|part| fusion_id(step, part)).collect()
    }

    fn step_for_all(&self, step: &str) -> [String; 4] {
        ["--step", step, "--parts", &self.parts.to_string()].map(str::to_owned)
    }

    /// A task that depends on nothing.
    fn task(&self, id: String, argv: Vec<String>) -> Task {
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        Task {
            id,
            argv,
            inputs: Vec::new(),
            outputs: Vec::new(),
            dependencies: Vec::new(),
            cores: self.settings.threads.unwrap_or(all),
            memory: self.settings.depth.max_memory.bytes(),
            gpu: false,
        }
    }

    fn depth_command(&self, flags: [String; 4]) -> Vec<String> {
        self.command(["vamvs", "depth"].map(str::to_owned).to_vec(), flags)
    }

    /// A command on the output folder.
    fn output_command(&self, name: &str, flags: [String; 4]) -> Vec<String> {
        let start = vec!["vamvs".to_owned(), name.to_owned(), path_text(self.out)];
        self.if_strict(self.command(start, flags))
    }

    fn command(&self, start: Vec<String>, flags: [String; 4]) -> Vec<String> {
        let config = ["--quiet".to_owned(), "--config".to_owned(), path_text(&self.out.join("run.toml"))];
        start.into_iter().chain(config).chain(flags).collect()
    }

    /// A command that ends with an error if views are left out, if that is asked for.
    fn if_strict(&self, mut argv: Vec<String>) -> Vec<String> {
        argv.extend(self.strict.then(|| "--strict".to_owned()));
        argv
    }

    /// The views and their source views.
    fn with_sources(&self, views: &BTreeSet<usize>) -> BTreeSet<usize> {
        let plans = |view: &usize| self.work.plan.views[*view].as_ref().ok();
        let sources = views.iter().filter_map(plans).flat_map(|plan| plan.sources.iter().copied());
        sources.chain(views.iter().copied()).collect()
    }
}

fn step_of(step: &str, part: Part) -> [String; 4] {
    ["--step", step, "--part", &part.to_string()].map(str::to_owned)
}

fn depth_id(step: DepthStep, part: Part) -> String {
    format!("{step}-{}", numbered(part))
}

fn fusion_id(step: &str, part: Part) -> String {
    format!("{step}-{}", numbered(part))
}

/// A part as text without `/`, for ids.
fn numbered(part: Part) -> String {
    part.to_string().replace('/', "-of-")
}

fn path_text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
