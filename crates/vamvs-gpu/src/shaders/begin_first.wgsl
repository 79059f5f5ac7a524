
// The first colour: the mean of the four adjacent planes where these agree; elsewhere it begins and is swept.

var<private> mean: State;
var<private> range: vec2<f32>;
var<private> all_there: bool;
var<private> best: State;

fn adjacent(dx: i32, dy: i32) {
    let other = neighbour(dx, dy);
    if other.w <= 0.0 { all_there = false; return; }
    let plane = seen_from(plane_of(other), -f32(dx), -f32(dy));
    range = vec2<f32>(min(range.x, plane.x), max(range.y, plane.x));
    mean.w += 0.25 * plane.x;
    mean.gx += 0.25 * plane.y;
    mean.gy += 0.25 * plane.z;
    mean.energy += 0.25 * other.energy;
    mean.correlation += 0.25 * other.correlation;
    mean.variance += 0.25 * other.variance;
    if best.w <= 0.0 || other.energy < best.energy { best = other; }
}

fn is_between(plane: vec3<f32>) -> bool {
    if plane.x <= 0.0 || !all_there || image_at(at.x, at.y) < 0.0 { return false; }
    let unit = step_at(plane.x);
    return range.y - range.x < AGREE * unit && abs(mean.w - plane.x) < NEAR * unit;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !place_colour(id) { return; }
    let plane = begun();
    mean = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0u, 1u);
    best = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0u, 0u);
    range = vec2<f32>(IMPOSSIBLE, 0.0);
    all_there = true;
{ADJACENT}
    if is_between(plane) { field[index()] = mean; return; }
    own = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0u, 0u);
    if prepare_begun(plane) {
        if best.w > 0.0 { like = Judged(best.energy, best.correlation, best.best); }
        own = with_energy(plane, Judged(IMPOSSIBLE, 0.0, 0u));
        try_planes(starts(), true);
        descend();
    }
    field[index()] = own;
}
