//! `path.script` does on a robot what the plan says, and the checks below refuse a script that does not.

use std::path::Path;

use nalgebra::Vector3;
use weldpath::robot::dialect::Dialect;
use weldpath::run::job::Job;
use weldpath::run::postprocessing::{Output, postprocess};
use weldpath::weld::program::{Kind, Waypoint};
use weldpath_tests::plans;
use weldpath_tests::robot::{self, HOME_DEG, STEP_S, Stop, standing, standing_as};
use weldpath_tests::urscript::{Event, Inputs, Move, Program, Resumed, Robot, run};

const JOB: &str = r#"
[path]
standoff_mm = 3
[arc]
output = 2
gas_output = 5
established_input = 1
[tool]
flange_from_tcp_mm = [0, -50, 300]
flange_from_tcp_rotation_rad = [0, 0.5, 0]
payload_kg = 2.5
"#;

fn job(text: &str) -> Job {
    Job::parse(text, Path::new("job.toml")).unwrap()
}

fn output(job: &Job) -> Output {
    postprocess(&plans::pipe_and_bend(), job, Default::default()).unwrap()
}

fn script(output: &Output) -> String {
    let file = output.files.iter().find(|file| file.name == "path.script").unwrap();
    String::from_utf8(file.bytes.clone()).unwrap()
}

/// All the rules at once; the first that is broken is named.
fn check(script: &str, waypoints: &[Waypoint], job: &Job) -> Result<(), String> {
    let events = run(script, true)?;
    let moves: Vec<&Move> = events.iter().filter_map(a_move).collect();
    switching(&events, waypoints, job)?;
    poses_equal(&moves, waypoints)?;
    blends(&moves, waypoints)?;
    rotation_vectors_continue(&moves)?;
    dwells(&events, waypoints)?;
    tool(&events, job)?;
    let halts = || run(script, false).map(|events| events.last() == Some(&Event::Halt));
    require(job.arc.established_input.is_none() || halts()?, || "welds without an arc".into())
}

fn a_move(event: &Event) -> Option<&Move> {
    match event {
        Event::Move(a_move) => Some(a_move),
        _ => None,
    }
}

fn require(condition: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if condition { Ok(()) } else { Err(what()) }
}

fn poses_equal(moves: &[&Move], waypoints: &[Waypoint]) -> Result<(), String> {
    require(moves.len() == waypoints.len(), || format!("{} moves", moves.len()))?;
    for (i, (a_move, waypoint)) in moves.iter().zip(waypoints).enumerate() {
        let away_mm = (a_move.position_m * 1e3 - waypoint.position_mm.coords).norm();
        require(away_mm < 1e-4, || format!("move {i} ends {away_mm} mm away"))?;
        let turned_rad = (a_move.rotation() - robot::tool(waypoint)).norm() / std::f64::consts::SQRT_2;
        require(turned_rad < 1e-4, || format!("move {i} is turned by {turned_rad} rad"))?;
        let feed_off = (a_move.speed * 1e3 - waypoint.feed_mm_s).abs();
        // Eight decimals of metres per second.
        require(i == 0 || feed_off < 1e-5, || format!("move {i} has speed {}", a_move.speed))?;
    }
    Ok(())
}

fn blends(moves: &[&Move], waypoints: &[Waypoint]) -> Result<(), String> {
    for i in 0..moves.len() {
        let welded_on = i > 0 && waypoints[i].weld && waypoints[i - 1].weld;
        let passes = waypoints[i].dwell_s.is_none();
        let goes_on = waypoints.get(i + 1).is_some_and(|next| next.weld && welded_on && passes);
        require((moves[i].command == "movep") == welded_on, || {
            format!("move {i} is a {}", moves[i].command)
        })?;
        let blend_m = moves[i].blend_m;
        if goes_on {
            let segment = |a: usize, b: usize| (moves[b].position_m - moves[a].position_m).norm();
            let shorter = segment(i - 1, i).min(segment(i, i + 1));
            require(blend_m < 0.5 * shorter, || format!("move {i}: blend {blend_m} of {shorter}"))?;
            require(blend_m > 0.0, || format!("move {i} stops amid the seam"))?;
        } else {
            require(blend_m == 0.0, || format!("move {i} does not arrive: blend {blend_m}"))?;
        }
    }
    Ok(())
}

/// During a weld the torch stands where the plan says, as long as it says, and nowhere else; at its ends at least so long.
fn dwells(events: &[Event], waypoints: &[Waypoint]) -> Result<(), String> {
    let after_moves = events.split(|event| a_move(event).is_some()).skip(1);
    for (i, (after, waypoint)) in after_moves.zip(waypoints).enumerate() {
        let sleeps: Vec<f64> =
            after.iter().filter_map(|e| if let Event::Sleep(s) = e { Some(*s) } else { None }).collect();
        let wanted = waypoint.dwell_s.filter(|dwell_s| *dwell_s > 0.0);
        let welds = |k: Option<usize>| k.and_then(|k| waypoints.get(k)).is_some_and(|w| w.weld);
        let amid = waypoint.weld && welds(i.checked_sub(1)) && welds(Some(i + 1));
        require(wanted.is_none_or(|s| sleeps.contains(&s)), || format!("move {i}: no dwell of {wanted:?}"))?;
        require(!amid || sleeps.len() == usize::from(wanted.is_some()), || {
            format!("move {i}: stands {sleeps:?}")
        })?;
    }
    Ok(())
}

/// A step of the vector is not longer than the rotation it stands for, but for the bending of its space.
fn rotation_vectors_continue(moves: &[&Move]) -> Result<(), String> {
    for (i, w) in moves.windows(2).enumerate() {
        let step = (w[1].rotation_rad - w[0].rotation_rad).norm();
        let turn = (w[1].rotation() - w[0].rotation()).norm();
        require(step < 4.0 * turn + 1e-6, || format!("move {}: vector jumps by {step}, turn {turn}", i + 1))?;
    }
    Ok(())
}

/// The arc burns exactly between the first and the last waypoint of each seam, the gas before and after it.
fn switching(events: &[Event], waypoints: &[Waypoint], job: &Job) -> Result<(), String> {
    let (arc_output, gas_output) = (job.arc().output, job.arc().gas_output);
    let (mut arc, mut gas, mut at) = (false, false, 0);
    for event in events {
        match event {
            Event::Out(output, on) if *output == arc_output => {
                let standing_on_seam = at > 0 && waypoints[at - 1].weld;
                require(!on || standing_on_seam, || format!("arc struck off the seam, at {at}"))?;
                require(!on || gas || gas_output.is_none(), || "arc without gas".into())?;
                arc = *on;
            }
            Event::Out(output, on) if Some(*output) == gas_output => {
                require(*on || !arc, || "gas off before the arc".into())?;
                gas = *on;
            }
            Event::Out(output, _) => return Err(format!("output {output} is not ours")),
            Event::Move(_) => {
                let welding = at > 0 && waypoints[at].weld && waypoints[at - 1].weld;
                require(arc == welding, || format!("move {at}: arc {arc}, welding {welding}"))?;
                at += 1;
            }
            _ => {}
        }
    }
    require(!arc && !gas, || "left burning".into())
}

fn tool(events: &[Event], job: &Job) -> Result<(), String> {
    let first_move = events.iter().position(|event| a_move(event).is_some()).unwrap_or(events.len());
    let Some(tool) = job.tool() else { return Ok(()) };
    let [x, y, z] = tool.flange_from_tcp_mm.map(|v| v / 1e3);
    let [rx, ry, rz] = tool.flange_from_tcp_rotation_rad;
    let wanted = [Event::Tcp([x, y, z, rx, ry, rz]), Event::Payload(tool.payload_kg, [0.0; 3])];
    require(wanted.iter().all(|w| events[..first_move].contains(w)), || "TCP or payload".into())
}

#[test]
fn the_script_does_what_the_plan_says() {
    let plain = ["", JOB, "[path]\nspacing_mm = 0.7", "[path]\npoints = 40", "[arc]\noutput = 7"];
    for text in plain.into_iter().chain(VOCABULARY) {
        let job = job(text);
        let output = output(&job);
        check(&script(&output), &output.program.waypoints, &job).unwrap();
    }
}

const VOCABULARY: [&str; 6] = [
    "[stitch]\npattern = \"stitches\"\nlength_mm = 11\npitch_mm = 30\n[path]\nend_dwell_s = 0.75\n[arc]\ngas_output = 3",
    "[weave]\nshape = \"zigzag\"\ndwell_left_s = 0.15\ndwell_right_s = 0.25\n[path]\ncorner = \"stop\"",
    "[weave]\nshape = \"circle\"\n[torch]\nwork_angle_deg = 9\ntravel_angle_deg = -12\nturn_deg = 30",
    "[path]\nlead_in_mm = 9\nlead_out_mm = 4\nextend_start_mm = 5\nextend_end_mm = -3\ncorner = \"blend\"",
    "[[pass]]\n[[pass]]\nout_mm = 3\nreverse = true\npath.feed_mm_s = 6\nweave.shape = \"sine\"",
    "[[seam]]\nid = 2\nstitch.pattern = \"tacks\"\npath.start_dwell_s = 0.5\n[order]\nsequence = \"found\"",
];

#[test]
fn a_script_that_forgets_a_dwell_or_a_stop_is_refused() {
    let job = job(VOCABULARY[1]);
    let output = output(&job);
    let good = script(&output);
    for (from, to, why) in [
        ("  sleep(0.15)\n", "", "no dwell"),
        ("sleep(0.25)", "sleep(0.5)", "no dwell"),
        ("movep(p[", "sleep(0.1)\n  movep(p[", "stands"),
    ] {
        assert!(good.contains(from), "{from}");
        let at = good.match_indices(from).nth(2).unwrap().0;
        let bad = format!("{}{to}{}", &good[..at], &good[at + from.len()..]);
        let refusal = check(&bad, &output.program.waypoints, &job).unwrap_err();
        assert!(refusal.contains(why), "{from} -> {to}: {refusal}");
    }
}

#[test]
fn the_tool_points_into_the_work_on_every_seam() {
    let output = output(&job(JOB));
    let events = run(&script(&output), true).unwrap();
    let moves = events.iter().filter_map(a_move).zip(&output.program.waypoints);
    for (a_move, waypoint) in moves.filter(|(_, waypoint)| waypoint.kind == Kind::Weld) {
        let tool_z = a_move.rotation() * Vector3::z();
        assert!(tool_z.z < -0.5, "both seams lie on a plate that faces up");
        if waypoint.seam == Some(1) {
            let to_axis = -Vector3::new(waypoint.position_mm.x, waypoint.position_mm.y, 0.0).normalize();
            assert!((tool_z.dot(&to_axis) - 0.5f64.sqrt()).abs() < 1e-6, "45 degrees to the pipe");
        }
    }
}

#[test]
fn an_arc_that_does_not_establish_halts_with_everything_off() {
    let output = output(&job(JOB));
    let events = run(&script(&output), false).unwrap();
    assert_eq!(events.last(), Some(&Event::Halt));
    let last = |channel| {
        events.iter().rev().find_map(|event| match event {
            Event::Out(output, on) if *output == channel => Some(*on),
            _ => None,
        })
    };
    assert_eq!((last(2), last(5)), (Some(false), Some(false)));
    let welded = events.iter().filter_map(a_move).filter(|a_move| a_move.command == "movep").count();
    assert_eq!(welded, 0, "no weld move without an arc");
}

#[test]
fn a_mutated_script_is_refused() {
    let job = job(JOB);
    let output = output(&job);
    let good = script(&output);
    let seam_end = ", r=0.00000000)";
    let blend =
        good.lines().find(|line| line.contains("movep")).and_then(|line| line.rsplit("r=").next()).unwrap();
    let mutations: [(&str, &str, &str); 17] = [
        ("set_tcp(p[0.00000000", "set_tcp(p[0.00100000", "TCP"),
        ("set_payload(2.5", "set_payload(3.5", "payload"),
        ("set_standard_digital_out(2, True)", "set_standard_digital_out(3, True)", "not ours"),
        // The thread ends both.
        ("set_standard_digital_out(2, True)", "", "moves"),
        ("set_standard_digital_out(5, True)", "", "moves"),
        ("  set_standard_digital_out(5, True)\n  sync()\n  weldpath_on = 1\n", "", "without gas"),
        ("  set_standard_digital_out(2, True)\n  sync()\n  weldpath_on = 2\n", "", "arc false"),
        ("\n  weldpath_on = 0\n  set_standard_digital_out(2, False)", "\n  weldpath_on = 0", "gas off"),
        (seam_end, ", r=0.00040000)", "arrive"),
        (", r=0.0007", ", r=0.0017", "blend"),
        (blend, "0.0)", "stops"),
        ("movep(p[", "movel(p[", "unknown call"),
        ("movel(p[", "movel(p[1", "away"),
        ("v=0.00800000", "v=0.80000000", "speed"),
        ("waited_s = 0.0\n", "", "before it is set"),
        ("end\n", "", "no thread"),
        (
            "    end\n  end\n  sync()\n  weldpath_on = 3",
            "    end\n  sync()\n  weldpath_on = 3",
            "without end",
        ),
    ];
    for (from, to, why) in mutations {
        assert!(good.contains(from), "{from:?} is not in the script");
        match check(&good.replacen(from, to, 1), &output.program.waypoints, &job) {
            Err(refusal) => assert!(refusal.contains(why), "{from:?} -> {to:?}: {refusal}"),
            Ok(()) => panic!("{from:?} -> {to:?} passes"),
        }
    }
    let flipped = good.replacen(", -", ", ", 1);
    assert!(check(&flipped, &output.program.waypoints, &job).is_err());
}

/// A short program: one seam, six of its moves under the arc.
const SHORT: &str = r#"
[selection]
seams = [2]
[path]
points = 4
standoff_mm = 1
feed_mm_s = 40
air_feed_mm_s = 250
[arc]
output = 2
gas_output = 5
gas_preflow_s = 0.2
strike_s = 0.3
gas_postflow_s = 0.2
crater_s = 0.1
"#;
const WATCHED: &str = "established_input = 1";

/// Arc output and gas output of [`SHORT`].
const ARC: u8 = 2;
const GAS: u8 = 5;
/// Steps until the power source says that the arc burns.
const DELAY: u32 = 12;
/// Steps in which the arc is off again, or the arm along a weld at rest: one.
const AT_ONCE: u32 = 1;

fn short(watched: bool) -> (String, Vec<Waypoint>) {
    let job = job(&format!("{SHORT}{}", if watched { WATCHED } else { "" }));
    let output = output(&job);
    (script(&output), output.program.waypoints.clone())
}

/// The script stopped at every step, in every way, under both readings; the first rule that is broken is named.
fn stops(script: &str, watched: bool) -> Result<(), String> {
    let program = Program::parse(script)?;
    let mut robot = Robot::new(&program, Inputs::Source { arc: ARC, delay: DELAY });
    let (mut step, mut lit, mut welded) = (0_u32, 0_u32, 0_u32);
    while !robot.ended() {
        for stop in Stop::ALL {
            for resumed in Resumed::BOTH {
                stopped(&robot, stop, resumed, watched)
                    .map_err(|why| format!("at step {step}, {stop:?}, {resumed:?}: {why}"))?;
            }
        }
        robot.step()?;
        step += 1;
        lit = if robot.out(ARC) { lit + 1 } else { 0 };
        let struck = f64::from(lit) * STEP_S >= if watched { f64::from(DELAY) * STEP_S } else { 0.3 };
        require(!robot.welded() || struck, || format!("step {step}: welds {lit} steps after the strike"))?;
        welded += u32::from(robot.welded());
    }
    require(welded > 50, || format!("the weld ends after {welded} steps"))?;
    require(!robot.out(ARC) && !robot.out(GAS), || "left on".into())
}

/// One stop: off at once, and, if it goes on, neither the arc nor the torch along the weld for longer than a step.
fn stopped(robot: &Robot, stop: Stop, resumed: Resumed, watched: bool) -> Result<(), String> {
    let mut robot = robot.copy();
    let (gas, struck) = (robot.out(GAS), robot.out(ARC));
    let established = robot.value_of("weldpath_on") == Some(3.0);
    robot.stop(stop, resumed);
    for _ in 0..5 {
        require(!robot.out(ARC) && !robot.out(GAS), || "the arc is on".into())?;
        robot.step()?;
    }
    if robot.ended() {
        return Ok(());
    }
    robot.resume();
    // Undetectable where the output comes back by itself: the person who lets the program go on is told so in its head.
    let unseen = resumed == Resumed::ComesBack && (!watched || !established);
    let (mut on, mut dry, mut along, mut steps) = (0, 0, 0, 0);
    while !robot.ended() && steps < 400 {
        steps += 1;
        robot.step()?;
        on += u32::from(robot.out(ARC));
        along += u32::from(robot.welded());
        dry += u32::from(robot.welded() && !robot.out(ARC));
        let again = struck && on > AT_ONCE && !unseen;
        require(!again, || "the arc is on again".into())?;
        require(dry <= AT_ONCE, || "along the weld without an arc".into())?;
        let gasless = gas && robot.out(ARC) && !robot.out(GAS);
        require(!gasless, || "the arc without gas".into())?;
    }
    require(!struck || unseen || along <= AT_ONCE, || format!("goes on along the weld for {along} steps"))
}

#[test]
fn a_stop_at_any_time_puts_the_arc_out_for_good() {
    for watched in [true, false] {
        let (script, _) = short(watched);
        stops(&script, watched).unwrap();
        let unseen = if watched { "do not resume there" } else { "do not resume during a weld" };
        assert!(
            script.contains("An output that switches on again") && script.contains(unseen),
            "what is not seen is said"
        );
        assert_eq!(script.contains("Loss of the arc is not detected"), !watched);
        assert!(script.contains("Not a safety function"));
    }
}

#[test]
fn an_arc_that_goes_out_ends_the_program_at_once() {
    let (script, _) = short(true);
    let program = Program::parse(&script).unwrap();
    let mut robot = Robot::new(&program, Inputs::Source { arc: ARC, delay: DELAY });
    let mut losses = 0;
    while !robot.ended() {
        robot.step().unwrap();
        if robot.welded() {
            let mut lost = robot.copy();
            lost.lose_arc();
            lost.step().unwrap();
            assert!(lost.ended() && !lost.out(ARC) && !lost.out(GAS));
            losses += 1;
        }
    }
    assert!(losses > 50);
}

#[test]
fn a_script_that_is_unsafe_when_it_stops_is_refused() {
    let strike = "  set_standard_digital_out(2, True)\n  sync()\n  weldpath_on = 2\n";
    let waits = format!("{strike}  sleep(0.3)\n");
    let action = "set_runstate_standard_digital_output_to_value(2, 1)";
    let third = action.replace(", 1)", ", 3)");
    let fourth = action.replace(", 1)", ", 4)");
    let mutations = [
        (action, "", "the arc is on"),
        (action, third.as_str(), ""),
        (action, fourth.as_str(), "the arc is on"),
        ("set_runstate_standard_digital_output_to_value(5, 1)", "", "the arc is on"),
        ("  weldpath_watcher = run weldpath_watch()\n", "", "without"),
        ("(weldpath_on >= 1)", "(weldpath_on >= 4)", "the arc without gas"),
        (waits.as_str(), strike, "after the strike"),
        ("    sync()\n", "", "does not end"),
        ("  global weldpath_on = 0\n", "", "is not global"),
    ];
    let (good, _) = short(false);
    for (from, to, why) in mutations {
        assert!(good.contains(from), "{from:?} is not in the script");
        let refusal = stops(&good.replacen(from, to, 1), false);
        assert!(refusal.as_ref().is_err_and(|refusal| refusal.contains(why)), "{from:?}: {refusal:?}");
    }
    let (watched, _) = short(true);
    let from = watched.find("  waited_s = 0.0").unwrap();
    let to = watched.find("  weldpath_on = 3").unwrap();
    let unwaited = format!("{}{}", &watched[..from], &watched[to..]);
    let refusal = stops(&unwaited, true).unwrap_err();
    assert!(refusal.contains("after the strike"), "{refusal}");
}

#[test]
fn the_first_point_is_reached_by_joints() {
    for home in [false, true] {
        let (files, waypoints, stances) = standing(SHORT, Dialect::Ur, home);
        let events = run(&files[0].1, true).unwrap();
        let joints: Vec<[f64; 6]> = events
            .iter()
            .filter_map(|e| if let Event::Joints(rad) = e { Some(rad.map(f64::to_degrees)) } else { None })
            .collect();
        let first = stances[0].joints_deg;
        let wanted = if home { vec![HOME_DEG, first, HOME_DEG] } else { vec![first] };
        assert_eq!(joints.len(), wanted.len());
        let off = |(a, b): (&[f64; 6], &[f64; 6])| (0..6).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max);
        assert!(joints.iter().zip(&wanted).map(off).fold(0.0, f64::max) < 1e-6, "{joints:?}");
        let asked = events.iter().position(|e| *e == Event::Asked);
        let moved = events.iter().position(|e| matches!(e, Event::Joints(_))).unwrap();
        assert_eq!(asked.is_some_and(|asked| asked < moved), !home, "asks where there is no home");
        let moves: Vec<&Move> = events.iter().filter_map(a_move).collect();
        poses_equal(&moves, &waypoints[1..]).unwrap_or_else(|why| panic!("{why}"));
        assert!(moves.iter().all(|one| one.command != "movej"));
        assert_eq!(matches!(events.last(), Some(Event::Joints(_))), home);
        stops(&files[0].1, false).unwrap();
    }
}

#[test]
fn joints_of_another_counting_are_not_written() {
    for (counted_by, own) in [(Dialect::Ur, true), (Dialect::Abb, false)] {
        let (files, ..) = standing_as(SHORT, Dialect::Ur, Some(counted_by), true);
        let unknown = files[0].1.contains("The posture is the controller's choice: not checked.");
        assert_eq!((files[0].1.contains("movej(["), unknown), (own, !own));
    }
    let (files, ..) = standing_as(SHORT, Dialect::Ur, None, true);
    assert!(files[0].1.contains("movej(["), "an arm of the job's own");
}
