// What tells the 3×3 coarse pixels around a pixel from each other, rows first: what is seen around the pixel (16 values), their
// distances in depth, how alike their features are, their shares by bilinear interpolation, and a zero.

struct Parameters {
    sides: vec2<u32>, // height, width
    coarse_sides: vec2<u32>,
    bilinear: array<vec4<f32>, 9>, // of the pixels (0, 0), (1, 0), (0, 1), (1, 1) of a block, for each coarse pixel
}

const VECTORS: u32 = 8u; // of a pixel's features
const LOOKED: u32 = 4u; // vectors of what is seen around it
const INPUTS: u32 = 44u;
const REACH: f32 = {REACH};

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> looked: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> depths: array<vec4<f32>>; // coarse; depth in planes first
@group(0) @binding(3) var<storage, read> coarse: array<vec4<f32>>; // features
@group(0) @binding(4) var<storage, read> fine: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> output: array<f32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= p.sides.y || id.y >= p.sides.x { return; }
    let at = id.y * p.sides.y + id.x;
    for (var v = 0u; v < LOOKED; v++) {
        let value = looked[at * LOOKED + v];
        for (var lane = 0u; lane < 4u; lane++) { output[at * INPUTS + 4u * v + lane] = value[lane]; }
    }
    var own = 0.0;
    for (var v = 0u; v < VECTORS; v++) { own += dot(fine[at * VECTORS + v], fine[at * VECTORS + v]); }
    let length = max(sqrt(own), 1e-12);
    let middle = depths[id.y / 2u * p.coarse_sides.y + id.x / 2u].x;
    for (var k = 0u; k < 9u; k++) {
        let row = min(max(id.y / 2u + k / 3u, 1u) - 1u, p.coarse_sides.x - 1u);
        let column = min(max(id.x / 2u + k % 3u, 1u) - 1u, p.coarse_sides.y - 1u);
        let other = row * p.coarse_sides.y + column;
        var product = 0.0;
        var squares = 0.0;
        for (var v = 0u; v < VECTORS; v++) {
            let value = coarse[other * VECTORS + v];
            product += dot(fine[at * VECTORS + v], value);
            squares += dot(value, value);
        }
        let first = at * INPUTS + 4u * LOOKED;
        output[first + k] = clamp(depths[other].x - middle, -REACH, REACH) / REACH;
        output[first + 9u + k] = product / (length * max(sqrt(squares), 1e-12));
        output[first + 18u + k] = p.bilinear[k][id.y % 2u * 2u + id.x % 2u];
    }
    output[at * INPUTS + INPUTS - 1u] = 0.0;
}
