//! The kernels: WGSL with the constants of the network filled in, and loops unrolled where they must be.

use std::fmt::Write;

use vamvs_corr::layers::{BEHIND, ONE_SURFACE, REACH, UNSEEN};

/// A kernel, and how many invocations work in a group.
pub struct Kernel {
    pub pipeline: wgpu::ComputePipeline,
    pub group: [u32; 2],
}

/// Outputs along a row that an invocation of a convolution makes, and vectors of four channels of each.
#[derive(Clone, Copy, Debug)]
pub struct Tile {
    pub pixels: usize,
    pub vectors: usize,
}

/// For layers of at most eight output channels.
pub const NARROW: Tile = Tile { pixels: 8, vectors: 2 };

/// For all others.
pub const WIDE: Tile = Tile { pixels: 4, vectors: 4 };

/// All of them.
pub struct Kernels {
    pub narrow: Kernel,
    pub wide: Kernel,
    pub to_one: Kernel,
    pub part: Kernel,
    /// Of maps with vectors of channels.
    pub enlarge: Kernel,
    /// Of maps with one channel.
    pub enlarge_ones: Kernel,
    pub image: Kernel,
    pub pool: Kernel,
    pub weigh: Kernel,
    pub shares: Kernel,
    pub planes: Kernel,
    pub candidates: Kernel,
    pub choose: Kernel,
    pub evidence: Kernel,
}

/// Invocations in a group of kernels over images, and of those over pixels in a row.
pub const IMAGE: [u32; 2] = [8, 8];
const ROW: [u32; 2] = [64, 1];

impl Kernels {
    pub fn new(device: &wgpu::Device) -> Self {
        let mut sources = sources().into_iter();
        let mut next = |group| {
            let (name, source) = sources.next().expect("a source for each kernel");
            kernel(device, name, source, group)
        };
        Self {
            narrow: next(IMAGE),
            wide: next(IMAGE),
            to_one: next(IMAGE),
            part: next(IMAGE),
            enlarge: next(IMAGE),
            enlarge_ones: next(IMAGE),
            image: next(IMAGE),
            pool: next(IMAGE),
            weigh: next(IMAGE),
            shares: next(ROW),
            planes: next(ROW),
            candidates: next(IMAGE),
            choose: next(IMAGE),
            evidence: next(ROW),
        }
    }
}

/// A kernel from its source.
pub fn kernel(device: &wgpu::Device, name: &str, source: String, group: [u32; 2]) -> Kernel {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(name),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(name),
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    Kernel { pipeline, group }
}

/// Names and sources in the order of [`Kernels`].
fn sources() -> [(&'static str, String); 14] {
    let enlarge = include_str!("shaders/enlarge.wgsl");
    let sweep = filled(include_str!("shaders/sweep.wgsl"), &[("BEHIND", literal(BEHIND))]);
    let text = |source: &str| source.to_owned();
    [
        ("narrow convolution", convolution(NARROW)),
        ("convolution", convolution(WIDE)),
        ("convolution to one channel", text(include_str!("shaders/to_one.wgsl"))),
        ("part", text(include_str!("shaders/part.wgsl"))),
        ("enlarge", filled(enlarge, &[("VALUE", text("vec4<f32>"))])),
        ("enlarge one channel", filled(enlarge, &[("VALUE", text("f32"))])),
        ("image", text(include_str!("shaders/image.wgsl"))),
        ("pool", sweep.clone() + include_str!("shaders/pool.wgsl")),
        ("weigh", sweep + include_str!("shaders/weigh.wgsl")),
        ("shares", filled(include_str!("shaders/shares.wgsl"), &[("UNSEEN", literal(UNSEEN))])),
        ("planes", text(include_str!("shaders/planes.wgsl"))),
        ("candidates", filled(include_str!("shaders/candidates.wgsl"), &[("REACH", literal(REACH))])),
        ("choose", filled(include_str!("shaders/choose.wgsl"), &[("ONE_SURFACE", literal(ONE_SURFACE))])),
        ("evidence", text(include_str!("shaders/evidence.wgsl"))),
    ]
}

/// A number as WGSL has it.
pub fn literal(value: f32) -> String {
    format!("{value:?}f")
}

/// The source with each name between braces replaced.
pub fn filled(source: &str, names: &[(&str, String)]) -> String {
    names.iter().fold(source.to_owned(), |text, (name, value)| text.replace(&format!("{{{name}}}"), value))
}

/// The convolution for a tile, unrolled.
fn convolution(Tile { pixels, vectors }: Tile) -> String {
    let mut parts: [String; 4] = Default::default();
    let [sums, places, products, writes] = &mut parts;
    let line = |to: &mut String, text: String| writeln!(to, "{text}").expect("a string takes all text");
    for pixel in 0..pixels {
        line(places, format!("let x{pixel} = i32((x + {pixel}u) * p.stride) + tap.z + pixel;"));
        line(places, format!("let inside{pixel} = x{pixel} >= 0 && x{pixel} < i32(p.in_sides.z);"));
        let inside = format!("clamp(x{pixel}, 0, i32(p.in_sides.z) - 1)");
        line(places, format!("let from{pixel} = (line + u32({inside})) * p.in_vectors;"));
        line(
            products,
            format!("let in{pixel} = select(vec4<f32>(0.0), input[from{pixel} + c], inside{pixel});"),
        );
    }
    for vector in 0..vectors {
        for pixel in 0..pixels {
            line(sums, format!("var sum{pixel}_{vector} = weights[shift + {vector}u];"));
            let place = format!("place + vec3<u32>({pixel}u * p.step, 0u, 0u)");
            line(writes, format!("write(sum{pixel}_{vector}, {place}, vector + {vector}u);"));
        }
    }
    for (row, lane) in ["x", "y", "z", "w"].into_iter().enumerate() {
        for vector in 0..vectors {
            let weight = format!("w{row}_{vector}");
            line(products, format!("let {weight} = weights[at + {}u];", row * vectors + vector));
            for pixel in 0..pixels {
                let sum = format!("sum{pixel}_{vector}");
                line(products, format!("{sum} = fma(vec4<f32>(in{pixel}.{lane}), {weight}, {sum});"));
            }
        }
    }
    let [sums, places, products, writes] = parts;
    let names = [
        ("TILE", pixels.to_string()),
        ("VECTORS", vectors.to_string()),
        ("SUMS", sums),
        ("PLACES", places),
        ("PRODUCTS", products),
        ("WRITES", writes),
    ];
    filled(include_str!("shaders/convolution.wgsl"), &names)
}

#[cfg(test)]
mod tests {
    use naga::front::wgsl;
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    #[test]
    fn all_kernels_are_valid() {
        let matching = [1, 2, 16].into_iter().flat_map(crate::matching_kernels::sources);
        for (name, source) in super::sources().into_iter().chain(matching) {
            let module = wgsl::parse_str(&source)
                .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&source)));
            let checked = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
            assert!(checked.is_ok(), "{name}: {checked:?}");
            let left =
                source.match_indices('{').find(|(at, _)| source[at + 1..].starts_with(char::is_uppercase));
            assert!(left.is_none(), "{name}: a name is not filled in");
        }
    }
}
