// The share of each source view in the mean, from what they see.

struct Parameters {
    area: u32, // pixels
    views: u32,
}

const UNSEEN: f32 = {UNSEEN};

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> masks: array<f32>;
@group(0) @binding(2) var<storage, read_write> shares: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= p.area { return; }
    var sum = UNSEEN;
    for (var view = 0u; view < p.views; view++) { sum += masks[view * p.area + at]; }
    for (var view = 0u; view < p.views; view++) {
        shares[view * p.area + at] = masks[view * p.area + at] / sum;
    }
}
