//! Time and speed of each convolution of the network on one thread, on maps of the sizes that a photograph gives it:
//! `cargo run --release -p vamvs-corr --example layers -- WEIGHTS.safetensors WIDTH HEIGHT PLANES`.

use std::time::{Duration, Instant};

use vamvs_corr::Network;
use vamvs_corr::layers::{Convolution, Map, Pyramid, VolumeNet};

/// The shortest of so many runs counts.
const RUNS: usize = 5;

/// A layer and how many of its input's pixels lie along one of the first layer's.
type Listed<'a> = (&'static str, &'a Convolution, usize);

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    assert_eq!(arguments.len(), 4, "expected WEIGHTS.safetensors WIDTH HEIGHT PLANES");
    let numbers: Vec<usize> = arguments[1..].iter().map(|text| text.parse().expect("a number")).collect();
    let [width, height, planes] = numbers[..] else { unreachable!("there are three numbers") };
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("no threads have run yet");
    let weights = std::fs::read(&arguments[0]).expect("the weights can be read");
    let network = Network::new(&weights).expect("the weights are those of a vis-corr");
    let layers = network.layers();
    print_part("features", &pyramid(&layers.pyramid), [1, height, width]);
    let (coarse, fine) = ([height / 8, width / 8], [height / 4, width / 4]);
    for (name, net, planes, [height, width]) in [
        ("all planes", &layers.coarse, planes, coarse),
        ("planes around the depth", &layers.fine, network.manifest().cascade.planes, fine),
    ] {
        print_part(name, &volume(net), [planes, height, width]);
        print_part(&format!("{name}, gates"), &gates(net), [1, height, width]);
    }
}

fn pyramid(net: &Pyramid) -> Vec<Listed<'_>> {
    let [down1, down2, down3] = &net.down;
    let [down4, down5] = &net.deep;
    vec![
        ("down1.0", &down1[0], 1),
        ("down1.1", &down1[1], 2),
        ("down2.0", &down2[0], 2),
        ("down2.1", &down2[1], 4),
        ("down2.2", &down2[2], 4),
        ("down3.0", &down3[0], 4),
        ("down3.1", &down3[1], 8),
        ("down3.2", &down3[2], 8),
        ("down4.0", &down4[0], 8),
        ("down4.1", &down4[1], 16),
        ("down5.0", &down5[0], 16),
        ("down5.1", &down5[1], 32),
        ("up4", &net.up4, 32),
        ("up3", &net.up3, 16),
        ("side3", &net.side3, 8),
        ("up2", &net.up2, 8),
        ("side2", &net.side2, 4),
        ("out2", &net.out2, 4),
    ]
}

fn volume(net: &VolumeNet) -> Vec<Listed<'_>> {
    vec![
        ("same", &net.same, 1),
        ("scale2", &net.scale2, 1),
        ("scale2_same", &net.scale2_same, 2),
        ("scale4", &net.scale4, 2),
        ("scale4_same", &net.scale4_same, 4),
        ("deep4.first", &net.deep4[0], 4),
        ("deep4.second", &net.deep4[1], 4),
        ("scale8", &net.scale8, 4),
        ("scale8_same", &net.scale8_same, 8),
        ("deep8, four", &net.deep8[0][0], 8),
        ("up4", &net.up4, 8),
        ("up2", &net.up2, 4),
        ("up1", &net.up1, 2),
    ]
}

fn gates(net: &VolumeNet) -> Vec<Listed<'_>> {
    let gates = &net.gates;
    vec![
        ("side1", &gates.sides[0], 1),
        ("side2", &gates.sides[1], 1),
        ("side4", &gates.sides[2], 2),
        ("side8.0", &gates.sides[3], 4),
        ("side8.1", &gates.last8, 8),
    ]
}

/// Prints the time and the speed of the layers of a part, whose first input has these sides, and their sums.
fn print_part(part: &str, layers: &[Listed<'_>], [planes, height, width]: [usize; 3]) {
    let (mut time, mut operations) = (Duration::ZERO, 0);
    for (name, layer, stride) in layers {
        let sides = [planes.div_ceil(*stride), height.div_ceil(*stride), width.div_ceil(*stride)];
        let input = Map::by_rows(sides, layer.inputs, |row, values| {
            for (at, value) in values.iter_mut().enumerate() {
                *value = ((row.z * 3 + row.y * 5 + at * 7) % 11) as f32 - 5.0;
            }
        });
        let of_layer = (0..RUNS).map(|_| {
            let begin = Instant::now();
            std::hint::black_box(layer.run(&input, |_, _| ()));
            begin.elapsed()
        });
        let of_layer = of_layer.min().expect("there are runs");
        print_line(&format!("{part}, {name}"), of_layer, layer.operations(sides));
        time += of_layer;
        operations += layer.operations(sides);
    }
    print_line(part, time, operations);
}

fn print_line(name: &str, time: Duration, operations: u64) {
    let (seconds, operations) = (time.as_secs_f64(), operations as f64 / 1e9);
    println!(
        "{name:40} {:8.2} ms {operations:7.2} GFLOP {:6.0} GFLOP/s",
        1e3 * seconds,
        operations / seconds
    );
}
