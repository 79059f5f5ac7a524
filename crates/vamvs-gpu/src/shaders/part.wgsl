// A part of a volume. Where it reaches beyond the volume, the last values are repeated.

struct Parameters {
    in_sides: vec3<u32>, // planes, height, width
    vectors: u32,
    out_sides: vec3<u32>,
    x: u32, // of the part's first pixel
    y: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> input: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> output: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= p.out_sides.z || id.y >= p.out_sides.y || id.z >= p.out_sides.x { return; }
    let place = min(vec3<u32>(id.z, id.y + p.y, id.x + p.x), p.in_sides - 1u);
    let source = ((place.x * p.in_sides.y + place.y) * p.in_sides.z + place.z) * p.vectors;
    let cell = ((id.z * p.out_sides.y + id.y) * p.out_sides.z + id.x) * p.vectors;
    for (var c = 0u; c < p.vectors; c++) { output[cell + c] = input[source + c]; }
}
