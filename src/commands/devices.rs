use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use worker::{DeviceKind, Probed};

use crate::device;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Test only this device, and fail if it does not work
    #[arg(value_name = "NAME")]
    device: Option<DeviceKind>,

    /// Test it in this process, and print JSON
    #[arg(long, hide = true, requires = "device")]
    in_this_process: bool,
}

pub async fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let mut table = Table::new([
        ("device", Align::Left),
        ("computed by", Align::Left),
        ("on", Align::Left),
        ("first result", Align::Right),
    ]);
    let row = |kind: DeviceKind, on: String, seconds: Option<f64>| {
        let seconds = seconds.map_or_else(String::new, |seconds| format!("{seconds:.2} s"));
        vec![kind.name().to_owned(), kind.backend().to_owned(), on, seconds]
    };
    match arguments.device {
        Some(kind) if arguments.in_this_process => {
            let probed = worker::try_device(kind)?;
            println!("{}", serde_json::to_string(&probed)?);
            return Ok(ExitCode::SUCCESS);
        }
        Some(kind) => {
            let probed = device::probe(kind).await?;
            table.push(row(kind, hardware(&probed), Some(probed.seconds)));
        }
        None => {
            for kind in DeviceKind::ALL {
                table.push(match kind.feature() {
                    Some(feature) if !kind.is_built() => {
                        row(kind, format!("not built in: --features {feature}"), None)
                    }
                    _ => match device::probe(kind).await {
                        Ok(probed) => row(kind, hardware(&probed), Some(probed.seconds)),
                        Err(error) => row(kind, error.to_string(), None),
                    },
                });
            }
        }
    }
    print!("{}", table.render());
    Ok(ExitCode::SUCCESS)
}

/// The name of the hardware, as its driver gives it.
fn hardware(Probed { device, .. }: &Probed) -> String {
    match (&device.adapter, &device.driver) {
        (Some(adapter), Some(driver)) => format!("{adapter}, {driver}"),
        (Some(adapter), None) => adapter.clone(),
        (None, _) => "this processor".to_owned(),
    }
}
