// A convolution as vamvs-corr has it, channels last: each invocation makes TILE outputs along a row × VECTORS vectors of four
// channels. Sums go through taps, pixels and channels in the order of the CPU's. What is between braces is filled in and unrolled in
// Rust (layer.rs), because arrays with variable indices are slow on many GPUs.

struct Parameters {
    in_sides: vec3<u32>, // planes, height, width
    in_vectors: u32,
    out_sides: vec3<u32>,
    out_vectors: u32,
    first: vec3<u32>, // of the outputs that this pass makes
    step: u32, // from one of them to the next
    count: vec3<u32>, // how many there are
    stride: u32,
    taps: u32,
    blocks: u32, // of VECTORS vectors of output channels
    panel: u32, // vectors of weights of a block
    finish: u32, // bits: RELU, ADD, GATE, SIGMOID
    factor: f32, // of the sigmoid
}

const RELU: u32 = 1u;
const ADD: u32 = 2u;
const GATE: u32 = 4u;
const SIGMOID: u32 = 8u;

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> input: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> weights: array<vec4<f32>>; // of all blocks, then the shifts
@group(0) @binding(3) var<storage, read> taps: array<vec4<i32>>; // z, y, x of the first pixel, pixels
@group(0) @binding(4) var<storage, read> beside: array<vec4<f32>>; // added, of the size of the output
@group(0) @binding(5) var<storage, read> gate: array<vec4<f32>>; // multiplied, an image of the output's sides
@group(0) @binding(6) var<storage, read_write> output: array<vec4<f32>>;

fn finished(sum: vec4<f32>, at: u32, in_plane: u32) -> vec4<f32> {
    var value = sum;
    if (p.finish & RELU) != 0u { value = max(value, vec4<f32>(0.0)); }
    if (p.finish & ADD) != 0u { value += beside[at]; }
    if (p.finish & GATE) != 0u { value *= gate[in_plane]; }
    if (p.finish & SIGMOID) != 0u { value = p.factor / (1.0 + exp(-clamp(value, vec4<f32>(-88.0), vec4<f32>(88.0)))); }
    return value;
}

fn write(sum: vec4<f32>, place: vec3<u32>, vector: u32) {
    if vector >= p.out_vectors || place.x >= p.out_sides.z { return; }
    let in_plane = (place.y * p.out_sides.z + place.x) * p.out_vectors + vector;
    let at = place.z * p.out_sides.y * p.out_sides.z * p.out_vectors + in_plane;
    output[at] = finished(sum, at, in_plane);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = id.x * {TILE}u;
    let block = id.z % p.blocks;
    let z = id.z / p.blocks;
    if x >= p.count.z || id.y >= p.count.y || z >= p.count.x { return; }
    let shift = p.blocks * p.panel + block * {VECTORS}u;
{SUMS}
    var at = block * p.panel;
    for (var t = 0u; t < p.taps; t++) {
        let tap = taps[t];
        let in_z = i32(z * p.stride) + tap.x;
        let in_y = i32(id.y * p.stride) + tap.y;
        if in_z < 0 || in_y < 0 || in_z >= i32(p.in_sides.x) || in_y >= i32(p.in_sides.y) {
            at += u32(tap.w) * p.in_vectors * 4u * {VECTORS}u;
            continue;
        }
        let line = (u32(in_z) * p.in_sides.y + u32(in_y)) * p.in_sides.z;
        for (var pixel = 0; pixel < tap.w; pixel++) {
{PLACES}
            for (var c = 0u; c < p.in_vectors; c++) {
{PRODUCTS}
                at += 4u * {VECTORS}u;
            }
        }
    }
    let place = vec3<u32>(p.first.z + x * p.step, p.first.y + id.y * p.step, p.first.x + z * p.step);
    let vector = block * {VECTORS}u;
{WRITES}
}
