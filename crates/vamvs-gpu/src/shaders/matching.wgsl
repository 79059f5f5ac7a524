// What the kernels of refinement share: how well a plane matches at a pixel, and what a pixel tries. It is the processor's code
// (vamvs-refine: matcher, correlation, energy, descent, sweep) with a pixel for each invocation.

struct Parameters {
    size: vec2<u32>, // of the image: width, height
    stride: u32, // of the image with its border
    count: u32, // source views
    guess_size: vec2<u32>, // 0 where surfaces are sought everywhere
    guess_halvings: u32,
    colour: u32, // of the checkerboard
    begin_size: vec2<u32>, // of the planes to begin with
    first_row: u32,
    reach: i32, // of the search, pixels of disparity
    likeness: f32, // the inverse of the squared difference of grey values at which a texel has a quarter of its weight
    noise: f32, // grey values squared
    beyond: f32,
    hopeless: f32,
    prior: f32,
    prior_reach: f32,
    visibility: f32,
    geometric: f32,
    geometric_reach: f32,
    has_depths: u32,
}

struct Source {
    x: vec4<f32>, // rows of the projection: of the pixel, and per inverse depth
    y: vec4<f32>,
    z: vec4<f32>,
    size: vec2<f32>,
    quads: u32, // its first word
    visibility: u32, // its first value
    visibility_size: vec2<u32>, // 0 if it is not known
    depths: u32, // the first of its own depth map
    pad: u32,
    to_map: vec4<f32>, // factor and offset, for x and for y
    map_size: vec2<f32>, // 0 if it has none
    pads: vec2<f32>,
    back_x: vec4<f32>, // rows of the projection back
    back_y: vec4<f32>,
    back_z: vec4<f32>,
}

struct State {
    w: f32,
    gx: f32,
    gy: f32,
    energy: f32,
    correlation: f32,
    variance: f32,
    best: u32,
    settled: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> sources: array<Source>;
@group(0) @binding(3) var<storage, read> quads: array<u32>;
@group(0) @binding(4) var<storage, read> visibilities: array<f32>;
@group(0) @binding(5) var<storage, read> depths: array<f32>;
@group(0) @binding(6) var<storage, read> guesses: array<f32>;
@group(0) @binding(7) var<storage, read_write> field: array<State>;

const BORDER: u32 = {BORDER}u;
const IMPOSSIBLE: f32 = {IMPOSSIBLE}; // the energy of an impossible plane
const STEEPEST: f32 = {STEEPEST};
const MATCHING: f32 = {MATCHING};
const AGREE: f32 = {AGREE};
const NEAR: f32 = {NEAR};
const OTHER: f32 = {OTHER};
const DISTINCT: f32 = {DISTINCT};
const RADIUS: f32 = {RADIUS};
const SHORT: f32 = {SHORT};
const LONGEST_DEPTH: f32 = {LONGEST_DEPTH};
const LONGEST_SLOPE: f32 = {LONGEST_SLOPE};
const INDEPENDENT: f32 = {INDEPENDENT};
const DAMPING_DEPTH: f32 = {DAMPING_DEPTH};
const DAMPING_SLOPE: f32 = {DAMPING_SLOPE};
const APART: f32 = {APART};
const JUMP: f32 = {JUMP};
const UNKNOWN: f32 = {UNKNOWN};
const VIEWS: u32 = {VIEWS}u; // the correlation is the mean over so many views

// The pixel of this invocation.
var<private> at: vec2<u32>;
var<private> pixel: vec2<f32>; // its centre
var<private> step: f32; // the change of inverse depth that is one pixel of disparity
var<private> prior: f32;
var<private> farthest: f32;
var<private> nearest: f32;
var<private> own: State;
// The neighbour whose views are likely to see its first plane; no views if there is none.
var<private> like: Judged;

// Its window: weights, weights · (grey value − mean), mean and variance.
{WINDOW}
var<private> window_mean: f32;
var<private> window_variance: f32;

// The sources that match a plane best: value, total cost, correlation, index.
{BEST}

fn plane_of(state: State) -> vec3<f32> { return vec3<f32>(state.w, state.gx, state.gy); }

fn seen_from(plane: vec3<f32>, dx: f32, dy: f32) -> vec3<f32> {
    return vec3<f32>(plane.x + plane.y * dx + plane.z * dy, plane.y, plane.z);
}

fn image_at(x: u32, y: u32) -> f32 { return image[(y + BORDER) * p.stride + x + BORDER]; }

// Where the plane of the pixel is in a source view, with the derivatives by image coordinates.
struct Warp { u: f32, v: f32, ux: f32, uy: f32, vx: f32, vy: f32, inside: bool }

fn seen(i: u32, w: f32) -> vec3<f32> {
    let x = sources[i].x;
    let y = sources[i].y;
    let z = sources[i].z;
    return vec3<f32>(
        x.x * pixel.x + x.y * pixel.y + x.z + x.w * w,
        y.x * pixel.x + y.y * pixel.y + y.z + y.w * w,
        z.x * pixel.x + z.y * pixel.y + z.z + z.w * w,
    );
}

fn warp_of(i: u32, plane: vec3<f32>) -> Warp {
    let x = sources[i].x;
    let y = sources[i].y;
    let z = sources[i].z;
    let size = sources[i].size;
    let there = seen(i, plane.x);
    let scale = 1.0 / there.z;
    let u = there.x * scale;
    let v = there.y * scale;
    let right = z.x + z.w * plane.y;
    let down = z.y + z.w * plane.z;
    let inside = there.z > 0.0 && u >= 0.0 && v >= 0.0 && u < size.x && v < size.y;
    return Warp(
        u,
        v,
        (x.x + x.w * plane.y - u * right) * scale,
        (x.y + x.w * plane.z - u * down) * scale,
        (y.x + y.w * plane.y - v * right) * scale,
        (y.y + y.w * plane.z - v * down) * scale,
        inside,
    );
}

// How the source pixel moves with inverse depth.
fn speed(i: u32, w: f32) -> vec2<f32> {
    let there = seen(i, w);
    if !(there.z > 0.0) { return vec2<f32>(0.0); }
    let scale = 1.0 / there.z;
    let offset = vec3<f32>(sources[i].x.w, sources[i].y.w, sources[i].z.w);
    return (offset.xy - there.xy * scale * offset.z) * scale;
}

fn step_at(w: f32) -> f32 {
    var disparity = 0.0;
    for (var i = 0u; i < p.count; i++) { disparity += length(speed(i, w)); }
    if !(disparity > 0.0) { return -1.0; }
    return f32(p.count) / disparity;
}

fn handicap(i: u32) -> f32 {
    let sides = sources[i].visibility_size;
    if sides.x == 0u { return 0.0; }
    let place = vec2<u32>(pixel / vec2<f32>(p.size) * vec2<f32>(sides));
    let inside = min(place, sides - 1u);
    return p.visibility * (1.0 - visibilities[sources[i].visibility + inside.y * sides.x + inside.x]);
}

fn prepare_window() {
    let first = (at.y + BORDER) * p.stride + at.x + BORDER;
    let centre = image[first];
{TEXELS}
    let norm = 1.0 / ({WEIGHTS});
{NORMED}
    let mean = {FIRST};
    window_variance = max({SECOND} - mean * mean, 0.0);
    window_mean = centre + mean;
{CENTRED}
}

struct Samples { a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>, fx: vec4<f32>, fy: vec4<f32> }

fn sample(i: u32, warp: Warp, dx: vec4<f32>, dy: vec4<f32>) -> Samples {
    let size = sources[i].size;
    let x = clamp(fma(vec4<f32>(warp.ux), dx, fma(vec4<f32>(warp.uy), dy, vec4<f32>(warp.u - 0.5))), vec4<f32>(0.0), vec4<f32>(size.x - 1.0));
    let y = clamp(fma(vec4<f32>(warp.vx), dx, fma(vec4<f32>(warp.vy), dy, vec4<f32>(warp.v - 0.5))), vec4<f32>(0.0), vec4<f32>(size.y - 1.0));
    let column = vec4<u32>(x);
    let row = vec4<u32>(y);
    let place = sources[i].quads + row * u32(size.x) + column;
    let q = vec4<u32>(quads[place.x], quads[place.y], quads[place.z], quads[place.w]);
    let low = vec4<u32>(255u);
    return Samples(
        vec4<f32>(q & low),
        vec4<f32>((q >> vec4<u32>(8u)) & low),
        vec4<f32>((q >> vec4<u32>(16u)) & low),
        vec4<f32>(q >> vec4<u32>(24u)),
        x - vec4<f32>(column),
        y - vec4<f32>(row),
    );
}

fn values(s: Samples) -> vec4<f32> {
    let above = fma(s.fx, s.b - s.a, s.a - window_mean);
    let below = fma(s.fx, s.d - s.c, s.c - window_mean);
    return fma(s.fy, below - above, above);
}

fn correlation(i: u32, warp: Warp) -> f32 {
    var first = vec4<f32>(0.0);
    var second = vec4<f32>(0.0);
    var product = vec4<f32>(0.0);
{CORRELATION}
    let one = vec4<f32>(1.0);
    let mean = dot(first, one);
    let variance = max(dot(second, one) - mean * mean, 0.0);
    return dot(product, one) / sqrt((window_variance + p.noise) * (variance + p.noise));
}

// The inverse depth of a source view's own depth map at a position in its photograph; 0 where there is none.
fn depth_in(i: u32, place: vec2<f32>) -> f32 {
    let to = sources[i].to_map;
    let size = sources[i].map_size;
    let u = place.x * to.x + to.y;
    let v = place.y * to.z + to.w;
    if !(u >= 0.0 && v >= 0.0 && u < size.x && v < size.y) { return 0.0; }
    let left = max(u - 0.5, 0.0);
    let top = max(v - 0.5, 0.0);
    let column = u32(left);
    let row = u32(top);
    let width = u32(size.x) + 1u;
    let first = sources[i].depths + row * width + column;
    let a = depths[first];
    let b = depths[first + 1u];
    let c = depths[first + width];
    let d = depths[first + width + 1u];
    let fx = left - f32(column);
    let fy = top - f32(row);
    let least = min(min(a, b), min(c, d));
    let most = max(max(a, b), max(c, d));
    if least < (1.0 - JUMP) * most { return select(select(d, c, fx < 0.5), select(b, a, fx < 0.5), fy < 0.5); }
    let above = a + fx * (b - a);
    let below = c + fx * (d - c);
    return above + fy * (below - above);
}

// The distance from the pixel to the projection of the surface that a source view's own depth map has at a position, IMPOSSIBLE
// if there is none, and that surface's inverse depth in the reference view.
fn surface(i: u32, place: vec2<f32>) -> vec2<f32> {
    let w = depth_in(i, place);
    let x = sources[i].back_x;
    let y = sources[i].back_y;
    let z = sources[i].back_z;
    let back = vec3<f32>(
        x.x * place.x + x.y * place.y + x.z + x.w * w,
        y.x * place.x + y.y * place.y + y.z + y.w * w,
        z.x * place.x + z.y * place.y + z.z + z.w * w,
    );
    if !(w > 0.0 && back.z > 0.0) { return vec2<f32>(IMPOSSIBLE, 0.0); }
    return vec2<f32>(length(back.xy / back.z - pixel), w / back.z);
}

// The cost of a plane in a source view, and its correlation there.
fn cost(i: u32, plane: vec3<f32>) -> vec2<f32> {
    let warp = warp_of(i, plane);
    var found = 0.0;
    if warp.inside { found = correlation(i, warp); }
    var error = 0.0;
    if sources[i].map_size.x > 0.0 {
        error = p.geometric_reach;
        if warp.inside { error = min(surface(i, vec2<f32>(warp.u, warp.v)).x, p.geometric_reach); }
    }
    return vec2<f32>(1.0 - found + p.geometric * error, found);
}

// Takes a view into the list of the best.
fn insert(value: f32, total: f32, correlation: f32, index: u32) {
    var v = value;
    var t = total;
    var c = correlation;
    var i = index;
{INSERT}
}

// The sum of the costs of some views, which are offered to the list of the best.
fn costs(views: u32, plane: vec3<f32>) -> vec2<f32> {
    var sum = vec2<f32>(0.0);
    for (var i = 0u; i < p.count; i++) {
        if (views >> i & 1u) == 0u { continue; }
        let found = cost(i, plane);
        insert(found.x + handicap(i), found.x, found.y, i);
        sum += found;
    }
    return sum;
}

struct Judged { energy: f32, correlation: f32, best: u32 }

fn all_views() -> u32 { return (1u << p.count) - 1u; }

fn is_possible(plane: vec3<f32>) -> bool {
    let steepest = STEEPEST * step;
    let is_inside = plane.x > 0.0 && plane.x >= farthest && plane.x <= nearest;
    return is_inside && plane.y * plane.y + plane.z * plane.z <= steepest * steepest;
}

fn prior_cost(w: f32) -> f32 {
    if prior <= 0.0 { return 0.0; }
    return p.prior * min(abs(w - prior) / (step * p.prior_reach), 1.0);
}

// The energy of a plane. It is known from the views `known` alone if it is below `enough` or above `hopeless` there, which makes it
// impossible.
fn energy(plane: vec3<f32>, known: u32, enough: f32, hopeless: f32) -> Judged {
    if !is_possible(plane) { return Judged(IMPOSSIBLE, 0.0, 0u); }
    forget();
    var views = select(known, all_views(), known == 0u);
    // One loop, so that the window is in the kernel's code once.
    loop {
        let sum = costs(views, plane);
        if known == 0u || views != known { break; }
        let found = sum / f32(countOneBits(known));
        let total = found.x + prior_cost(plane.x);
        if total < enough { return Judged(total, found.y, known); }
        if total > hopeless { return Judged(IMPOSSIBLE, 0.0, 0u); }
        views = all_views() & ~known;
        if views == 0u { break; }
    }
    let mean = mean_of_best();
    return Judged(mean.energy + prior_cost(plane.x), mean.correlation, mean.best);
}

// The views that match the plane best, and the mean of their costs.
fn mean_of_best() -> Judged {
    let most = min(VIEWS, p.count);
    var total = 0.0;
    var correlation = 0.0;
    var best = 0u;
{MEAN}
    return Judged(total / f32(most), correlation / f32(most), best);
}

fn with_energy(plane: vec3<f32>, judged: Judged) -> State {
    return State(plane.x, plane.y, plane.z, judged.energy, judged.correlation, UNKNOWN, judged.best, 0u);
}

// The pixel with its window, near inverse depth w; false if it is masked or its projection moves with depth in no source view.
fn prepare(w: f32) -> bool {
    if image_at(at.x, at.y) < 0.0 { return false; }
    step = step_at(w);
    if !(step > 0.0) { return false; }
    farthest = 0.0;
    nearest = IMPOSSIBLE;
    if p.guess_size.x > 0u {
        let place = min(at >> vec2<u32>(p.guess_halvings), p.guess_size - 1u);
        let first = (place.y * p.guess_size.x + place.x) * 6u;
        if guesses[first + 5u] >= 0.0 {
            nearest = guesses[first + 3u] + p.beyond * step;
            farthest = guesses[first + 4u] - p.beyond * step;
        }
    }
    prepare_window();
    return true;
}

// The state of the pixel beside, which has the other colour; w = 0 if there is none.
fn neighbour(dx: i32, dy: i32) -> State {
    let place = vec2<i32>(at) + vec2<i32>(dx, dy);
    let size = vec2<i32>(p.size);
    if place.x < 0 || place.y < 0 || place.x >= size.x || place.y >= size.y {
        return State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0u, 0u);
    }
    return field[u32(place.y * size.x + place.x)];
}

// The plane that the neighbours propose: of each direction's best, those that are another surface than the pixel's own, the best; w = 0
// if there is none.
fn proposed() -> vec3<f32> {
    var least = IMPOSSIBLE;
    var best = vec3<f32>(0.0);
    var energy_of = IMPOSSIBLE;
    var plane = vec3<f32>(0.0);
    var found = false;
    var other: State;
{DIRECTIONS}
    return best;
}

fn is_same(a: vec3<f32>, b: vec3<f32>) -> bool {
    let way = abs(a - b);
    return way.x + RADIUS * (way.y + way.z) < OTHER * step;
}

// Inverse depths of the sources' own depth maps that were tried, and the plane at which they were looked up.
var<private> tried: array<f32, 16>;
var<private> most: u32;
var<private> around: vec3<f32>;

// The plane at the depth of a source's own depth map, if that was not tried; else w = 0. Sources are asked in their order.
fn of_source(i: u32) -> vec3<f32> {
    if i == 0u { most = 0u; }
    if i % 4u == 0u { around = plane_of(own); }
    let warp = warp_of(i, around);
    if !warp.inside || sources[i].map_size.x <= 0.0 { return vec3<f32>(0.0); }
    let found = surface(i, vec2<f32>(warp.u, warp.v));
    if found.x >= IMPOSSIBLE { return vec3<f32>(0.0); }
    let w = found.y;
    var is_near = abs(w - own.w) < DISTINCT * step;
    for (var k = 0u; k < most; k++) { is_near = is_near || abs(w - tried[k]) < DISTINCT * step; }
    if is_near { return vec3<f32>(0.0); }
    tried[most] = w;
    most++;
    return vec3<f32>(w, own.gx, own.gy);
}

// Tries so many planes of the kernel's own (`start`), the neighbours' if they are asked, and those of the sources' depth maps. A plane
// is taken if its energy is lower.
fn try_planes(starts: u32, asks_neighbours: bool) {
    let of_sources = select(0u, p.count, p.has_depths != 0u);
    for (var k = 0u; k < starts + 1u + of_sources; k++) {
        var plane = vec3<f32>(0.0);
        if k < starts {
            plane = start(k);
        } else if k > starts {
            plane = of_source(k - starts - 1u);
        } else if asks_neighbours {
            plane = proposed();
        }
        if plane.x <= 0.0 { continue; }
        var known = own.best;
        var enough = own.energy;
        var hopeless = own.energy + p.hopeless;
        if known == 0u && like.best != 0u {
            known = like.best;
            enough = like.energy + p.hopeless;
            hopeless = IMPOSSIBLE;
        }
        let found = energy(plane, known, enough, hopeless);
        if found.energy < own.energy { own = with_energy(plane, found); }
        like = Judged(0.0, 0.0, 0u);
    }
}

// A Gauss–Newton step over all views that match, taken if it raises their correlation and lowers the energy in those that match best.
fn descend() {
    if own.settled != 0u { return; }
    // The normal equations: the matrix's upper triangle in rows, and the vector.
    var diagonal = vec3<f32>(0.0);
    var beside = vec3<f32>(0.0);
    var vector = vec3<f32>(0.0);
    var views = 0u;
    var matched = 0.0;
    let plane = plane_of(own);
    for (var i = 0u; i < p.count; i++) {
        let warp = warp_of(i, plane);
        if !warp.inside { continue; }
        let moved = speed(i, plane.x) * step;
        var first = 0.0;
        var second = 0.0;
        var product = 0.0;
        var d = vec3<f32>(0.0);
        var dv = vec3<f32>(0.0);
        var dr = vec3<f32>(0.0);
        var squares = vec3<f32>(0.0);
        var products = vec3<f32>(0.0);
{EQUATIONS}
        let variance = max(second - first * first, 0.0) + p.noise;
        let found = product / sqrt((window_variance + p.noise) * variance);
        let is_best = (own.best >> i & 1u) == 1u;
        if !(found > 0.0 && (is_best || found > own.correlation - MATCHING)) { continue; }
        let gain = product / variance;
        let across = dv - d * first;
        diagonal += gain * gain * (squares - d * d - across * across / variance);
        beside += gain * gain * (products - d.xxy * d.yzz - across.xxy * across.yzz / variance);
        vector += gain * (dr - gain * across);
        views |= 1u << i;
        matched += found;
    }
    matched /= f32(max(countOneBits(views), 1u));
    let m = diagonal + vec3<f32>(DAMPING_DEPTH, DAMPING_SLOPE, DAMPING_SLOPE) * p.noise;
    let cofactors = vec3<f32>(
        m.y * m.z - beside.z * beside.z,
        beside.y * beside.z - beside.x * m.z,
        beside.x * beside.z - beside.y * m.y,
    );
    let determinant = m.x * cofactors.x + beside.x * cofactors.y + beside.y * cofactors.z;
    if determinant == 0.0 { return; }
    let inverse_yz = vec3<f32>(
        m.x * m.z - beside.y * beside.y,
        beside.x * beside.y - m.x * beside.z,
        m.x * m.y - beside.x * beside.x,
    );
    let way = vec3<f32>(
        dot(cofactors, vector),
        dot(vec3<f32>(cofactors.y, inverse_yz.x, inverse_yz.y), vector),
        dot(vec3<f32>(cofactors.z, inverse_yz.y, inverse_yz.z), vector),
    ) / determinant;
    let unexplained = 1.0 - matched * matched;
    let variance = INDEPENDENT * (window_variance * unexplained + p.noise) * cofactors.x / determinant;
    let longest = vec3<f32>(LONGEST_DEPTH, LONGEST_SLOPE, LONGEST_SLOPE);
    let next = plane + clamp(way, -longest, longest) * step;
    let far = abs(way.x) + RADIUS * (abs(way.y) + abs(way.z));
    if far < SHORT && is_possible(next) {
        own.w = next.x;
        own.gx = next.y;
        own.gy = next.z;
        own.variance = variance;
        own.settled = 1u;
        return;
    }
    var is_better = false;
    if is_possible(next) && own.best != 0u {
        var sum = vec2<f32>(0.0);
        var over_views = 0.0;
        for (var i = 0u; i < p.count; i++) {
            if ((own.best | views) >> i & 1u) == 0u { continue; }
            let found = cost(i, next);
            if (own.best >> i & 1u) == 1u { sum += found; }
            if (views >> i & 1u) == 1u { over_views += found.y; }
        }
        sum /= f32(countOneBits(own.best));
        let total = sum.x + prior_cost(next.x);
        if over_views / f32(max(countOneBits(views), 1u)) > matched && total < own.energy {
            is_better = true;
            own = with_energy(next, Judged(total, sum.y, own.best));
        }
    }
    own.variance = variance;
    own.settled = select(1u, 0u, is_better);
}

// Which pixel this invocation has; all of an image, or one colour of the checkerboard.
fn place_all(id: vec3<u32>) -> bool {
    at = vec2<u32>(id.x, id.y + p.first_row);
    pixel = vec2<f32>(at) + 0.5;
    return at.x < p.size.x && at.y < p.size.y;
}

fn place_colour(id: vec3<u32>) -> bool {
    let y = id.y + p.first_row;
    at = vec2<u32>(2u * id.x + (y + p.colour) % 2u, y);
    pixel = vec2<f32>(at) + 0.5;
    return at.x < p.size.x && at.y < p.size.y;
}

fn index() -> u32 { return at.y * p.size.x + at.x; }
