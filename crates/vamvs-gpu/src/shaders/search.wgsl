
// The best planes near the seed: that plane, steps in depth around it, and the surfaces beside it.

var<private> seed: vec3<f32>;

fn start(k: u32) -> vec3<f32> {
    let steps = 2 * p.reach + 1;
    if k == 0u { return seed; }
    let number = i32(k) - 1;
    if number < steps {
        let offset = number - p.reach;
        return vec3<f32>(select(seed.x + f32(offset) * step, 0.0, offset == 0), seed.yz);
    }
    let end = guesses[index() * 6u + 3u + u32(number - steps)];
    return vec3<f32>(select(0.0, end, abs(end - seed.x) > (f32(p.reach) + 0.5) * step), 0.0, 0.0);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !place_all(id) { return; }
    let first = index() * 6u;
    seed = vec3<f32>(guesses[first], guesses[first + 1u], guesses[first + 2u]);
    own = with_energy(vec3<f32>(0.0), Judged(IMPOSSIBLE, 0.0, 0u));
    like = Judged(0.0, 0.0, 0u);
    if seed.x > 0.0 && prepare(seed.x) {
        prior = select(0.0, seed.x, guesses[first + 5u] >= 0.0);
        own = with_energy(seed, Judged(IMPOSSIBLE, 0.0, 0u));
        try_planes(u32(2 * p.reach + 4), false);
    }
    field[index()] = own;
}
