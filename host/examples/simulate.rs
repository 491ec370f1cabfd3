//! `cargo run --release --example simulate -- PART OUT [seed=1] [pose=flat] [noise=mid] [views=6] [size=640x480]
//! [weak=true] [format=png] [angle=60] [length=300]`: writes a scan with exact truth.

use std::error::Error;
use weldpath::simulation::{Request, simulate, write};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(part), Some(out)) = (arguments.next(), arguments.next()) else {
        return Err("usage: simulate PART OUT [seed=1] [pose=flat] [noise=mid] ...".into());
    };
    let mut request = Request::new(part.parse()?, 1);
    for argument in arguments {
        let (name, value) = argument.split_once('=').ok_or("settings look like seed=1")?;
        set(&mut request, name, value)?;
    }
    write(&simulate(&request)?, out.as_ref())?;
    Ok(())
}

fn set(request: &mut Request, name: &str, value: &str) -> Result<(), Box<dyn Error>> {
    match name {
        "seed" => request.seed = value.parse()?,
        "pose" => request.pose = value.parse()?,
        "noise" => request.noise = value.parse()?,
        "views" => request.views = Some(value.parse()?),
        "weak" => request.weak = value.parse()?,
        "format" => request.format = value.parse()?,
        "angle" => request.angle_deg = Some(value.parse()?),
        "length" => request.length_mm = Some(value.parse()?),
        "size" => {
            let (width, height) = value.split_once('x').ok_or("a size looks like 640x480")?;
            (request.width, request.height) = (width.parse()?, height.parse()?);
        }
        _ => return Err(format!("unknown setting `{name}`").into()),
    }
    Ok(())
}
