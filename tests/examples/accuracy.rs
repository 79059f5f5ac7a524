//! Depth accuracy of a network on the rendered still life, stage by stage: `accuracy MODULE WIDTH HEIGHT VIEWS PLANES`.
//! VIEWS counts the reference view, 2 to 9. Each depth is compared with the mean of the four true depths around the
//! centre of its pixel, or with the pixel's own at full size; pixels at depth discontinuities are left out.

use vamvs_core::{DepthRange, Grid, Planes, Size, Spacing};
use vamvs_net::{Device, Estimator, EstimatorOptions, Network, Profile};
use vamvs_tests::fixtures;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize| arguments[index].parse::<usize>();
    let (size, views, count) = (Size::new(number(1)?, number(2)?), number(3)?, number(4)?);
    let rendered = fixtures::still_life(size, 9);
    let network = Network::load(arguments[0].as_ref(), Device::Cpu)?;
    let options = EstimatorOptions::of(&network);
    let estimator = Estimator::new(network, options)?;
    let encoded: Vec<_> = rendered
        .iter()
        .map(|view| vamvs_net::tch::no_grad(|| estimator.network().encode(&view.photo)))
        .collect::<Result<_, _>>()?;
    let reference = 4;
    let order = [3, 5, 2, 6, 1, 7, 0, 8];
    let sources: Vec<_> = order[..views - 1].iter().map(|&i| &encoded[i]).collect();
    let ground_truth = &rendered[reference].depth;
    let valid: Vec<f32> = ground_truth.data().iter().copied().filter(|d| *d > 0.0).collect();
    let near = valid.iter().copied().fold(f32::MAX, f32::min);
    let far = valid.iter().copied().fold(0.0, f32::max);
    let planes = Planes {
        range: DepthRange::try_new(f64::from(near) * 0.95, f64::from(far) * 1.05)?,
        count,
        spacing: Spacing::Depth,
    };
    let mut profile = Profile::default();
    let stages = vamvs_net::tch::no_grad(|| {
        estimator.stages(&encoded[reference], &sources, &planes, None, &mut profile)
    })?;
    let unit = (planes.range.far - planes.range.near) / (count - 1) as f64;
    println!("range {near} {far}, plane distance {unit:.4}");
    for (index, stage) in stages.iter().enumerate() {
        let shape = stage.u.size();
        let size = Size::new(shape[1] as usize, shape[0] as usize);
        let u = Grid::from_vec(size, Vec::<f32>::try_from(stage.u.contiguous().flatten(0, -1))?);
        report(index, &u, ground_truth, &planes);
    }
    Ok(())
}

fn report(index: usize, u: &Grid<f32>, ground_truth: &Grid<f32>, planes: &Planes) {
    let scale = ground_truth.width() / u.width();
    let mut errors = Vec::new();
    for y in 0..u.height() {
        for x in 0..u.width() {
            let (tx, ty) = (x * scale + scale / 2, y * scale + scale / 2);
            let t = if scale == 1 {
                ground_truth[(x, y)]
            } else {
                let q = [
                    ground_truth[(tx, ty)],
                    ground_truth[(tx - 1, ty)],
                    ground_truth[(tx, ty - 1)],
                    ground_truth[(tx - 1, ty - 1)],
                ];
                let (lo, hi) =
                    (q.iter().copied().fold(f32::MAX, f32::min), q.iter().copied().fold(0.0, f32::max));
                if hi > lo * 1.02 {
                    continue;
                } // a depth discontinuity
                q.iter().sum::<f32>() / 4.0
            };
            errors.push((planes.depth(f64::from(u[(x, y)])) - f64::from(t)).abs() / f64::from(t));
        }
    }
    errors.sort_by(f64::total_cmp);
    let share = |limit: f64| errors.partition_point(|e| *e < limit) as f64 / errors.len() as f64;
    println!(
        "stage {index}: median {:.5}, within 0.1% {:.3}, 0.2% {:.3}, 0.5% {:.3}, 1% {:.3}, 2% {:.3}, 5% {:.3}",
        errors[errors.len() / 2],
        share(0.001),
        share(0.002),
        share(0.005),
        share(0.01),
        share(0.02),
        share(0.05)
    );
}
