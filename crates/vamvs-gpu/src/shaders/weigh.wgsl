// Adds a source view's correlations, weighed by its share, to a volume.

@group(0) @binding(3) var<storage, read> shares: array<f32>;
@group(0) @binding(4) var<storage, read> around: array<f32>; // depths in planes, if planes are around these
@group(0) @binding(5) var<storage, read_write> volume: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= p.sides.y || id.y >= p.sides.x { return; }
    let at = id.y * p.sides.y + id.x;
    var u = f32(id.z);
    if p.depths != 0u {
        u = fma(u - 0.5 * f32(p.planes - 1u), p.step, around[at]);
    }
    let found = correlation(at, ray_of(id.x, id.y), depth_of(u));
    let share = shares[p.first + at];
    let cell = 2u * (id.z * p.sides.x * p.sides.y + at);
    var low = share * found.low;
    var high = share * found.high;
    if p.adds != 0u {
        low += volume[cell];
        high += volume[cell + 1u];
    }
    volume[cell] = low;
    volume[cell + 1u] = high;
}
