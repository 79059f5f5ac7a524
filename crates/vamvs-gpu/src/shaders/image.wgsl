// A photograph as the network sees it: with zero mean and unit deviation, as it is or at half its size. Beyond its last column and
// row these are repeated.

struct Parameters {
    in_sides: vec2<u32>, // height, width, both even
    out_sides: vec2<u32>,
    halved: u32,
    mean: f32, // of values in [0, 1]
    share: f32, // the inverse of their deviation
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> input: array<u32>; // red, green, blue, nothing
@group(0) @binding(2) var<storage, read_write> output: array<vec4<f32>>;

fn colour(x: u32, y: u32) -> vec3<f32> {
    return unpack4x8unorm(input[y * p.in_sides.y + x]).rgb;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= p.out_sides.y || id.y >= p.out_sides.x { return; }
    var value: vec3<f32>;
    if p.halved != 0u {
        let x = 2u * min(id.x, p.in_sides.y / 2u - 1u);
        let y = 2u * min(id.y, p.in_sides.x / 2u - 1u);
        value = 0.25 * (colour(x, y) + colour(x + 1u, y) + colour(x, y + 1u) + colour(x + 1u, y + 1u));
    } else {
        value = colour(min(id.x, p.in_sides.y - 1u), min(id.y, p.in_sides.x - 1u));
    }
    output[id.y * p.out_sides.y + id.x] = vec4<f32>((value - p.mean) * p.share, 0.0);
}
