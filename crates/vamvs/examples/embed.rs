//! The library in a few lines: a COLMAP model in, a cloud out.
//! `cargo run --release -p vamvs --example embed -- sparse/0 images out`

use std::ops::ControlFlow;
use std::path::PathBuf;

use vamvs::{Input, Reconstruction, VamvsError};

fn main() -> Result<(), VamvsError> {
    let [model, images, out] = [1, 2, 3].map(|n| PathBuf::from(std::env::args().nth(n).unwrap_or_default()));
    let scene = Input::Colmap { model, images: Some(images) }.load()?;
    let done = Reconstruction::new(scene).run(&out, &mut |event| {
        eprintln!("{event:?}");
        ControlFlow::Continue(())
    })?;
    println!("{} points from {} views", done.fusion.points, done.depth.made + done.depth.resumed);
    Ok(())
}
