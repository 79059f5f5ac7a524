//! The tracer's results, compared with analytic surfaces, brute-force ray casting and closed forms.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

mod brute_force;
mod ground_truth;
mod light;
mod visibility;
mod worlds;
