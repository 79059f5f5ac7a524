//! The kernels of refinement: WGSL with the window of a pixel unrolled, and the processor's constants filled in.

use std::fmt::Write;

use rayon::prelude::*;
use vamvs_refine::matching::{ADJACENT, DIRECTIONS, Matching, constants, texels};

use crate::kernels::{IMAGE, Kernel, filled, kernel, literal};
use crate::matching::IMPOSSIBLE;

/// Texels that are sampled together.
const TOGETHER: usize = 4;

/// The kernels for a number of views that a correlation is the mean over.
pub struct MatchingKernels {
    pub search: Kernel,
    pub sweep: Kernel,
    pub begin_second: Kernel,
    pub begin_first: Kernel,
    pub begin_again: Kernel,
}

impl MatchingKernels {
    pub fn new(device: &wgpu::Device, views: usize) -> Self {
        // Drivers compile them for seconds.
        let made: Vec<Kernel> = sources(views)
            .into_par_iter()
            .map(|(name, source)| kernel(device, name, source, IMAGE))
            .collect();
        let Ok([search, sweep, begin_second, begin_first, begin_again]) = <[Kernel; 5]>::try_from(made)
        else {
            unreachable!("a kernel for each source");
        };
        Self { search, sweep, begin_second, begin_first, begin_again }
    }
}

/// Names and sources in the order of [`MatchingKernels`].
pub fn sources(views: usize) -> [(&'static str, String); 5] {
    let common = filled(include_str!("shaders/matching.wgsl"), &names(views));
    let begin = common.clone() + include_str!("shaders/begin.wgsl");
    let adjacent = [("ADJACENT", lines(ADJACENT.iter().map(|(dx, dy)| format!("adjacent({dx}, {dy});"))))];
    [
        ("search", common.clone() + include_str!("shaders/search.wgsl")),
        ("sweep", common + include_str!("shaders/sweep_again.wgsl")),
        ("the second colour", begin.clone() + include_str!("shaders/begin_second.wgsl")),
        ("the first colour", begin.clone() + &filled(include_str!("shaders/begin_first.wgsl"), &adjacent)),
        ("the second colour again", begin + &filled(include_str!("shaders/begin_again.wgsl"), &adjacent)),
    ]
}

/// What is filled in.
fn names(views: usize) -> Vec<(&'static str, String)> {
    let mut names: Vec<(&str, String)> =
        constants().into_iter().map(|(name, value)| (name, literal(value))).collect();
    names.extend([
        ("IMPOSSIBLE", literal(IMPOSSIBLE)),
        ("BORDER", Matching::BORDER.to_string()),
        ("VIEWS", views.to_string()),
        ("BEST", best(views)),
        ("INSERT", lines((0..views).map(insert))),
        ("MEAN", lines((0..views).map(mean))),
        ("DIRECTIONS", directions()),
    ]);
    names.extend(window());
    names
}

fn lines(lines: impl Iterator<Item = String>) -> String {
    lines.collect::<Vec<_>>().join("\n")
}

/// The list of the best views.
fn best(views: usize) -> String {
    let mut text = String::new();
    let mut clear = String::new();
    for view in 0..views {
        for name in ["value", "total", "correlation"] {
            writeln!(text, "var<private> {name}{view}: f32;").expect("a string takes all text");
        }
        writeln!(text, "var<private> index{view}: u32;").expect("a string takes all text");
        writeln!(clear, "value{view} = 2.0 * IMPOSSIBLE; index{view} = 31u;")
            .expect("a string takes all text");
    }
    format!("{text}\nfn forget() {{\n{clear}}}")
}

/// Puts a view in its place of the list; what was there goes on.
fn insert(view: usize) -> String {
    let swap = |own: &str, name: &str| {
        format!("let old_{own} = {name}{view}; {name}{view} = {own}; {own} = old_{own};")
    };
    let swaps = [("v", "value"), ("t", "total"), ("c", "correlation"), ("i", "index")]
        .map(|(own, name)| swap(own, name))
        .join(" ");
    format!("if v < value{view} || (v == value{view} && i < index{view}) {{ {swaps} }}")
}

fn mean(view: usize) -> String {
    format!(
        "if {view}u < most {{ total += total{view}; correlation += correlation{view}; best |= 1u << index{view}; }}"
    )
}

/// Of each direction the neighbour with the least energy.
fn directions() -> String {
    let of = |(dx, dy): &(i32, i32)| {
        format!(
            "other = neighbour({dx}, {dy});
if other.w > 0.0 && (!found || other.energy < energy_of) {{
    found = true;
    energy_of = other.energy;
    plane = seen_from(plane_of(other), -f32({dx}), -f32({dy}));
}}"
        )
    };
    lines(DIRECTIONS.iter().map(|direction| {
        let neighbours = lines(direction.iter().map(of));
        format!(
            "found = false;\n{neighbours}
if found && energy_of < least && !is_same(plane, plane_of(own)) {{ least = energy_of; best = plane; }}"
        )
    }))
}

/// The window of a pixel, its samples in a source view, and the sums over them.
fn window() -> Vec<(&'static str, String)> {
    let texels = texels();
    let groups: Vec<&[[f32; 3]]> = texels.chunks(TOGETHER).collect();
    let four = |of: &dyn Fn(&[f32; 3]) -> String, group: &[[f32; 3]]| {
        format!("vec4<f32>({})", group.iter().map(of).collect::<Vec<_>>().join(", "))
    };
    let part = |index: usize| move |texel: &[f32; 3]| literal(texel[index]);
    let value =
        |texel: &[f32; 3]| format!("image[u32(i32(first) + {} * i32(p.stride) + {})]", texel[1], texel[0]);
    let each = |of: &dyn Fn(usize, &[[f32; 3]]) -> String| {
        lines(groups.iter().enumerate().map(|(number, group)| of(number, group)))
    };
    let sum = |of: &dyn Fn(usize) -> String| (0..groups.len()).map(of).collect::<Vec<_>>().join(" + ");
    let offsets = |group: &[[f32; 3]]| (four(&part(0), group), four(&part(1), group));
    let one = "vec4<f32>(1.0)";
    vec![
        ("WINDOW", each(&|k, _| format!("var<private> w{k}: vec4<f32>;\nvar<private> c{k}: vec4<f32>;"))),
        (
            "TEXELS",
            each(&|k, group| {
                let (values, farness) = (four(&value, group), four(&part(2), group));
                format!(
                    "let v{k} = {values} - centre;
let q{k} = v{k} * v{k} * p.likeness + 1.0;
let r{k} = 1.0 / ({farness} * q{k} * q{k});"
                )
            }),
        ),
        ("WEIGHTS", sum(&|k| format!("dot(r{k}, {one})"))),
        ("NORMED", each(&|k, _| format!("w{k} = r{k} * norm;\nlet f{k} = w{k} * v{k};"))),
        ("FIRST", sum(&|k| format!("dot(f{k}, {one})"))),
        ("SECOND", sum(&|k| format!("dot(f{k}, v{k})"))),
        ("CENTRED", each(&|k, _| format!("c{k} = f{k} - w{k} * mean;"))),
        (
            "CORRELATION",
            each(&|k, group| {
                let (dx, dy) = offsets(group);
                format!(
                    "{{
    let v = values(sample(i, warp, {dx}, {dy}));
    let weighted = w{k} * v;
    first += weighted;
    second = fma(weighted, v, second);
    product = fma(c{k}, v, product);
}}"
                )
            }),
        ),
        (
            "EQUATIONS",
            each(&|k, group| {
                let (dx, dy) = offsets(group);
                format!(
                    "{{
    let dx = {dx};
    let dy = {dy};
    let one = {one};
    let s = sample(i, warp, dx, dy);
    let v = values(s);
    let right = fma(s.fy, (s.d - s.c) - (s.b - s.a), s.b - s.a);
    let down = fma(s.fx, (s.d - s.b) - (s.c - s.a), s.c - s.a);
    let change = right * moved.x + down * moved.y;
    let value = w{k} * v;
    first += dot(value, one);
    second += dot(value, v);
    product += dot(c{k}, v);
    let weighted = w{k} * change;
    d += vec3<f32>(dot(weighted, one), dot(weighted, dx), dot(weighted, dy));
    let with_value = weighted * v;
    dv += vec3<f32>(dot(with_value, one), dot(with_value, dx), dot(with_value, dy));
    let of_reference = c{k} * change;
    dr += vec3<f32>(dot(of_reference, one), dot(of_reference, dx), dot(of_reference, dy));
    let twice = weighted * change;
    let across = twice * dx;
    let along = twice * dy;
    squares += vec3<f32>(dot(twice, one), dot(across, dx), dot(along, dy));
    products += vec3<f32>(dot(across, one), dot(along, one), dot(across, dy));
}}"
                )
            }),
        ),
    ]
}
