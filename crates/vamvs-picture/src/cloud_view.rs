//! An interactive cloud in a page: own WebGL code, no library, no network.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use vamvs_core::{CloudPoint, Mesh, Pinhole, Pose};

use crate::Scale;
use crate::number::{grouped, percent};
use crate::packed::{self, PackedCloud};
use crate::splat::typical_radius;
use crate::template::{escaped, fill};
use crate::viewpoint::quantile;

const FRAME: &str = include_str!("cloud.html");
const SCRIPT: &str = include_str!("cloud.js");
const STYLE: &str = include_str!("cloud.css");
const VERTEX: &str = include_str!("cloud.vert");
const FRAGMENT: &str = include_str!("cloud.frag");

/// Number of colours of a scale in the page.
const STOPS: usize = 17;

/// Number of points that are sampled to find out what a camera sees.
const SAMPLES: usize = 5000;

/// A camera that took part.
#[derive(Clone, Debug, PartialEq)]
pub struct ShownCamera {
    /// Its photograph's name.
    pub name: String,
    /// The camera.
    pub camera: Pinhole,
    /// Its pose.
    pub cam_from_world: Pose,
}

/// A cloud and its cameras, ready for a page.
#[derive(Clone, Debug)]
pub struct CloudView {
    pub(crate) packed: PackedCloud,
    pub(crate) cameras: Vec<ShownCamera>,
    /// Up in the world: the mean up direction of the cameras.
    pub(crate) up: Vector3<f64>,
    /// The camera from which the page looks first.
    pub(crate) start: usize,
    mesh: Option<ShownMesh>,
}

/// A mesh beside the cloud.
#[derive(Clone, Debug)]
struct ShownMesh {
    vertices: Vec<u8>,
    triangles: Vec<[u32; 3]>,
    /// Number of triangles of the whole mesh.
    total: usize,
}

/// The data of the script. Lengths are in units of the longest side of the cloud's box, positions
/// relative to its middle.
#[derive(Serialize)]
struct Data<'a> {
    points: String,
    count: usize,
    extent: [f64; 3],
    /// Typical radius of a point.
    radius: f64,
    most_views: u8,
    up: [f64; 3],
    start: usize,
    /// Height of the pyramids that stand for cameras.
    pyramid: f64,
    /// The colours of the scale in even steps: red, green and blue, 0 to 1.
    ramp: Vec<[f32; 3]>,
    cameras: Vec<Camera<'a>>,
    mesh: Option<MeshData>,
}

/// A mesh: vertices as points are, and numbers of vertices, four bytes each.
#[derive(Serialize)]
struct MeshData {
    vertices: String,
    triangles: String,
}

#[derive(Serialize)]
struct Camera<'a> {
    name: &'a str,
    centre: [f64; 3],
    /// The rows of R of `cam_from_world`.
    rotation: [[f64; 3]; 3],
    /// Half the picture's width and height at distance 1.
    tangents: [f64; 2],
    /// The median of the depths that it sees.
    depth: f64,
}

impl CloudView {
    /// The view of a cloud of `total` points that these cameras saw; `taken` are its points at the
    /// indices [`CloudView::sample_indices`].
    #[must_use]
    pub fn new(total: usize, taken: &[CloudPoint], cameras: Vec<ShownCamera>) -> Self {
        let packed = PackedCloud::new(total, taken);
        let ups = cameras.iter().map(|camera| -camera.cam_from_world.rotation.row(1).transpose());
        let up = ups.sum::<Vector3<f64>>().try_normalize(1e-6).unwrap_or(-Vector3::y());
        let seen = |camera: &ShownCamera| camera.depths(&packed.points).len();
        let best = cameras.iter().enumerate().rev().max_by_key(|(_, camera)| seen(camera));
        let start = best.map_or(0, |(index, _)| index);
        Self { packed, cameras, up, start, mesh: None }
    }

    /// The largest number of triangles of a mesh in a page.
    pub const MOST_TRIANGLES: usize = 150_000;

    /// With a mesh beside the cloud, which has normals and colours and is one of `total` triangles, reduced.
    #[must_use]
    pub fn with_mesh(self, mesh: &Mesh, total: usize) -> Self {
        let (vertices, triangles) = self.packed.packed_mesh(mesh);
        Self { mesh: Some(ShownMesh { vertices, triangles, total }), ..self }
    }

    /// Ascending indices of the points to take from a cloud of `total`: at most 300 000, evenly.
    #[must_use]
    pub fn sample_indices(total: usize) -> Vec<usize> {
        packed::sample_indices(total)
    }

    /// The view as a part of a page.
    pub(crate) fn html(&self) -> String {
        let data = serde_json::to_string(&self.data()).expect("numbers and names are plain data");
        let options = self.cameras.iter().enumerate().map(|(index, camera)| {
            let chosen = if index == self.start { " selected" } else { "" };
            format!("<option value=\"{index}\"{chosen}>{}</option>", escaped(&camera.name))
        });
        fill(
            FRAME,
            &[
                ("style", STYLE),
                ("caption", &escaped(&self.caption())),
                ("cameras", &options.collect::<String>()),
                ("mesh-hidden", if self.mesh.is_some() { "" } else { " hidden" }),
                ("scale", &Scale::Confidence.css()),
                ("most-views", &self.most_views().to_string()),
                ("vertex", VERTEX),
                ("fragment", FRAGMENT),
                // Nothing in a script may look like its end.
                ("data", &data.replace('<', "\\u003c")),
                ("script", SCRIPT),
            ],
        )
    }

    fn caption(&self) -> String {
        let PackedCloud { points, total, outside, .. } = &self.packed;
        let mut caption = format!("{} of {} points", grouped(points.len() as u64), grouped(*total as u64));
        if *outside > 0.0 {
            caption.push_str(&format!("; {} lie far outside and are not shown", percent(*outside, 2)));
        }
        if let Some(ShownMesh { triangles, total, .. }) = &self.mesh {
            let [shown, total] = [triangles.len(), *total].map(|count| grouped(count as u64));
            caption.push_str(&format!("; a mesh of {total} triangles, reduced to {shown}"));
        }
        caption
    }

    fn most_views(&self) -> u8 {
        self.packed.points.iter().map(|point| point.views).max().unwrap_or(0).max(1)
    }

    fn data(&self) -> Data<'_> {
        let packed = &self.packed;
        let side = packed.extent.iter().copied().fold(0.0, f64::max);
        let middle = Vector3::from(packed.centre());
        let camera = |camera| Camera::new(camera, packed, &middle, side);
        Data {
            points: STANDARD.encode(&packed.bytes),
            count: packed.points.len(),
            extent: packed.extent.map(|extent| extent / side),
            radius: f64::from(typical_radius(&packed.points)) / side,
            most_views: self.most_views(),
            up: self.up.into(),
            start: self.start,
            pyramid: pyramid(&self.cameras, side),
            ramp: ramp(Scale::Confidence),
            cameras: self.cameras.iter().map(camera).collect(),
            mesh: self.mesh.as_ref().map(|mesh| MeshData {
                vertices: STANDARD.encode(&mesh.vertices),
                triangles: STANDARD.encode(
                    mesh.triangles
                        .as_flattened()
                        .iter()
                        .flat_map(|number| number.to_le_bytes())
                        .collect::<Vec<_>>(),
                ),
            }),
        }
    }
}

impl ShownCamera {
    /// The depths of a sample of the points that lie in the camera's picture.
    fn depths(&self, points: &[CloudPoint]) -> Vec<f64> {
        let sample = points.iter().step_by(points.len().div_ceil(SAMPLES).max(1));
        let in_cam = sample.map(|point| self.cam_from_world.transform(&point.x_in_world.into()));
        in_cam.filter(|x_in_cam| self.camera.project_inside(x_in_cam).is_some()).map(|x| x.z).collect()
    }
}

impl<'a> Camera<'a> {
    fn new(shown: &'a ShownCamera, packed: &PackedCloud, middle: &Vector3<f64>, side: f64) -> Self {
        let Pinhole { size, intrinsics } = shown.camera;
        let centre = shown.cam_from_world.centre();
        let mut depths = shown.depths(&packed.points);
        let depth = if depths.is_empty() { (middle - centre).norm() } else { quantile(&mut depths, 0.5) };
        Self {
            name: &shown.name,
            centre: ((centre - middle) / side).into(),
            rotation: rows(&shown.cam_from_world.rotation),
            tangents: [0.5 * size.width as f64 / intrinsics.fx, 0.5 * size.height as f64 / intrinsics.fy],
            depth: depth / side,
        }
    }
}

fn rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)]))
}

/// Half the median distance to the nearest camera, but 1 to 10 % of the side of the cloud.
fn pyramid(cameras: &[ShownCamera], side: f64) -> f64 {
    let centres: Vec<Vector3<f64>> = cameras.iter().map(|camera| camera.cam_from_world.centre()).collect();
    let nearest = |(index, centre): (usize, &Vector3<f64>)| {
        let others = centres.iter().enumerate().filter(move |(other, _)| *other != index);
        others.map(|(_, other)| (other - centre).norm()).reduce(f64::min)
    };
    let mut distances: Vec<f64> = centres.iter().enumerate().filter_map(nearest).collect();
    (0.5 * quantile(&mut distances, 0.5) / side).clamp(0.01, 0.1)
}

fn ramp(scale: Scale) -> Vec<[f32; 3]> {
    let stop = |index: usize| scale.at(index as f32 / (STOPS - 1) as f32);
    (0..STOPS).map(|index| stop(index).map(|channel| f32::from(channel) / 255.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packed::POINT_BYTES;
    use serde_json::Value;
    use vamvs_core::{Intrinsics, Size};

    /// A square of side 2 at depth `z` of the camera at the origin.
    fn square(z: f64) -> Vec<CloudPoint> {
        let place = |i: usize| i as f64 / 20.0 - 1.0;
        let point = |i: usize| CloudPoint {
            x_in_world: [place(i % 41), place(i / 41), z],
            normal: [0.0, 0.0, -1.0],
            colour: [10, 20, 30],
            confidence: 1.0,
            sigma: 0.0,
            views: 7,
        };
        (0..41 * 41).map(point).collect()
    }

    fn camera(name: &str, x: f64) -> ShownCamera {
        let intrinsics = Intrinsics { fx: 50.0, fy: 100.0, cx: 50.0, cy: 50.0 };
        let translation = Vector3::new(-x, 0.0, 0.0);
        ShownCamera {
            name: name.to_owned(),
            camera: Pinhole { size: Size::new(100, 100), intrinsics },
            cam_from_world: Pose { translation, ..Pose::identity() },
        }
    }

    /// What the script reads.
    fn data(html: &str) -> Value {
        let begin = html.find("id=\"cloud-data\"").unwrap();
        let text = html[begin..].split_once('>').unwrap().1.split_once("</script>").unwrap().0;
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn the_page_gets_the_points_and_cameras_relative_to_the_box() {
        let view = CloudView::new(
            41 * 41,
            &square(3.0),
            vec![camera("aside", 9.0), camera("a", 0.0), camera("b", 0.4)],
        );
        let data = data(&view.html());
        let bytes = STANDARD.decode(data["points"].as_str().unwrap()).unwrap();
        assert_eq!(bytes, view.packed.bytes);
        assert_eq!(bytes.len(), data["count"].as_u64().unwrap() as usize * POINT_BYTES);
        assert_eq!(data["start"], 1, "the first of those that see most");
        assert_eq!(data["most_views"], 7);
        let (a, near) = (&data["cameras"][1], |value: &Value, expected: f64| {
            assert!((value.as_f64().unwrap() - expected).abs() < 1e-6, "{value} instead of {expected}");
        });
        near(&a["depth"], 1.5);
        near(&a["centre"][2], -1.5);
        near(&a["tangents"][0], 1.0);
        near(&a["tangents"][1], 0.5);
        near(&data["up"][1], -1.0);
        assert_eq!(data["ramp"].as_array().unwrap().len(), STOPS);
    }

    #[test]
    fn a_mesh_has_its_vertices_in_the_box_of_the_cloud() {
        let view = CloudView::new(41 * 41, &square(3.0), vec![camera("a", 0.0)]);
        assert!(view.html().contains("<label hidden><input type=\"checkbox\" name=\"mesh\""));
        let mesh = Mesh {
            origin: [1.0, -1.0, 3.0],
            positions: vec![[0.0; 3], [-2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 9.0, 0.0]],
            normals: vec![[0.0, 0.0, -1.0]; 4],
            colours: vec![[7, 8, 9]; 4],
            triangles: vec![[0, 2, 1], [0, 3, 1]],
        };
        let html = view.with_mesh(&mesh, 1000).html();
        assert!(
            html.contains("a mesh of 1\u{202f}000 triangles, reduced to 1."),
            "one of them is outside of the box"
        );
        let data = data(&html);
        let bytes = |name: &str| STANDARD.decode(data["mesh"][name].as_str().unwrap()).unwrap();
        assert_eq!(bytes("triangles"), [0, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0]);
        let vertices = bytes("vertices");
        assert_eq!(vertices[..2], u16::MAX.to_le_bytes());
        assert_eq!(vertices[POINT_BYTES..][..2], [0, 0]);
        assert_eq!(vertices[6..9], [7, 8, 9]);
    }

    #[test]
    fn names_cannot_end_the_script_or_an_option() {
        let name = "</script><b>\"'";
        let html = CloudView::new(41 * 41, &square(3.0), vec![camera(name, 0.0)]).html();
        assert_eq!(html.matches("</script>").count(), html.matches("<script").count());
        assert!(html.contains(">&lt;/script&gt;&lt;b&gt;&quot;&#39;</option>"));
        assert_eq!(data(&html)["cameras"][0]["name"], name);
    }

    #[test]
    fn nothing_at_all_is_no_reason_to_fail() {
        let html = CloudView::new(0, &[], Vec::new()).html();
        assert_eq!(data(&html)["count"], 0);
    }
}
