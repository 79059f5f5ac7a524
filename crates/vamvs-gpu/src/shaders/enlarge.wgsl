// Images at twice their size, by bilinear interpolation between pixel centres, cut to the size of the output; each plane by itself.

struct Parameters {
    in_sides: vec3<u32>, // planes, height, width
    vectors: u32, // values of a pixel
    out_sides: vec3<u32>,
    finish: u32, // bits: ADD, RELU
}

const ADD: u32 = 1u;
const RELU: u32 = 2u;

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> input: array<{VALUE}>;
@group(0) @binding(2) var<storage, read> others: array<{VALUE}>;
@group(0) @binding(3) var<storage, read_write> output: array<{VALUE}>;

fn neighbour(at: u32, side: u32) -> u32 {
    if at % 2u == 0u { return max(at / 2u, 1u) - 1u; }
    return min(at / 2u + 1u, side - 1u);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= p.out_sides.z || id.y >= p.out_sides.y || id.z >= p.out_sides.x { return; }
    let near = (id.z * p.in_sides.y + id.y / 2u) * p.in_sides.z;
    let far = (id.z * p.in_sides.y + neighbour(id.y, p.in_sides.y)) * p.in_sides.z;
    let left = id.x / 2u;
    let right = neighbour(id.x, p.in_sides.z);
    let at = ((id.z * p.out_sides.y + id.y) * p.out_sides.z + id.x) * p.vectors;
    for (var c = 0u; c < p.vectors; c++) {
        let a = 0.75 * input[(near + left) * p.vectors + c] + 0.25 * input[(near + right) * p.vectors + c];
        let b = 0.75 * input[(far + left) * p.vectors + c] + 0.25 * input[(far + right) * p.vectors + c];
        var value = 0.75 * a + 0.25 * b;
        if (p.finish & ADD) != 0u { value += others[at + c]; }
        if (p.finish & RELU) != 0u { value = max(value, {VALUE}(0.0)); }
        output[at + c] = value;
    }
}
