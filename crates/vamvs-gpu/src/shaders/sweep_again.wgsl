
// A sweep over the pixels of one colour, near the seed.
fn start(k: u32) -> vec3<f32> { return vec3<f32>(0.0); }

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !place_colour(id) { return; }
    own = field[index()];
    if own.w <= 0.0 || !prepare(own.w) { return; }
    let first = index() * 6u;
    prior = select(0.0, guesses[first], guesses[first + 5u] >= 0.0);
    like = Judged(0.0, 0.0, 0u);
    try_planes(0u, true);
    for (var k = 0u; k < 2u; k++) { descend(); }
    field[index()] = own;
}
