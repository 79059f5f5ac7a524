// What the volumes tell of a pixel: what the network finds there, and what tells whether there is a surface at all.

struct Parameters {
    area: u32, // pixels
    views: u32,
    planes: u32, // of the second volume
    step: f32, // their distance, in planes of the first one
    last: f32, // plane of the first volume
}

const LOOKED: u32 = 4u; // vectors of what is seen around a pixel
const INPUTS: u32 = 6u; // vectors: these, six values, two zeros

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> looked: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> coarse: array<vec4<f32>>; // enlarged: depth, confidence, spread
@group(0) @binding(3) var<storage, read> fine: array<vec4<f32>>; // depth in its own planes, confidence
@group(0) @binding(4) var<storage, read> around: array<f32>; // the depths that these planes are around
@group(0) @binding(5) var<storage, read> masks: array<f32>;
@group(0) @binding(6) var<storage, read> volume: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> output: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> found: array<vec4<f32>>; // depth in planes, confidence of both volumes

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= p.area { return; }
    for (var v = 0u; v < LOOKED; v++) { output[at * INPUTS + v] = looked[at * LOOKED + v]; }
    let u = fma(fine[at].x - 0.5 * f32(p.planes - 1u), p.step, around[at]);
    var mask = 0.0;
    for (var view = 0u; view < p.views; view++) { mask += masks[view * p.area + at]; }
    var strongest = -3.0e38;
    for (var plane = 0u; plane < p.planes; plane++) {
        let cell = 2u * (plane * p.area + at);
        strongest = max(strongest, dot(volume[cell] + volume[cell + 1u], vec4<f32>(0.125)));
    }
    output[at * INPUTS + 4u] = vec4<f32>(coarse[at].y, coarse[at].z, fine[at].y, strongest);
    output[at * INPUTS + 5u] = vec4<f32>(mask / f32(p.views), u / p.last, 0.0, 0.0);
    found[at] = vec4<f32>(u, fine[at].y, coarse[at].y, 0.0);
}
