
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

// The pixel's own plane, and those of the other three nearest pixels at half the resolution where they are other surfaces.
fn start(k: u32) -> vec3<f32> {
    let plane = begun();
    if k == 0u { return plane; }
    let there = parent();
    let before = max(there, vec2<u32>(1u)) - 1u;
    let after = min(there + 1u, p.begin_size - 1u);
    let beside = select(after, before, at % vec2<u32>(2u) == vec2<u32>(0u));
    let other = enlarged(select(there, beside, vec2<bool>(k != 2u, k != 1u)));
    return select(vec3<f32>(0.0), other, abs(other.x - plane.x) > APART * step);
}

fn starts() -> u32 { return select(1u, 4u, is_enlarged()); }

fn prepare_begun(plane: vec3<f32>) -> bool {
    prior = plane.x;
    like = Judged(0.0, 0.0, 0u);
    return plane.x > 0.0 && prepare(plane.x);
}
