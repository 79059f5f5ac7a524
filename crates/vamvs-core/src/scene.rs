//! A set of photographs with known cameras, as read from a scene's files.

use std::collections::HashSet;
use std::ops::RangeInclusive;

use nalgebra::Vector3;

use crate::{Camera, DepthRange, Pose};

/// Largest coordinate of a camera, scene units. Farther off, double precision leaves nothing for a scene's details.
const FARTHEST: f64 = 1e12;

/// One photograph's name, camera and pose.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The view's number in the scene's files (COLMAP image id, MVSNet view number).
    pub id: u32,
    /// The image file's path relative to the image folder, with `/` between folders; of a face, with the face's name in it (see
    /// [`View::file`]).
    pub name: String,
    /// The camera as calibrated, lens distortion included.
    pub camera: Camera,
    /// The pose.
    pub cam_from_world: Pose,
    /// The depth range that the scene's files give for this view.
    pub depth_range: Option<DepthRange>,
}

/// A triangulated point and the views that saw it.
#[derive(Clone, Debug, PartialEq)]
pub struct SparsePoint {
    /// Position.
    pub x_in_world: Vector3<f64>,
    /// Indices into [`Scene::views`], each once.
    pub views: Vec<usize>,
}

/// A source view of some reference view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Index into [`Scene::views`].
    pub view: usize,
    /// How much the source view helps, higher is better. Only the ratios of scores of the same reference
    /// view have a meaning.
    pub score: f64,
}

/// Photographs with known cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The views.
    pub views: Vec<View>,
    /// Triangulated points; empty if the scene's files have none.
    pub points: Vec<SparsePoint>,
    /// For each view, its source views, best first; `None` if the scene's files do not list them.
    pub pairs: Option<Vec<Vec<Source>>>,
}

/// Why a scene contradicts itself.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A view is invalid.
    #[error("view {view}{}: {problem}", in_brackets(.name))]
    View {
        /// Its index.
        view: usize,
        /// Its name.
        name: String,
        /// What is wrong.
        problem: String,
    },
    /// A sparse point is invalid.
    #[error("point {point}: {problem}")]
    Point {
        /// Its index.
        point: usize,
        /// What is wrong.
        problem: String,
    },
    /// There is not one list of source views for each view.
    #[error("expected source views for each of the {expected} views, got lists for {found}")]
    Pairs {
        /// Number of views.
        expected: usize,
        /// Number of lists.
        found: usize,
    },
}

fn in_brackets(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!(" ({name})") }
}

impl Scene {
    /// Checks what the types leave open: names, focal lengths, poses, depth ranges, and all indices of views.
    ///
    /// # Errors
    /// If a view has no name, a focal length or a position that is not plausible, numbers that are not finite, or an
    /// invalid depth range; if a point or a pair names a view that does not exist; if a list of source views holds the view itself, another one
    /// twice, or a score that is negative or not finite.
    pub fn validate(&self) -> Result<(), SceneError> {
        for (view, content) in self.views.iter().enumerate() {
            content.problem().map_or(Ok(()), |problem| Err(self.error_of(view, problem)))?;
        }
        for (point, SparsePoint { x_in_world, views }) in self.points.iter().enumerate() {
            let problem = if let Some(view) = views.iter().find(|&&view| view >= self.views.len()) {
                format!("expected views below {}, got {view}", self.views.len())
            } else if !x_in_world.iter().all(|value| value.is_finite()) {
                format!("expected a finite position, got {:?}", x_in_world.as_slice())
            } else {
                continue;
            };
            return Err(SceneError::Point { point, problem });
        }
        let Some(pairs) = &self.pairs else { return Ok(()) };
        if pairs.len() != self.views.len() {
            return Err(SceneError::Pairs { expected: self.views.len(), found: pairs.len() });
        }
        for (view, sources) in pairs.iter().enumerate() {
            let mut taken = HashSet::from([view]);
            for &Source { view: source, score } in sources {
                if source >= self.views.len() || !taken.insert(source) {
                    let problem = format!(
                        "expected other views below {} as its sources, each once, got {source}",
                        self.views.len()
                    );
                    return Err(self.error_of(view, problem));
                }
                if !(score.is_finite() && score >= 0.0) {
                    let problem = format!("expected scores of at least 0, got {score} for view {source}");
                    return Err(self.error_of(view, problem));
                }
            }
        }
        Ok(())
    }

    fn error_of(&self, view: usize, problem: String) -> SceneError {
        SceneError::View { view, name: self.views[view].name.clone(), problem }
    }
}

impl View {
    fn problem(&self) -> Option<String> {
        let k = &self.camera.intrinsics;
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let pose = &self.cam_from_world;
        if self.name.is_empty() {
            Some("expected a name, got none".to_owned())
        } else if !(positive(k.fx) && positive(k.fy) && k.cx.is_finite() && k.cy.is_finite()) {
            Some(format!("expected positive focal lengths and a finite principal point, got {k:?}"))
        } else if !pose.rotation.iter().chain(&pose.translation).all(|value| value.is_finite()) {
            Some("expected a finite pose".to_owned())
        } else if pose.centre().amax() > FARTHEST {
            let centre = pose.centre();
            Some(format!("expected a camera within {FARTHEST:e} of the origin, got {:?}", centre.as_slice()))
        } else if ![k.fx, k.fy].iter().all(|focal| self.plausible_focal_lengths().contains(focal)) {
            Some(format!(
                "expected focal lengths in pixels, 0.01 to 1000 times the longer side of {}, got fx {}, fy {}",
                self.camera.size, k.fx, k.fy
            ))
        } else {
            let DepthRange { near, far } = self.depth_range?;
            DepthRange::try_new(near, far).err().map(|error| error.to_string())
        }
    }

    /// From fields of view of nearly 180° to those of less than 0.1°: whoever means other units than pixels is beyond.
    fn plausible_focal_lengths(&self) -> RangeInclusive<f64> {
        let longer = self.camera.size.longer_side() as f64;
        0.01 * longer..=1000.0 * longer
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Intrinsics, Lens, Size};

    fn scene() -> Scene {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 32.0, cy: 24.0 };
        let camera = Camera { size: Size::new(64, 48), intrinsics, lens: Lens::None };
        let view = |id: u32| View {
            id,
            name: format!("{id}.png"),
            camera,
            cam_from_world: Pose::identity(),
            depth_range: None,
        };
        let points = vec![SparsePoint { x_in_world: Vector3::zeros(), views: vec![0, 2] }];
        let pairs = Some(vec![vec![Source { view: 1, score: 1.0 }], vec![], vec![]]);
        Scene { views: (0..3).map(view).collect(), points, pairs }
    }

    #[test]
    fn contradictions_are_named() {
        assert_eq!(scene().validate(), Ok(()));
        type Change = fn(&mut Scene);
        let changes: [(Change, &str); 12] = [
            (|scene| scene.views[1].name.clear(), "view 1: expected a name"),
            (|scene| scene.views[2].camera.intrinsics.fx = -1.0, "view 2 (2.png): expected positive focal"),
            (|scene| scene.views[2].camera.intrinsics.fx = 0.6, "longer side of 64×48, got fx 0.6, fy 100"),
            (|scene| scene.views[2].camera.intrinsics.fy = 1e5, "focal lengths in pixels"),
            (|scene| scene.views[0].cam_from_world.translation.x = f64::NAN, "finite pose"),
            (|scene| scene.views[0].cam_from_world.translation.x = 1e18, "within 1e12 of the origin"),
            (|scene| scene.views[0].depth_range = Some(DepthRange { near: 8.0, far: 2.0 }), "view 0"),
            (|scene| scene.points[0].views.push(3), "point 0: expected views below 3, got 3"),
            (|scene| scene.pairs.as_mut().unwrap().truncate(2), "each of the 3 views, got lists for 2"),
            (
                |scene| scene.pairs.as_mut().unwrap()[1] = vec![Source { view: 1, score: 1.0 }],
                "each once, got 1",
            ),
            (
                |scene| scene.pairs.as_mut().unwrap()[1] = vec![Source { view: 99, score: 1.0 }],
                "below 3 as its sources",
            ),
            (
                |scene| scene.pairs.as_mut().unwrap()[1] = vec![Source { view: 0, score: f64::NAN }],
                "got NaN for view 0",
            ),
        ];
        for (change, expected) in changes {
            let mut scene = scene();
            change(&mut scene);
            let error = scene.validate().unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
