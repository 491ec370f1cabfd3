//! What the firmware costs: `docs/cost.md` is the table and the baseline, and this holds the firmware to it.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use object::{Object, ObjectSection, SectionFlags};
use weldpath_core::wire::{Command, Offset, WirePatch};
use weldpath_tests::qemu::{Client, Clock, Machine, Seen, Wire, firmware};

/// How far a figure may be from its baseline.
const TOLERANCE: f64 = 0.05;

#[test]
fn the_firmware_costs_what_the_table_says() {
    let (Some(cost), Some(program)) = (firmware("cost"), firmware("weldpath-firmware")) else { return };
    let mut measured = instructions(&cost);
    measured.extend(sizes(&program));
    measured.insert("stack high-water, bytes".into(), f64::from(stack(&program)));
    let (compiler, table) = table(&cost);
    assert_eq!(
        measured.keys().collect::<Vec<_>>(),
        table.keys().collect::<Vec<_>>(),
        "the rows of docs/cost.md"
    );
    for (name, row) in table {
        let now = measured[&name];
        println!("{name}: {now}, at most {}, {compiler} {:?}", row.hold, row.baseline);
        assert!(now <= row.hold, "{name}: {now} is more than {}", row.hold);
        if let Some(baseline) = row.baseline {
            let change = now / baseline - 1.0;
            assert!(change.abs() <= TOLERANCE, "{name}: {now} was {baseline}; if meant, change docs/cost.md");
        } else {
            println!("no baseline for {compiler}: printed, not judged");
        }
    }
}

/// Figures of the program that counts, by name.
fn instructions(program: &Path) -> BTreeMap<String, f64> {
    let machine = Machine::load(program, Wire::Socket, Clock::Instructions).expect("loads");
    let said = String::from_utf8(machine.run_to_end().expect("ends")).expect("text");
    let line = |line: &str| {
        let (name, count) = line.split_once('\t').expect("name, tab, count");
        (format!("{name}, instructions"), count.parse().expect("a number"))
    };
    said.lines().map(line).collect()
}

/// Bytes of flash and of RAM.
fn sizes(program: &Path) -> BTreeMap<String, f64> {
    const ALLOCATED: u64 = object::elf::SHF_ALLOC as u64;
    let bytes = fs::read(program).expect("built");
    let file = object::File::parse(bytes.as_slice()).expect("an ELF file");
    let (mut flash, mut ram) = (0, 0);
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else { continue };
        if sh_flags & ALLOCATED == 0 {
            continue;
        }
        let in_ram = section.address() >= 0x2000_0000;
        let stored = !matches!(section.kind(), object::SectionKind::UninitializedData);
        ram += if in_ram { section.size() } else { 0 };
        flash += if !in_ram || stored { section.size() } else { 0 };
    }
    [("flash, bytes", flash), ("data and bss, bytes", ram)].map(|(n, b)| (n.to_string(), b as f64)).into()
}

/// So often that the tick has come at the deepest place, too.
const SCORES: usize = 60;

/// Most stack used after the message that needs most, a full patch to score.
fn stack(program: &Path) -> u32 {
    let (machine, panel) = Machine::boot(program, Wire::Socket).expect("boots");
    let mut client = Client::new(machine.open_link().expect("opens"));
    client.connect(1).expect("a session");
    let points = (0..64).map(|k: i16| Offset { um: [k % 8 * 500, k / 8 * 500, k * 7 % 100] }).collect();
    let score = Command::Score(WirePatch { radius_um: 2_000, threshold_milli: 53_000, points });
    for _ in 0..SCORES {
        client.ask(score.clone()).expect("a score");
    }
    panel.send(b'?').expect("sent");
    match panel.wait_for(|seen| matches!(seen, Seen::Stack(_))).expect("an answer") {
        Seen::Stack(bytes) => bytes,
        other => unreachable!("{other:?}"),
    }
}

struct Row {
    hold: f64,
    baseline: Option<f64>,
}

/// The compiler that built the program, and the table's rows with the baseline for it.
fn table(program: &Path) -> (String, BTreeMap<String, Row>) {
    let folders = program.components().map(|part| part.as_os_str().to_string_lossy());
    let compiler = folders.into_iter().find_map(|name| Some(name.strip_prefix("rustc-")?.to_string()));
    let compiler = compiler.expect("the folder is named after the compiler");
    let text =
        fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/cost.md")).expect("docs/cost.md");
    let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_string()).collect::<Vec<_>>();
    let mut lines = text.lines().filter(|line| line.starts_with('|')).map(cells);
    let head = lines.next().expect("a table");
    let column = head.iter().position(|cell| *cell == format!("rustc {compiler}"));
    let number = |cell: &String| cell.replace(' ', "").parse::<f64>().ok();
    let row = |cells: Vec<String>| {
        let hold = number(&cells[2]).unwrap_or(f64::INFINITY);
        (cells[1].clone(), Row { hold, baseline: column.and_then(|at| number(&cells[at])) })
    };
    (compiler, lines.skip(1).map(row).collect())
}
