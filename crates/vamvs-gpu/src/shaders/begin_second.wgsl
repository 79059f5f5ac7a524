
// The second colour begins.
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !place_colour(id) { return; }
    let plane = begun();
    own = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0u, 0u);
    if prepare_begun(plane) {
        own = with_energy(plane, Judged(IMPOSSIBLE, 0.0, 0u));
        try_planes(starts(), false);
        descend();
        own.settled = 1u;
    }
    field[index()] = own;
}
