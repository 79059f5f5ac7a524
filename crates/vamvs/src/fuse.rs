//! From depth maps to one cloud, and what is exported with it.

mod parts;

use std::path::Path;
use std::time::{Duration, Instant};

use vamvs_fusion::{BoxError, FuseEvent, FuseJob, FuseReport, FusedPoints, MapSource, ViewReport};
use vamvs_io::atomic;

pub use parts::PartialFusion;

use crate::event::{OnEvent, tell};
use crate::export::Exporter;
use crate::memory::{KeptMemory, format_bytes};
use crate::output::{LeftOut, folder_of, is_same, remove_unfinished};
use crate::output::{Lock, is_claimed};
use crate::{Event, ExportOptions, FusionOptions, Maps, MemoryLimit, VamvsError, memory};

/// One part in this many of the memory is spare, for what is not counted: the program, and freed memory that was not
/// used again.
pub(crate) const SPARE: u64 = 3;

/// The result of a fusion.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct FuseSummary {
    /// Points written.
    pub points: u64,
    /// The views' names and what became of their pixels.
    pub views: Vec<(String, ViewReport)>,
    /// Time to fuse, including reading depth maps and writing the cloud.
    pub fusing: Duration,
    /// Time to write exports.
    pub exporting: Duration,
    /// Views that can have no point, because their depth maps cannot be read or too few other views
    /// see the same surfaces.
    pub skipped: Vec<LeftOut>,
}

impl FuseSummary {
    /// What became of all pixels.
    #[must_use]
    pub fn total(&self) -> ViewReport {
        self.views.iter().map(|(_, report)| *report).sum()
    }
}

/// Fuses depth maps into the PLY file `cloud`, and writes the `exports` next to it.
///
/// # Errors
/// If files are missing or malformed, `cloud` is a file but no PLY, or the cloud cannot be written: then an older cloud stays as
/// it is. If only an export cannot be written, the cloud is complete.
pub fn fuse(
    maps: &Maps,
    cloud: &Path,
    options: &FusionOptions,
    exports: &ExportOptions,
    on_event: &mut OnEvent<'_>,
) -> Result<FuseSummary, VamvsError> {
    options.validate()?;
    let options = &with_own_confidence(maps, options)?;
    let neighbours = maps.neighbours(options.neighbours);
    let run =
        |sink: &mut Sink<'_>, on_event: &mut OnEvent<'_>| merge(maps, &neighbours, options, sink, on_event);
    write_cloud((maps, &neighbours), cloud, (options, exports), run, on_event)
}

/// The options with the least confidence as the depth maps express it, if it is given as the network's probability.
pub(crate) fn with_own_confidence(maps: &Maps, options: &FusionOptions) -> Result<FusionOptions, VamvsError> {
    let mut options = options.clone();
    if std::mem::take(&mut options.network_confidence) {
        options.filter.min_confidence = maps.confidence_at(options.filter.min_confidence)?;
    }
    Ok(options)
}

/// Where fused points go.
type Sink<'a> = dyn FnMut(&FusedPoints) -> Result<(), BoxError> + 'a;

/// Writes the cloud that `run` makes of depth maps, and its exports.
fn write_cloud(
    (maps, neighbours): (&Maps, &[Vec<usize>]),
    cloud: &Path,
    (options, exports): (&FusionOptions, &ExportOptions),
    run: impl FnOnce(&mut Sink<'_>, &mut OnEvent<'_>) -> Result<FuseReport, VamvsError>,
    on_event: &mut OnEvent<'_>,
) -> Result<FuseSummary, VamvsError> {
    atomic::expect_kind(cloud, |begin| begin.starts_with(b"ply"))?;
    let _lock = lock(maps, cloud)?;
    let lone = views_without_neighbours(maps, neighbours, options.filter.min_views);
    lone.iter().try_for_each(|view| tell(on_event, Event::left_out(view)))?;
    let skipped = [maps.left_out(), &lone].concat();
    let mut exporter = Exporter::begin(maps, cloud, exports)?;
    let begin = Instant::now();
    let report = run(&mut |fused| Ok(exporter.push(fused)?), on_event)?;
    let (points, fusing) = (report.total().points, begin.elapsed());
    if points > 0 {
        exporter.finish(neighbours, options, on_event)?;
    }
    let views = maps.names().iter().cloned().zip(report.views).collect();
    Ok(FuseSummary { points, views, skipped, fusing, exporting: begin.elapsed() - fusing })
}

/// Keeps other runs from the folder of depth maps, if vamvs made them: from writing to it or, if the cloud goes there, from
/// using it at all. What a killed run has left there is removed then.
pub(crate) fn lock(maps: &Maps, cloud: &Path) -> Result<Option<Lock>, VamvsError> {
    let root = maps.root();
    if !is_claimed(root) {
        return Ok(None);
    }
    if !is_same(folder_of(cloud), root) {
        return Lock::shared(root).map(Some);
    }
    let lock = Lock::alone(root)?;
    remove_unfinished(root)?;
    Ok(Some(lock))
}

/// Fuses depth maps from anywhere; the points go to `sink`.
pub(crate) fn merge<S: MapSource + ?Sized>(
    source: &S,
    neighbours: &[Vec<usize>],
    options: &FusionOptions,
    sink: &mut Sink<'_>,
    on_event: &mut OnEvent<'_>,
) -> Result<FuseReport, VamvsError> {
    let (filter, roi, memory) = (&options.filter, options.roi, working_memory(options.max_memory));
    let job = FuseJob { source, neighbours, options: filter, roi, memory };
    let (mut done, total) = (0, 2 * source.len());
    let mut progress = |_: FuseEvent| {
        done += 1;
        on_event(Event::Fusion { done, total })
    };
    let _kept = KeptMemory::new();
    let report = vamvs_fusion::fuse(&job, sink, &mut progress)?;
    warn_of_memory(report.memory, memory, options.max_memory, on_event)?;
    Ok(report)
}

/// The memory for depth maps, bytes: what the limit leaves without the spare part.
pub(crate) fn working_memory(limit: MemoryLimit) -> usize {
    memory::give_back();
    let remaining = limit.remaining();
    (remaining - remaining / SPARE) as usize
}

/// The views with too few neighbours to confirm a point.
fn views_without_neighbours(maps: &Maps, neighbours: &[Vec<usize>], min_views: usize) -> Vec<LeftOut> {
    let counts = neighbours.iter().map(|others| maps.camera_centre_count(others));
    let lone = maps.names().iter().zip(counts).filter(|(_, others)| others + 1 < min_views);
    let reason = |count| {
        format!(
            "{count} other view(s) see the same surfaces, and {min_views} must agree on a point, its own included (--min-views)"
        )
    };
    lone.map(|(name, others)| LeftOut { view: name.clone(), reason: reason(others) }).collect()
}

/// Warns if fusion took more memory than the `given` [`working_memory`] and the spare part.
fn warn_of_memory(
    taken: u64,
    given: usize,
    limit: MemoryLimit,
    on_event: &mut OnEvent<'_>,
) -> Result<(), VamvsError> {
    let given = (given + given / (SPARE as usize - 1)) as u64;
    if taken > given {
        let text = format!(
            "fusion took {} more than the limit of {limit}: a depth map and its neighbours must be in memory at the same time (--max-memory, --neighbours)",
            format_bytes(taken - given)
        );
        tell(on_event, Event::Warning(text))?;
    }
    Ok(())
}
