//! Finds the photographs that a scene's file names by path, and the folder that contains them all.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use vamvs_core::{Scene, SparsePoint, View};

use crate::image::EXTENSIONS;
use crate::{IoError, Place, folder, names};

/// Photographs that were found.
#[derive(Debug)]
pub(crate) struct Located {
    /// The folder that the names are relative to.
    pub(crate) folder: PathBuf,
    /// The path of each photograph relative to the folder, with `/` between folders.
    pub(crate) names: Vec<String>,
    /// Warnings about photographs that are missing or have nearly the wanted names.
    pub(crate) warnings: Vec<String>,
}

/// Finds the photographs that the scene file `file` names, with or without their extension.
///
/// If `images` is given, each photograph is looked up there, first under its whole path, then under its file
/// name alone. Without `images`, the paths are relative to the scene file's folder. If none is there, the only one of nearly the
/// same name is taken, with a warning. A photograph that is missing all the same keeps its name, with a warning; its view is left out
/// later. Fails if half of them are missing, or one is named twice.
pub(crate) fn locate(file: &Path, named: &[String], images: Option<&Path>) -> Result<Located, IoError> {
    let beside = file.parent().unwrap_or(Path::new(""));
    let find = |name: &String| match images {
        Some(images) => find_inside(images, name),
        None => with_extension(beside.join(slashes(name))),
    };
    let mut found: Vec<Option<PathBuf>> = named.iter().map(find).collect();
    let mut taken: BTreeSet<PathBuf> = found.iter().flatten().map(|path| normalised(path)).collect();
    let mut renamed = Vec::new();
    for (name, path) in named.iter().zip(&mut found).filter(|(_, path)| path.is_none()) {
        let inside = images.map_or_else(|| parent(&beside.join(slashes(name))), Path::to_owned);
        *path = near(&inside, name, images.is_some())?.filter(|path| taken.insert(normalised(path)));
        renamed.extend(path.as_ref().map(|path| (name.clone(), path.display().to_string())));
    }
    let missing = named.iter().zip(&found).filter(|(_, path)| path.is_none());
    let missing: Vec<&str> = missing.map(|(name, _)| name.as_str()).collect();
    let mut warnings: Vec<String> =
        folder::warn_of_those_missing(images.unwrap_or(beside), &missing, named.len())?.into_iter().collect();
    warnings.extend(names::warn_of_renamed(images.unwrap_or(beside), &renamed));
    let paths: Vec<Option<PathBuf>> =
        found.into_iter().map(|path| path.map(|path| normalised(&path))).collect();
    let common = match images {
        Some(images) => normalised(images),
        None => common_folder(paths.iter().flatten()),
    };
    let name = |(path, named): (&Option<PathBuf>, &String)| match path {
        Some(path) => name_in(&common, path),
        // Under its whole path, so that it is not taken for another photograph of the same name.
        None => {
            let path = normalised(&images.unwrap_or(beside).join(slashes(named)));
            name_in(&common, &path).or_else(|| inside(Path::new(&slashes(named))))
        }
    };
    let names: Vec<String> = paths.iter().zip(named).filter_map(name).collect();
    check(file, named, &names)?;
    Ok(Located { folder: common, names, warnings })
}

fn parent(path: &Path) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).to_owned()
}

/// The only file in `folder` that `name` nearly names; without `below` only the last part of the name counts.
fn near(folder: &Path, name: &str, below: bool) -> Result<Option<PathBuf>, IoError> {
    if !folder.is_dir() {
        return Ok(None);
    }
    let name = slashes(name);
    let name = if below { name.as_str() } else { name.rsplit('/').next().unwrap_or_default() };
    let found = folder::images(folder)?;
    Ok(names::near(&found, name).map(|found| folder.join(found)))
}

/// The scene of `views` and `points`, with the views sorted by name and numbered in that order.
///
/// On entry the points' `views` are indices into `views` as given; they are renumbered.
pub(crate) fn sorted_by_name(views: Vec<View>, points: Vec<SparsePoint>) -> Scene {
    let mut order: Vec<usize> = (0..views.len()).collect();
    order.sort_by(|&a, &b| views[a].name.cmp(&views[b].name));
    let mut place = vec![0; views.len()];
    order.iter().enumerate().for_each(|(sorted, &view)| place[view] = sorted);
    let renumbered = |mut point: SparsePoint| {
        point.views.iter_mut().for_each(|view| *view = place[*view]);
        point.views.sort_unstable();
        point.views.dedup();
        point
    };
    let points = points.into_iter().map(renumbered).collect();
    let mut views: Vec<(usize, View)> = place.iter().copied().zip(views).collect();
    views.sort_by_key(|(sorted, _)| *sorted);
    let numbered = |(id, view): (usize, View)| View { id: id as u32, ..view };
    Scene { views: views.into_iter().map(numbered).collect(), points, pairs: None }
}

/// For each entry, its index among those that are there.
pub(crate) fn places<T>(entries: &[Option<T>]) -> Vec<Option<usize>> {
    let mut indices = 0..;
    entries.iter().map(|entry| entry.as_ref().and_then(|_| indices.next())).collect()
}

/// The points, with their views numbered by `places`; views that have none are left out.
pub(crate) fn renumbered(mut points: Vec<SparsePoint>, places: &[Option<usize>]) -> Vec<SparsePoint> {
    for point in &mut points {
        point.views = point.views.iter().filter_map(|&view| places[view]).collect();
    }
    points
}

/// The path with `/` for the backslashes of Windows programs.
fn slashes(name: &str) -> String {
    name.replace('\\', "/")
}

fn find_inside(images: &Path, name: &str) -> Option<PathBuf> {
    let name = slashes(name);
    let whole = name.trim_start_matches("./");
    let last = Path::new(whole).file_name()?.to_str()?;
    let candidates = [whole, last].into_iter().filter(|name| folder::is_inside(name));
    candidates.map(|name| images.join(name)).find_map(with_extension)
}

/// The path if it is a file, else the first file whose name is this one plus an image extension.
fn with_extension(path: PathBuf) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path);
    }
    let name = path.file_name()?.to_str()?;
    let upper = |extension: &str| extension.to_uppercase();
    let extensions = EXTENSIONS.iter().flat_map(|extension| [(*extension).to_owned(), upper(extension)]);
    extensions.map(|extension| path.with_file_name(format!("{name}.{extension}"))).find(|path| path.is_file())
}

/// The path without `.` and `..`, which are resolved by text alone: links are not followed.
fn normalised(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if matches!(normal.components().next_back(), Some(Component::Normal(_))) => {
                normal.pop();
            }
            part => normal.push(part),
        }
    }
    normal
}

/// The deepest folder that contains all files.
fn common_folder<'a>(files: impl Iterator<Item = &'a PathBuf>) -> PathBuf {
    let mut folders = files.filter_map(|file| file.parent());
    let Some(first) = folders.next() else { return PathBuf::new() };
    let shared = |a: &Path, b: &Path| a.components().zip(b.components()).take_while(|(a, b)| a == b).count();
    let depth = folders.map(|folder| shared(first, folder)).min();
    first.components().take(depth.unwrap_or(usize::MAX)).collect()
}

fn name_in(folder: &Path, file: &Path) -> Option<String> {
    inside(file.strip_prefix(folder).ok()?)
}

/// The path without what leads out of a folder.
fn inside(path: &Path) -> Option<String> {
    let parts = path.components().filter(|part| matches!(part, Component::Normal(_)));
    parts.map(|part| part.as_os_str().to_str()).collect::<Option<Vec<_>>>().map(|parts| parts.join("/"))
}

/// Refuses photographs that are named twice or have names that are not UTF-8.
fn check(file: &Path, named: &[String], names: &[String]) -> Result<(), IoError> {
    if names.len() != named.len() {
        let problem = "expected photographs with UTF-8 paths below one folder, found others";
        return Err(IoError::unsupported(file, Place::Whole, problem));
    }
    let mut seen = BTreeMap::new();
    for (name, path) in names.iter().zip(named) {
        if let Some(other) = seen.insert(name, path) {
            let problem = format!(
                "expected a photograph of its own for each name, found {name} for both {other:?} and {path:?}: keep photographs of one name in their subfolders, or name each once"
            );
            return Err(IoError::malformed(file, Place::Whole, problem));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder_of(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            crate::atomic::write(&path, |_| Ok(())).unwrap();
        }
        folder
    }

    fn owned(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn names_are_relative_to_the_folder_that_all_have_in_common() {
        let scene = folder_of(&["run/images/a/1.jpg", "run/images/b/2.PNG", "run/x/scene.json"]);
        let file = scene.path().join("run/x/scene.json");
        let absolute = scene.path().join("run/images/b/2.PNG").to_str().unwrap().to_owned();
        let mut named = owned(&["../images/./a/1.jpg"]);
        named.push(absolute);
        let found = locate(&file, &named, None).unwrap();
        assert_eq!(found.folder, scene.path().join("run/images"));
        assert_eq!(found.names, ["a/1.jpg", "b/2.PNG"]);
        let one = locate(&file, &owned(&["..\\images\\a\\1"]), None).unwrap();
        assert_eq!((one.folder, one.names), (scene.path().join("run/images/a"), owned(&["1.jpg"])));
    }

    #[test]
    fn a_folder_of_images_wins_and_the_last_part_of_a_path_suffices() {
        let scene = folder_of(&["photos/a/1.jpg", "photos/2.jpg"]);
        let named = owned(&["./a/1.jpg", "C:\\old\\2.jpg"]);
        let photos = scene.path().join("photos");
        let found = locate(Path::new("elsewhere/list"), &named, Some(&photos)).unwrap();
        assert_eq!((found.folder, found.names), (photos, owned(&["a/1.jpg", "2.jpg"])));
    }

    #[test]
    fn missing_and_repeated_photographs_are_named() {
        let scene = folder_of(&["1.jpg", "list"]);
        let error =
            |named: &[&str]| locate(&scene.path().join("list"), &owned(named), None).unwrap_err().to_string();
        assert!(error(&["1.jpg", "9.jpg"]).contains("9.jpg"));
        let scene = folder_of(&["1.jpg", "2.jpg", "P\u{200b}3.JPG", "list"]);
        let found =
            locate(&scene.path().join("list"), &owned(&["1.jpg", "2.jpg", "a/9.jpg", "p3.jpg"]), None)
                .unwrap();
        assert_eq!(found.names, ["1.jpg", "2.jpg", "a/9.jpg", "P\u{200b}3.JPG"]);
        let said = found.warnings.join("; ");
        assert!(
            said.contains("a/9.jpg") && said.contains("p3.jpg is ") && said.contains("u{200b}3.JPG"),
            "{said}"
        );
        let scene = folder_of(&["photos/1.jpg", "photos/2.jpg", "photos/list"]);
        let photos = scene.path().join("photos");
        for images in [None, Some(photos.as_path())] {
            let named = owned(&["1.jpg", "2.jpg", "../../elsewhere/9.jpg"]);
            let found = locate(&photos.join("list"), &named, images).unwrap();
            assert_eq!(found.names, ["1.jpg", "2.jpg", "elsewhere/9.jpg"], "a name inside the folder");
        }
        let scene = folder_of(&["1.jpg", "list"]);
        let error =
            |named: &[&str]| locate(&scene.path().join("list"), &owned(named), None).unwrap_err().to_string();
        assert!(error(&["1.jpg", "./1"]).contains("found 1.jpg for both"));
        // Photographs of one name in two folders, of which one is missing.
        let scene = folder_of(&["photos/a/1.jpg", "photos/a/2.jpg", "photos/b/2.jpg"]);
        let named = owned(&["a/1.jpg", "a/2.jpg", "b/1.jpg", "b/2.jpg"]);
        let photos = scene.path().join("photos");
        for (file, images) in [("list", Some(photos.as_path())), ("photos/list", None)] {
            let found = locate(&scene.path().join(file), &named, images).unwrap();
            assert_eq!(found.names, named, "{images:?}");
            assert!(
                found.warnings.len() == 1 && found.warnings[0].contains("b/1.jpg"),
                "{:?}",
                found.warnings
            );
        }
    }

    #[test]
    fn sorting_by_name_moves_the_tracks_along() {
        let view = |name: &str| View {
            id: 7,
            name: name.to_owned(),
            camera: vamvs_core::Pinhole {
                size: vamvs_core::Size::new(1, 1),
                intrinsics: vamvs_core::Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5 },
            }
            .into(),
            cam_from_world: vamvs_core::Pose::identity(),
            depth_range: None,
        };
        let point = SparsePoint { x_in_world: nalgebra::Vector3::zeros(), views: vec![0, 2, 0] };
        let scene = sorted_by_name(vec![view("c"), view("a"), view("b")], vec![point]);
        let names: Vec<_> = scene.views.iter().map(|view| (view.id, view.name.as_str())).collect();
        assert_eq!(names, [(0, "a"), (1, "b"), (2, "c")]);
        assert_eq!(scene.points[0].views, [1, 2]);
    }
}
