//! Meshes as GLB files (glTF 2.0, section 4).

use std::io::{self, Write};

use serde_json::json;
use vamvs_core::Mesh;

/// `glTF`, `JSON` and `BIN` as the file has them.
const MAGIC: u32 = 0x4654_6C67;
const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

/// Types of components.
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Targets of buffer views.
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes a GLB file with positions, normals, colours, which glTF takes as linear, and triangles. Its y axis is up as glTF has it, if the world's
/// y axis is down as that of most photographs: the node turns the mesh by half a turn around x.
pub(super) fn write(to: &mut dyn Write, mesh: &Mesh) -> io::Result<()> {
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    let lengths = [12 * vertices, 12 * vertices, 4 * vertices, 12 * triangles];
    let offsets = [0, lengths[0], lengths[0] + lengths[1], lengths[0] + lengths[1] + lengths[2]];
    let bytes: usize = lengths.iter().sum();
    let mut description = serde_json::to_vec(&described(mesh, lengths, offsets)).map_err(io::Error::other)?;
    description.resize(description.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + description.len() + 8 + bytes;
    let total = u32::try_from(total)
        .map_err(|_| io::Error::other("a GLB file holds less than 4 GiB: simplify the mesh, or write PLY"))?;
    for word in [MAGIC, 2, total, description.len() as u32, JSON] {
        to.write_all(&word.to_le_bytes())?;
    }
    to.write_all(&description)?;
    for word in [bytes as u32, BIN] {
        to.write_all(&word.to_le_bytes())?;
    }
    for value in mesh.positions.iter().chain(&mesh.normals).flatten() {
        to.write_all(&value.to_le_bytes())?;
    }
    for colour in &mesh.colours {
        let [r, g, b] = colour.map(linear);
        to.write_all(&[r, g, b, 255])?;
    }
    mesh.triangles.iter().flatten().try_for_each(|vertex| to.write_all(&vertex.to_le_bytes()))
}

/// The JSON of the file.
fn described(mesh: &Mesh, lengths: [usize; 4], offsets: [usize; 4]) -> serde_json::Value {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for position in &mesh.positions {
        for axis in 0..3 {
            low[axis] = low[axis].min(position[axis]);
            high[axis] = high[axis].max(position[axis]);
        }
    }
    let view = |number: usize, target: u32| {
        let (offset, length) = (offsets[number], lengths[number]);
        json!({"buffer": 0, "byteOffset": offset, "byteLength": length, "target": target})
    };
    let (vertices, indices) = (mesh.positions.len(), 3 * mesh.triangles.len());
    let [x, y, z] = mesh.origin;
    json!({
        "asset": {"version": "2.0", "generator": "vamvs"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": [1.0, 0.0, 0.0, 0.0], "translation": [x, -y, -z]}],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2},
            "indices": 3,
            "material": 0,
        }]}],
        "materials": [{
            "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
            "doubleSided": true,
        }],
        "accessors": [
            {"bufferView": 0, "componentType": FLOAT, "count": vertices, "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": FLOAT, "count": vertices, "type": "VEC3"},
            {"bufferView": 2, "componentType": UNSIGNED_BYTE, "normalized": true, "count": vertices, "type": "VEC4"},
            {"bufferView": 3, "componentType": UNSIGNED_INT, "count": indices, "type": "SCALAR"},
        ],
        "bufferViews": [view(0, ARRAY_BUFFER), view(1, ARRAY_BUFFER), view(2, ARRAY_BUFFER), view(3, ELEMENT_ARRAY_BUFFER)],
        "buffers": [{"byteLength": lengths.iter().sum::<usize>()}],
    })
}

/// An sRGB value as a linear one.
fn linear(value: u8) -> u8 {
    let value = f32::from(value) / 255.0;
    let linear = if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
    (linear * 255.0).round() as u8
}
