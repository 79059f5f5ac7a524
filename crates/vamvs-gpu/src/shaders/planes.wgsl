// Depth from costs: the soft-argmin over the planes near the most probable one.

struct Parameters {
    area: u32, // pixels
    planes: u32,
    window: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> costs: array<f32>;
@group(0) @binding(2) var<storage, read_write> output: array<vec4<f32>>; // depth in planes, confidence, spread

fn cost(plane: u32, at: u32) -> f32 {
    return costs[plane * p.area + at];
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= p.area { return; }
    var least = cost(0u, at);
    var likeliest = 0u;
    for (var plane = 1u; plane < p.planes; plane++) {
        let other = cost(plane, at);
        if other < least { least = other; likeliest = plane; }
    }
    var sum = 0.0;
    var spread = 0.0;
    var mass = 0.0;
    var moment = 0.0;
    for (var plane = 0u; plane < p.planes; plane++) {
        let logarithm = least - cost(plane, at);
        let probability = exp(logarithm);
        sum += probability;
        spread -= probability * logarithm;
        let distance = i32(plane) - i32(likeliest);
        if abs(distance) <= i32(p.window) {
            mass += probability;
            moment += f32(distance) * probability;
        }
    }
    let u = moment / mass + f32(likeliest);
    let below = u32(clamp(floor(u), 0.0, f32(p.planes - 2u)));
    let confidence = (exp(least - cost(below, at)) + exp(least - cost(below + 1u, at))) / sum;
    output[at] = vec4<f32>(u, confidence, (spread / sum + log(sum)) / log(f32(p.planes)), 0.0);
}
