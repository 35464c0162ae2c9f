//! `tyndall devices`: the Vulkan devices of this machine, and what Tyndall lacks there.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};

use super::in_string;
use crate::Result;
use crate::passes::tuning::carry_of;
use crate::stats::{name_of, to_json};
use crate::vk::{self, DeviceInfo};

/// List Vulkan devices, their limits, and what Tyndall lacks there.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<String> {
    let devices = vk::list_devices()?;
    if args.json {
        return Ok(to_json(&devices.iter().map(object).collect::<Vec<_>>()));
    }
    Ok(devices.iter().enumerate().map(|(i, d)| text(i, d)).collect())
}

fn object(device: &DeviceInfo) -> Value {
    let limits: Map<String, Value> = device.limits.iter().map(|&(name, v)| (name.to_owned(), v.into())).collect();
    json!({
        "name": device.name,
        "driver": device.driver,
        "kind": device.kind,
        "api_version": device.api_version,
        "subgroup_size": device.subgroup_size,
        "carry": carry_of(device.driver_id),
        "limits": limits,
        "missing": device.missing,
    })
}

fn text(index: usize, device: &DeviceInfo) -> String {
    in_string(|out| {
        writeln!(
            out,
            "{index}: {} ({}), driver {}, Vulkan {}, subgroup size {}",
            device.name, device.kind, device.driver, device.api_version, device.subgroup_size
        )?;
        for (name, value) in &device.limits {
            writeln!(out, "     {name:<36} {value:>14}")?;
        }
        writeln!(out, "   scan and sort carry sums by {}", name_of(&carry_of(device.driver_id)))?;
        if device.missing.is_empty() {
            writeln!(out, "   Tyndall runs here")
        } else {
            writeln!(out, "   Tyndall cannot run here; missing: {}", device.missing.join(", "))
        }
    })
}
