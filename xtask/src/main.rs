//! `cargo xtask web | test | demo | bench | fuzz | screens`: everything a person or CI does with this repository beside plain cargo.
//!
//! One file per task, with a folder for its parts: the stages of `test` and the suites with a report of their own, the benchmarks of `bench`.
//! `setup` holds the checks and installs they share, `process` how commands are run and shown, `test::tally` how the results of different test
//! runners are read. Exit codes are those of `kilwa`: 0 done, 1 something
//! failed (reported above), 2 usage.

mod bench;
mod bundle;
mod demo;
mod fuzz;
mod http;
mod process;
mod screens;
mod setup;
mod test;
mod web;

use clap::Parser;
use std::process::ExitCode;

/// Build the page, run all tests, show a demo, measure.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
enum Task {
    Web(web::Args),
    Test(test::Args),
    Demo(demo::Args),
    Fuzz(fuzz::Args),
    Bench(bench::Args),
    Screens(screens::Args),
}

fn main() -> ExitCode {
    let done = match Task::parse() {
        Task::Web(args) => web::run(&args),
        Task::Test(args) => test::run(&args),
        Task::Demo(args) => demo::run(&args),
        Task::Fuzz(args) => fuzz::run(&args),
        Task::Bench(args) => bench::run(&args),
        Task::Screens(args) => screens::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<test::Failed>() => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("xtask: {error:#}");
            ExitCode::FAILURE
        }
    }
}
