// What the kernels of the plane sweep share: where a pixel of the reference view at a depth lies in a source view, and how its
// features correlate there. A feature's channel c belongs to group c mod 8.

struct Sweep {
    linear: mat3x3<f32>, // the pixel at depth d is at d · linear · pixel + offset
    offset: vec3<f32>, // in units of the nearest depth
    stride: f32, // of the features in the photograph
    scale: vec2<f32>, // from pixels of the source photograph to those of its features
    sides: vec2<u32>, // of the reference's features: height, width
    source_sides: vec2<u32>,
    planes: u32,
    is_inverse: u32, // whether planes are uniform in inverse depth
    slope: f32, // of the depth, or its inverse, from plane to plane
    least: f32,
    step: f32, // planes around a depth: how far apart, in planes of the whole sweep
    first: u32, // the first share of this source view
    adds: u32, // whether it is added to what is there
    depths: u32, // whether planes are around those of `around`, or all of the sweep
}

@group(0) @binding(0) var<uniform> p: Sweep;
@group(0) @binding(1) var<storage, read> reference: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> source: array<vec4<f32>>;

const VECTORS: u32 = 8u; // of a pixel's features
const BEHIND: f32 = {BEHIND};

// The mean products of the groups 0 to 3 and 4 to 7.
struct Correlation { low: vec4<f32>, high: vec4<f32> }

fn ray_of(x: u32, y: u32) -> vec3<f32> {
    let pixel = vec3<f32>((f32(x) + 0.5) * p.stride, (f32(y) + 0.5) * p.stride, 1.0);
    return p.linear * pixel;
}

fn depth_of(u: f32) -> f32 {
    let along = max(fma(u, p.slope, 1.0), p.least);
    if p.is_inverse != 0u { return 1.0 / along; }
    return along;
}

// The pixels before and behind a position along an axis, and their shares; outside of the image these are 0.
struct Axis { low: u32, high: u32, shares: vec2<f32> }

fn axis(at: f32, side: u32) -> Axis {
    let first = i32(floor(at));
    let share = at - f32(first);
    let last = i32(side) - 1;
    let shares = vec2<f32>(select(0.0, 1.0 - share, first >= 0), select(0.0, share, first < last));
    return Axis(u32(max(first, 0)), u32(min(first + 1, last)), shares);
}

fn correlation(at: u32, ray: vec3<f32>, depth: f32) -> Correlation {
    var sums = Correlation(vec4<f32>(0.0), vec4<f32>(0.0));
    let place = fma(vec3<f32>(depth), ray, p.offset);
    if !(place.z > BEHIND) { return sums; }
    let pixel = place.xy / place.z * p.scale - 0.5;
    let sides = vec2<f32>(f32(p.source_sides.y), f32(p.source_sides.x));
    if !(pixel.x > -1.0 && pixel.y > -1.0 && pixel.x < sides.x && pixel.y < sides.y) { return sums; }
    let x = axis(pixel.x, p.source_sides.y);
    let y = axis(pixel.y, p.source_sides.x);
    let above = y.low * p.source_sides.y;
    let below = y.high * p.source_sides.y;
    let a = (above + x.low) * VECTORS;
    let b = (above + x.high) * VECTORS;
    let c = (below + x.low) * VECTORS;
    let d = (below + x.high) * VECTORS;
    let weights = 0.25 * vec4<f32>(x.shares * y.shares.x, x.shares * y.shares.y);
    let own = at * VECTORS;
    for (var v = 0u; v < VECTORS; v += 2u) {
        let low = weights.x * source[a + v] + weights.y * source[b + v] + weights.z * source[c + v] + weights.w * source[d + v];
        let w = v + 1u;
        let high = weights.x * source[a + w] + weights.y * source[b + w] + weights.z * source[c + w] + weights.w * source[d + w];
        sums.low = fma(low, reference[own + v], sums.low);
        sums.high = fma(high, reference[own + w], sums.high);
    }
    return sums;
}
