//! `cargo xtask report-check`: opens a report with a cloud in a headless browser and checks that it works.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde::Deserialize;
use vamvs_core::Size;
use vamvs_io::atomic;

use crate::picture::parse_size;

/// The script that is put into the page and reports errors and the contents of the canvas.
const PROBE: &str = include_str!("report_check.js");

/// Names of the browser's program, in order of preference within a folder of PATH.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// Open a report in headless Chromium and take a screenshot; fail on an empty cloud or any console message.
#[derive(Args)]
pub struct ReportCheck {
    /// The report, written by `vamvs report` or `vamvs reconstruct`.
    #[arg(value_name = "REPORT.html")]
    page: PathBuf,
    /// The screenshot to write.
    #[arg(long, value_name = "FILE.png", default_value = "report-check.png")]
    screenshot: PathBuf,
    /// Size of the window, pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x1600", value_parser = parse_size)]
    size: Size,
    /// Use the dark colour scheme.
    #[arg(long)]
    dark: bool,
}

/// What the probe reports.
#[derive(Debug, Deserialize)]
struct Seen {
    /// Errors in the page's scripts.
    errors: Vec<String>,
    /// Share of the canvas's pixels that are not transparent, 0 to 1; `None` if there is no canvas.
    drawn: Option<f64>,
    /// How much wider the page is than the window, pixels.
    overflow: i64,
}

impl ReportCheck {
    pub fn run(&self) -> Result<()> {
        let browser = browser()?;
        let folder = std::env::temp_dir().join(format!("vamvs-report-check-{}", std::process::id()));
        std::fs::create_dir_all(&folder).with_context(|| format!("{} cannot be made", folder.display()))?;
        let looked = self.look(&browser, &folder);
        std::fs::remove_dir_all(&folder)
            .with_context(|| format!("{} cannot be removed", folder.display()))?;
        let (seen, said) = looked?;
        ensure!(seen.errors.is_empty(), "the page's scripts failed: {}", seen.errors.join("; "));
        let console: Vec<&str> = said.lines().filter(|line| line.contains(":CONSOLE")).collect();
        ensure!(console.is_empty(), "the browser's console says: {}", console.join("; "));
        let drawn = seen.drawn.context("the page has no cloud: was anything fused?")?;
        ensure!(drawn > 0.005, "the cloud's canvas is empty");
        ensure!(seen.overflow <= 0, "the page is {} pixels wider than the window", seen.overflow);
        println!("{}: {:.1} % of the canvas drawn on", self.screenshot.display(), 100.0 * drawn);
        Ok(())
    }

    /// Opens a copy of the page with the probe in it. Returns the probe's report and the browser's messages.
    fn look(&self, browser: &Path, folder: &Path) -> Result<(Seen, String)> {
        let html = std::fs::read_to_string(&self.page)
            .with_context(|| format!("{} cannot be read", self.page.display()))?;
        let probed = html.replacen("<head>", &format!("<head><script>{PROBE}</script>"), 1);
        let copy = folder.join("page.html");
        atomic::write(&copy, |out| out.write_all(probed.as_bytes()))?;
        let screenshot = std::path::absolute(&self.screenshot)?;
        let Size { width, height } = self.size;
        let mut command = Command::new(browser);
        command.args(["--headless", "--no-sandbox", "--hide-scrollbars", "--enable-logging=stderr"]);
        command.args([
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--virtual-time-budget=20000",
        ]);
        command.args(self.dark.then_some("--blink-settings=preferredColorScheme=0"));
        command.arg(format!("--user-data-dir={}", folder.join("profile").display()));
        command.arg(format!("--window-size={width},{height}"));
        command.arg(format!("--screenshot={}", screenshot.display())).arg("--dump-dom");
        let output = command.arg(format!("file://{}", copy.display())).output().context("the browser")?;
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        ensure!(output.status.success(), "the browser failed ({}): {said}", output.status);
        let seen = seen(&String::from_utf8_lossy(&output.stdout));
        Ok((seen.with_context(|| format!("the page was not loaded completely: {said}"))?, said))
    }
}

/// The probe's report, which it wrote into the page; `None` if the page was not loaded completely.
fn seen(dom: &str) -> Option<Seen> {
    let (_, after) = dom.split_once("id=\"probe\">")?;
    serde_json::from_str(after.split_once("</script>")?.0).ok()
}

fn browser() -> Result<PathBuf> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let files = std::env::split_paths(&folders).flat_map(|folder| BROWSERS.map(|name| folder.join(name)));
    files.into_iter().find(|file| file.is_file()).with_context(|| {
        format!(
            "no browser on PATH: install Chromium (one of {}), as with `apt-get install chromium`",
            BROWSERS.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_probe_is_found_in_the_page() {
        let dom = "<html><script type=\"application/json\" id=\"probe\">{\"errors\":[\"a\"],\"drawn\":0.25,\"overflow\":-3}</script>";
        let found = seen(dom).unwrap();
        assert_eq!((found.errors, found.drawn, found.overflow), (vec!["a".to_owned()], Some(0.25), -3));
        assert!(seen("<html></html>").is_none());
    }
}
