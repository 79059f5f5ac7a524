
// A sweep over the pixels of one colour, near the seed.
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !place_colour(id) { return; }
    own = field[index()];
    if own.w <= 0.0 || !prepare(own.w) { return; }
    let first = index() * 6u;
    prior = select(0.0, guesses[first], guesses[first + 5u] >= 0.0);
    improve(2u);
    field[index()] = own;
}
