
// A sweep that begins with planes of this resolution or half of it.
@group(0) @binding(8) var<storage, read> planes: array<vec4<f32>>;

fn is_enlarged() -> bool { return p.begin_size.x != p.size.x || p.begin_size.y != p.size.y; }

// The plane of a pixel at half the resolution, as seen from this pixel.
fn enlarged(place: vec2<u32>) -> vec3<f32> {
    let plane = planes[place.y * p.begin_size.x + place.x].xyz * vec3<f32>(1.0, 0.5, 0.5);
    let offset = pixel - 2.0 * (vec2<f32>(place) + 0.5);
    return seen_from(plane, offset.x, offset.y);
}

fn parent() -> vec2<u32> { return min(at / 2u, p.begin_size - 1u); }

fn begun() -> vec3<f32> {
    if is_enlarged() { return enlarged(parent()); }
    return planes[index()].xyz;
}

// The planes of the other three nearest pixels at half the resolution are tried.
fn beside_parent(plane: vec3<f32>) {
    if !is_enlarged() { return; }
    let there = parent();
    let last = p.begin_size - 1u;
    let before = vec2<u32>(max(there.x, 1u) - 1u, max(there.y, 1u) - 1u);
    let beside = select(min(there + 1u, last), before, at % vec2<u32>(2u) == vec2<u32>(0u));
    for (var k = 1u; k < 4u; k++) {
        let place = vec2<u32>(select(there.x, beside.x, k != 2u), select(there.y, beside.y, k != 1u));
        let other = enlarged(place);
        if other.x > 0.0 && abs(other.x - plane.x) > APART * step { consider(other); }
    }
}

fn prepare_begun(plane: vec3<f32>) -> bool {
    prior = plane.x;
    return plane.x > 0.0 && prepare(plane.x);
}
