use super::*;
use rayon::prelude::*;
use std::time::Instant;

#[test]
fn work_spread_over_threads_is_left_at_once_and_what_was_made_before_stays() {
    let (worker, begun) = (Worker::default(), Instant::now());
    assert_eq!(worker.run(|| true, || 7), 7, "what is quick is not given up");
    let endless = || {
        (0..1_000_000).into_par_iter().for_each(|_| {
            go_on();
            std::thread::sleep(Duration::from_millis(1));
        });
    };
    let is_done = || begun.elapsed() > Duration::from_millis(100);
    assert!(unless_given_up(|| worker.run(is_done, endless)).is_none());
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
}

#[test]
fn a_panic_of_the_work_is_no_giving_up() {
    let caught = catch_unwind(|| unless_given_up(|| Worker::default().run(|| true, || panic!("a fault"))));
    assert_eq!(caught.unwrap_err().downcast_ref::<&str>(), Some(&"a fault"));
}

#[test]
fn other_threads_go_on() {
    let worker = Worker::default();
    worker.given_up.store(true, Ordering::Relaxed);
    go_on();
    assert!(unless_given_up(|| worker.run(|| false, go_on)).is_none());
}
