
// The best planes near the seed: steps in depth around its plane, and the surfaces beside it.
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !place_all(id) { return; }
    let first = index() * 6u;
    let plane = vec3<f32>(guesses[first], guesses[first + 1u], guesses[first + 2u]);
    own = with_energy(vec3<f32>(0.0), Judged(IMPOSSIBLE, 0.0, 0u));
    if plane.x > 0.0 && prepare(plane.x) {
        prior = select(0.0, plane.x, guesses[first + 5u] >= 0.0);
        own = with_energy(plane, Judged(IMPOSSIBLE, 0.0, 0u));
        // The plane itself, then offsets from −reach to reach, then the ends.
        for (var k = -1; k < 2 * p.reach + 3; k++) {
            let offset = k - p.reach;
            var tried = plane;
            if k >= 2 * p.reach + 1 {
                tried = vec3<f32>(guesses[first + 3u + u32(k - 2 * p.reach - 1)], 0.0, 0.0);
                if !(abs(tried.x - plane.x) > (f32(p.reach) + 0.5) * step) { continue; }
            } else if k >= 0 {
                if offset == 0 { continue; }
                tried.x = plane.x + f32(offset) * step;
            }
            consider(tried);
        }
    }
    field[index()] = own;
}
