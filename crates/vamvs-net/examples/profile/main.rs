//! Prints the time and the speed of one depth map, stage by stage, and its peak memory:
//! `profile MODULE WIDTH HEIGHT VIEWS PLANES [COARSE_STRIDE]`.

mod arithmetic;

use nalgebra::Vector3;
use vamvs_core::{DepthRange, Grid, Intrinsics, Photo, Pinhole, Planes, Pose, Size, Spacing};
use vamvs_net::{Device, Estimator, EstimatorOptions, Network, Profile, Stage};

/// The allocator of the command, which serves libtorch too.
#[global_allocator]
static MIMALLOC: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize| arguments[index].parse::<usize>();
    let (size, views, count) = (Size::new(number(1)?, number(2)?), number(3)?, number(4)?);
    let mut network = Network::load(arguments[0].as_ref(), Device::Cpu)?;
    if arguments.len() > 5 {
        network.set_coarse_stride(number(5)?)?;
    }
    let operations = arithmetic::operations(&network, size, views, count)?;
    let loaded = peak_mib();
    let options = EstimatorOptions::of(&network);
    let estimator = Estimator::new(network, options)?;
    let photos: Vec<_> = (0..views).map(|index| photo(size, index)).collect();
    let planes = Planes { range: DepthRange::try_new(4.0, 9.0)?, count, spacing: Spacing::Depth };
    let mut profile = Profile::default();
    let encoded = profile.time(Stage::Encode, || {
        vamvs_net::tch::no_grad(|| {
            photos.iter().map(|photo| estimator.encode(photo)).collect::<Result<Vec<_>, _>>()
        })
    })?;
    let sources: Vec<_> = encoded[1..].iter().collect();
    estimator.estimate(&encoded[0], &sources, &planes, &mut profile)?;
    for stage in Stage::ALL {
        let (seconds, operations) = (profile.spent(stage).as_secs_f64(), operations[stage as usize]);
        let speed = if operations > 0.0 {
            format!(" {:.1} GFLOP/s", 1e-9 * operations / seconds)
        } else {
            String::new()
        };
        println!("{stage:?} {seconds:.3} s{speed}");
    }
    let estimated = (estimator.peak_bytes(size, views, count) >> 20) + loaded;
    println!(
        "total {:.3} s, loaded {loaded} MiB, peak {} MiB, estimated {estimated} MiB",
        profile.total().as_secs_f64(),
        peak_mib()
    );
    Ok(())
}

fn photo(size: Size, index: usize) -> Photo {
    let eye = Vector3::new(0.3 * index as f64, 0.0, 0.0);
    Photo {
        camera: Pinhole {
            size,
            intrinsics: Intrinsics {
                fx: size.width as f64,
                fy: size.width as f64,
                cx: size.width as f64 / 2.0,
                cy: size.height as f64 / 2.0,
            },
        },
        cam_from_world: Pose::look_at(&eye, &Vector3::new(0.0, 0.0, 6.0), &Vector3::new(0.0, -1.0, 0.0)),
        image: Grid::from_fn(size, |x, y| [((x * 7 + index * 13) ^ (y * 3)) as u8, (x * y) as u8, y as u8]),
        mask: None,
    }
}

fn peak_mib() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("0");
    line.split_whitespace().next().and_then(|kib| kib.parse::<usize>().ok()).unwrap_or(0) / 1024
}
