// The largest and the mean correlation of each group over all planes.

@group(0) @binding(3) var<storage, read_write> output: array<vec4<f32>>; // largest, mean; groups 0 to 3, 4 to 7

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= p.sides.y || id.y >= p.sides.x { return; }
    let at = id.y * p.sides.y + id.x;
    let ray = ray_of(id.x, id.y);
    var low = vec4<f32>(-3.0e38);
    var high = low;
    var sum_low = vec4<f32>(0.0);
    var sum_high = sum_low;
    for (var plane = 0u; plane < p.planes; plane++) {
        let found = correlation(at, ray, depth_of(f32(plane)));
        low = max(low, found.low);
        high = max(high, found.high);
        sum_low += found.low;
        sum_high += found.high;
    }
    let share = 1.0 / f32(p.planes);
    output[4u * at] = low;
    output[4u * at + 1u] = high;
    output[4u * at + 2u] = share * sum_low;
    output[4u * at + 3u] = share * sum_high;
}
