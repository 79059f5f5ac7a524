
// The second colour begins.
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !place_colour(id) { return; }
    let plane = begun();
    own = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0u, 0u);
    if prepare_begun(plane) {
        own = with_energy(plane, energy(plane, Judged(0.0, 0.0, 0u)));
        beside_parent(plane);
        from_sources();
        descend();
        own.settled = 1u;
    }
    field[index()] = own;
}
