// The coarse depth map at twice its size: for each pixel the mean of the likeliest of the 3×3 coarse pixels around it and of those on
// one surface with it, with their shares.

struct Parameters {
    sides: vec2<u32>, // height, width
    coarse_sides: vec2<u32>,
    bilinear: array<vec4<f32>, 9>, // as in candidates.wgsl
}

const SCORES: u32 = 12u; // values of a pixel, of which nine are scores
const ONE_SURFACE: f32 = {ONE_SURFACE};

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> scores: array<f32>;
@group(0) @binding(2) var<storage, read> depths: array<vec4<f32>>; // coarse; depth in planes first
@group(0) @binding(3) var<storage, read_write> output: array<f32>;

fn score(at: u32, k: u32, place: u32) -> f32 {
    return scores[at * SCORES + k] + p.bilinear[k][place];
}

fn depth(x: u32, y: u32, k: u32) -> f32 {
    let row = min(max(y / 2u + k / 3u, 1u) - 1u, p.coarse_sides.x - 1u);
    let column = min(max(x / 2u + k % 3u, 1u) - 1u, p.coarse_sides.y - 1u);
    return depths[row * p.coarse_sides.y + column].x;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= p.sides.y || id.y >= p.sides.x { return; }
    let at = id.y * p.sides.y + id.x;
    let place = id.y % 2u * 2u + id.x % 2u;
    var largest = score(at, 0u, place);
    var likeliest = 0u;
    for (var k = 1u; k < 9u; k++) {
        let other = score(at, k, place);
        if other > largest { largest = other; likeliest = k; }
    }
    let chosen = depth(id.x, id.y, likeliest);
    var mass = 0.0;
    var sum = 0.0;
    for (var k = 0u; k < 9u; k++) {
        let own = depth(id.x, id.y, k);
        if abs(own - chosen) <= ONE_SURFACE {
            let share = exp(score(at, k, place) - largest);
            mass += share;
            sum += share * own;
        }
    }
    output[at] = sum / mass;
}
