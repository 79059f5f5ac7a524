// A convolution of stride 1 to one channel. Outputs may be fewer than inputs: those behind them are padding.

struct Parameters {
    in_sides: vec3<u32>, // planes, height, width
    in_vectors: u32,
    out_sides: vec3<u32>,
    first: u32, // of the output in its buffer
    sides: vec3<u32>, // of the kernel
    sigmoid: u32, // whether the output goes through it
    padding: vec3<u32>,
    shift: f32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> input: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> weights: array<vec4<f32>>; // (kz, ky, kx, channels)
@group(0) @binding(3) var<storage, read_write> output: array<f32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= p.out_sides.z || id.y >= p.out_sides.y || id.z >= p.out_sides.x { return; }
    var sum = vec4<f32>(0.0);
    for (var kz = 0u; kz < p.sides.x; kz++) {
        let z = i32(id.z + kz) - i32(p.padding.x);
        if z < 0 || z >= i32(p.in_sides.x) { continue; }
        for (var ky = 0u; ky < p.sides.y; ky++) {
            let y = i32(id.y + ky) - i32(p.padding.y);
            if y < 0 || y >= i32(p.in_sides.y) { continue; }
            for (var kx = 0u; kx < p.sides.z; kx++) {
                let x = i32(id.x + kx) - i32(p.padding.z);
                if x < 0 || x >= i32(p.in_sides.z) { continue; }
                let at = ((u32(z) * p.in_sides.y + u32(y)) * p.in_sides.z + u32(x)) * p.in_vectors;
                let weight = ((kz * p.sides.y + ky) * p.sides.z + kx) * p.in_vectors;
                for (var c = 0u; c < p.in_vectors; c++) {
                    sum = fma(input[at + c], weights[weight + c], sum);
                }
            }
        }
    }
    var value = p.shift + sum.x + sum.y + sum.z + sum.w;
    if p.sigmoid != 0u { value = 1.0 / (1.0 + exp(-clamp(value, -88.0, 88.0))); }
    output[p.first + (id.z * p.out_sides.y + id.y) * p.out_sides.z + id.x] = value;
}
