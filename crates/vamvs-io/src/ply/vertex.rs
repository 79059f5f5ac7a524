//! Maps a cloud's point to the properties of a PLY element, by name.

use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use vamvs_core::CloudPoint;

/// The name of the element that holds the points.
pub(super) const NAME: &str = "vertex";

/// A whole point, as an element.
pub(super) struct Vertex(pub(super) CloudPoint);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(CloudPoint {
            x_in_world: [0.0; 3],
            normal: [0.0; 3],
            colour: [255; 3],
            confidence: 1.0,
            sigma: 0.0,
            views: 0,
        })
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = scalar(&property) else { return PropertyAccessResult::Ignored };
        let Self(point) = self;
        match name {
            "x" => point.x_in_world[0] = value,
            "y" => point.x_in_world[1] = value,
            "z" => point.x_in_world[2] = value,
            "nx" => point.normal[0] = value as f32,
            "ny" => point.normal[1] = value as f32,
            "nz" => point.normal[2] = value as f32,
            "red" => point.colour[0] = colour(&property, value),
            "green" => point.colour[1] = colour(&property, value),
            "blue" => point.colour[2] = colour(&property, value),
            "confidence" => point.confidence = value as f32,
            "sigma" => point.sigma = value as f32,
            "views" => point.views = value as u8,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }

    fn get_double(&self, name: &str) -> Option<f64> {
        match name {
            "x" => Some(self.0.x_in_world[0]),
            "y" => Some(self.0.x_in_world[1]),
            "z" => Some(self.0.x_in_world[2]),
            _ => None,
        }
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        match name {
            "nx" => Some(self.0.normal[0]),
            "ny" => Some(self.0.normal[1]),
            "nz" => Some(self.0.normal[2]),
            "confidence" => Some(self.0.confidence),
            "sigma" => Some(self.0.sigma),
            _ => self.get_double(name).map(|value| value as f32),
        }
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        match name {
            "red" => Some(self.0.colour[0]),
            "green" => Some(self.0.colour[1]),
            "blue" => Some(self.0.colour[2]),
            "views" => Some(self.0.views),
            _ => None,
        }
    }
}

/// An element of which only the position is read.
pub(super) struct Position(pub(super) [f64; 3]);

impl PropertyAccess for Position {
    fn new() -> Self {
        Self([0.0; 3])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == name);
        match axis.zip(scalar(&property)) {
            Some((axis, value)) => self.0[axis] = value,
            None => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// A point with the numbers of the views that see it and a weight for each, as in OpenMVS's clouds.
pub(super) struct SeenVertex<'a> {
    pub(super) vertex: Vertex,
    pub(super) views: &'a [u32],
    pub(super) weights: &'a [f32],
}

/// The properties that [`SeenVertex`] adds to [`Vertex`]: lists whose length is a `uchar`.
pub(super) const VIEW_INDICES: &str = "view_indices";
pub(super) const VIEW_WEIGHTS: &str = "view_weights";

impl PropertyAccess for SeenVertex<'_> {
    fn new() -> Self {
        Self { vertex: Vertex::new(), views: &[], weights: &[] }
    }

    fn get_double(&self, name: &str) -> Option<f64> {
        self.vertex.get_double(name)
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        self.vertex.get_float(name)
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        self.vertex.get_uchar(name)
    }

    fn get_list_uint(&self, name: &str) -> Option<&[u32]> {
        (name == VIEW_INDICES).then_some(self.views)
    }

    fn get_list_float(&self, name: &str) -> Option<&[f32]> {
        (name == VIEW_WEIGHTS).then_some(self.weights)
    }
}

fn scalar(property: &Property) -> Option<f64> {
    match *property {
        Property::Char(value) => Some(f64::from(value)),
        Property::UChar(value) => Some(f64::from(value)),
        Property::Short(value) => Some(f64::from(value)),
        Property::UShort(value) => Some(f64::from(value)),
        Property::Int(value) => Some(f64::from(value)),
        Property::UInt(value) => Some(f64::from(value)),
        Property::Float(value) => Some(f64::from(value)),
        Property::Double(value) => Some(value),
        _ => None,
    }
}

/// A colour channel as 0 to 255. Integers are taken as 0 to 255, floating-point numbers as 0 to 1; values beyond
/// are clamped.
fn colour(property: &Property, value: f64) -> u8 {
    let unit = matches!(property, Property::Float(_) | Property::Double(_));
    if unit { (value * 255.0).round() as u8 } else { value as u8 }
}
