
// The second colour is swept where the first one beside it was matched.

var<private> is_matched: bool;

fn adjacent(dx: i32, dy: i32) {
    let other = neighbour(dx, dy);
    if other.w > 0.0 && !(other.best == 0u && other.energy < IMPOSSIBLE) { is_matched = true; }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !place_colour(id) { return; }
    is_matched = false;
{ADJACENT}
    if !is_matched || !prepare_begun(begun()) { return; }
    own = field[index()];
    try_planes(0u, true);
    descend();
    field[index()] = own;
}
