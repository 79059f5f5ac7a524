//! `vamvs eval cloud`: a cloud against points of the true surface.

use anyhow::{Context, Result, bail};
use serde_json::json;
use vamvs::core::Similarity;
use vamvs::eval::page::length;
use vamvs::eval::{CloudProtocol, CloudScores};
use vamvs::io::{dtu, tnt};
use vamvs::measures::dtu::{DtuProtocol, DtuScores};
use vamvs::measures::tnt::{TntProtocol, TntScores};
use vamvs::measures::{Agreement, CloudErrors, CropVolume, Spread, VoxelMask};

use super::begin;
use super::table::Table;
use crate::arguments::{CloudPreset, DtuFlags, EvalCloudArguments, TntFlags};

/// Runs the command.
pub fn run(arguments: &EvalCloudArguments) -> Result<()> {
    begin(&arguments.general)?;
    let scores = protocol(arguments)?.scores(&arguments.cloud, &arguments.ground_truth)?;
    if arguments.general.json {
        say!("{}", json!(scores));
        return Ok(());
    }
    match &scores {
        CloudScores::Dtu(scores) => print_dtu(scores),
        CloudScores::Tnt(scores) => print_tnt(scores),
        CloudScores::Generic(errors) => print_errors(errors),
    }
    Ok(())
}

fn protocol(arguments: &EvalCloudArguments) -> Result<CloudProtocol> {
    let EvalCloudArguments { preset, thresholds, dtu, tnt, .. } = arguments;
    refuse_flags_of_others(arguments)?;
    match preset {
        CloudPreset::Generic => Ok(CloudProtocol::Generic { thresholds: thresholds.clone() }),
        CloudPreset::Dtu => dtu_protocol(dtu),
        CloudPreset::Tnt => tnt_protocol(tnt),
    }
}

/// Refuses flags of other presets, which this preset would ignore.
fn refuse_flags_of_others(arguments: &EvalCloudArguments) -> Result<()> {
    let EvalCloudArguments { preset, thresholds, dtu, tnt, .. } = arguments;
    let given = [
        (CloudPreset::Generic, !thresholds.is_empty(), "--thresholds belongs to --preset generic"),
        (CloudPreset::Dtu, dtu.is_given(), "--mask, --plane and --seed belong to --preset dtu"),
        (CloudPreset::Tnt, tnt.is_given(), "--tau, --crop, --align and --icp belong to --preset tnt"),
    ];
    match given.iter().find(|(of, is_given, _)| of != preset && *is_given) {
        Some((_, _, problem)) => bail!("{problem}: give that preset, or leave them out"),
        None => Ok(()),
    }
}

fn dtu_protocol(flags: &DtuFlags) -> Result<CloudProtocol> {
    let mask = flags.mask.as_ref().context("--preset dtu needs the scan's mask: --mask ObsMaskN_10.mat")?;
    let plane = flags.plane.as_ref().context("--preset dtu needs the scan's ground: --plane PlaneN.mat")?;
    let protocol = DtuProtocol::new(voxel_mask(dtu::read_mask(mask)?), dtu::read_plane(plane)?);
    Ok(CloudProtocol::Dtu(DtuProtocol { seed: flags.seed.unwrap_or(0), ..protocol }))
}

fn tnt_protocol(flags: &TntFlags) -> Result<CloudProtocol> {
    let align = flags.align.as_deref().map(tnt::read_alignment).transpose()?;
    let protocol = TntProtocol {
        tau: flags.tau.context("--preset tnt needs the scene's threshold: --tau, see --help")?,
        crop: flags.crop.as_deref().map(tnt::read_volume).transpose()?.map(crop_volume),
        ground_truth_from_cloud: align.unwrap_or_else(Similarity::identity),
    };
    Ok(CloudProtocol::Tnt { protocol, refine: flags.icp })
}

fn voxel_mask(dtu::Mask { low, high, side, size, inside }: dtu::Mask) -> VoxelMask {
    VoxelMask { low, high, side, size, inside }
}

fn crop_volume(tnt::Volume { axis, span, outline }: tnt::Volume) -> CropVolume {
    CropVolume { axis, span, outline }
}

fn print_dtu(scores: &DtuScores) {
    say!("{} points of the cloud after thinning", scores.thinned);
    let mut table = Table::new(&["mm", "mean", "median", "points"]);
    spread_row(&mut table, "accuracy", &scores.accuracy);
    spread_row(&mut table, "completeness", &scores.completeness);
    table.row(vec!["overall".to_owned(), length(scores.overall), length(scores.overall_median)]);
    table.print();
}

fn print_tnt(scores: &TntScores) {
    say!("{} points of the cloud, {} of the ground truth", scores.cloud_points, scores.ground_truth_points);
    print_agreement(&[scores.agreement]);
}

/// Prints distances in both directions, and the shares within thresholds.
pub fn print_errors(errors: &CloudErrors) {
    let mut table = Table::new(&["distance", "mean", "median", "points"]);
    spread_row(&mut table, "cloud to ground truth", &errors.accuracy);
    spread_row(&mut table, "ground truth to cloud", &errors.completeness);
    table.print();
    print_agreement(&errors.agreement);
}

fn print_agreement(agreement: &[Agreement]) {
    if agreement.is_empty() {
        return;
    }
    let mut table = Table::new(&["nearer than", "precision", "recall", "F-score"]);
    for at in agreement {
        let shares = [at.precision, at.recall, at.f_score].map(|share| format!("{share:.4}"));
        table.row([vec![length(at.threshold)], shares.to_vec()].concat());
    }
    table.print();
}

fn spread_row(table: &mut Table, name: &str, spread: &Spread) {
    table.row(vec![name.to_owned(), length(spread.mean), length(spread.median), spread.count.to_string()]);
}
