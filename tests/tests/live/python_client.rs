//! The protocol document is enough to write a host from: `tests/pendant_client.py` was, and here it welds with the real firmware.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use weldpath_tests::qemu::operator::{GRIPPED, RELEASED};
use weldpath_tests::qemu::{Machine, Wire, firmware};

#[test]
fn a_host_in_python_loads_starts_holds_attaches_anew_resumes_and_finishes() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let (machine, panel) = Machine::boot(&program, Wire::Socket).expect("boots");
    let address = machine.address();
    let socket = address.strip_prefix("unix:").expect("a socket");
    let mut host = Command::new("python3")
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/pendant_client.py"))
        .arg(socket)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python3");
    let said = BufReader::new(host.stdout.take().expect("piped")).lines().map_while(Result::ok);
    let mut orders = Vec::new();
    for order in said {
        match order.as_str() {
            "release" => panel.set(RELEASED).expect("released"),
            "grip" => panel.set(GRIPPED).expect("gripped"),
            "confirm" => panel.confirm().expect("pressed"),
            "reset" => {
                panel.reset(RELEASED).expect("pressed");
                sleep(Duration::from_millis(50));
            }
            _ => {}
        }
        orders.push(order);
    }
    assert!(host.wait().expect("ends").success(), "{orders:?}");
    assert_eq!(orders.last().map(String::as_str), Some("finished"), "{orders:?}");
    assert!(orders.iter().filter(|order| *order == "grip").count() >= 3, "{orders:?}");
}
