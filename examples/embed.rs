//! The library in forty lines: a COLMAP model in, a cloud out.
//! `cargo run --release -p vamvs --example embed -- sparse/0 images out`

use std::path::PathBuf;

use vamvs::depth::DepthJob;
use vamvs::io::{Loaded, masks::Masks};
use vamvs::net::{Device, Estimator, EstimatorOptions};
use vamvs::{
    DepthOptions, Event, ExportOptions, FusionOptions, Input, Maps, OutputFolder, Photographs, VamvsError,
    weights,
};

fn main() -> Result<(), VamvsError> {
    let [model, images, out] = [1, 2, 3].map(|n| PathBuf::from(std::env::args().nth(n).unwrap_or_default()));
    let (depth, fusion) = (DepthOptions::default(), FusionOptions::default());
    let mut show = |event: Event| eprintln!("{event:?}");

    let input = Input::Colmap { model, images };
    let Loaded { scene, images, masks, .. } = input.load()?;
    let photographs = Photographs::new(&images, masks, &depth);
    let plan = vamvs::plan(&scene, &photographs, &depth)?;

    let network = weights::load(None, Device::Cpu)?;
    let options = EstimatorOptions::of(&network);
    let estimator = Estimator::new(network, options)?;
    let output = OutputFolder::new(&out);
    let module = weights::bytes(None)?;
    let job = DepthJob {
        scene: &scene,
        photographs: &photographs,
        plan: &plan,
        estimator: &estimator,
        module: &module,
        options: &depth,
        output: &output,
        force: false,
    };
    vamvs::estimate(&job, &mut show)?;
    let maps = Maps::open(&out, Masks::None, &mut show)?;
    let fused = vamvs::fuse(&maps, &output.cloud(), &fusion, &ExportOptions::default(), &mut show)?;
    println!("{} points from {} views", fused.points, fused.views.len());
    Ok(())
}
