//! The path that is being loaded or followed, and the torch on it.

use super::Slots;
use super::drive::Drive;
use super::ring::{self, Dynamics, Placed, Ring};
use crate::wire::{Ack, Begin, Chunk, ChunkRefusal, Field, Limits, MAX_CHUNK, Refusal, WirePose};

/// `ring` and `drive` say something of it only while it is loaded.
#[derive(Debug, Clone)]
pub(super) struct Path<const RING: usize, S> {
    pub(super) ring: Ring<RING, S>,
    pub(super) drive: Drive,
    pub(super) loaded: bool,
    /// Newest id of this session.
    newest: Option<u16>,
    /// Id of the path that was last followed to its end in this session.
    pub(super) finished: Option<u16>,
}

impl<const RING: usize, S: Slots> Path<RING, S> {
    /// None.
    pub(super) fn new(slots: S) -> Self {
        let (ring, drive) = (Ring::new(slots), Drive::default());
        Self { ring, drive, loaded: false, newest: None, finished: None }
    }

    /// A session that begins has used no id.
    pub(super) fn forget(&mut self) {
        (self.newest, self.finished) = (None, None);
    }

    /// What is loaded or being loaded.
    pub(super) fn begin(&self) -> Option<&Begin> {
        self.loaded.then(|| self.ring.begin())
    }

    /// How far the load is.
    pub(super) fn ack(&self) -> Option<Ack> {
        self.loaded.then(|| self.ring.ack())
    }

    /// Where it begins.
    pub(super) fn first(&self) -> Option<WirePose> {
        self.ring.get(0).filter(|_| self.loaded).map(|slot| slot.waypoint.pose)
    }

    /// Refuses unless this is the one that is loaded.
    pub(super) fn named(&self, path: u16) -> Result<(), Refusal> {
        if self.begin().is_some_and(|begin| begin.path == path) { Ok(()) } else { Err(Refusal::Path) }
    }

    pub(super) fn check(&self, begin: &Begin, limits: &Limits) -> Result<(), Refusal> {
        let value = |fits: bool, field| if fits { Ok(()) } else { Err(Refusal::Value(field)) };
        // Ids are serial numbers: a chunk of an earlier path of this session never fits a later one.
        if self.newest.is_some_and(|newest| begin.path.wrapping_sub(newest) as i16 <= 0) {
            return Err(Refusal::Path);
        }
        value(begin.total >= 2, Field::Count)?;
        value((1..=MAX_CHUNK).contains(&usize::from(begin.chunk)), Field::Chunk)?;
        value(begin.reach_um <= limits.reach_um, Field::Reach)?;
        value(begin.max_step_um <= limits.max_step_um, Field::Step)?;
        value(begin.min_half_turn_cos_q15 >= limits.min_half_turn_cos_q15, Field::Turn)?;
        if !begin.streamed && begin.total > Ring::<RING, S>::CAPACITY {
            return Err(Refusal::TooLong { capacity: Ring::<RING, S>::CAPACITY });
        }
        Ok(())
    }

    pub(super) fn open(&mut self, begin: &Begin) {
        self.newest = Some(begin.path);
        self.ring.open(begin);
        self.loaded = true;
        self.drive = Drive::default();
    }

    /// It is over: at its end, or wherever it was dropped.
    pub(super) fn close(&mut self, finished: bool) {
        if finished {
            self.finished = Some(self.ring.begin().path);
        }
        self.loaded = false;
        self.drive = Drive::default();
    }

    /// Stores a chunk of it and plans the speeds anew.
    pub(super) fn place(
        &mut self,
        chunk: &Chunk,
        limits: &Limits,
        plan: &Dynamics,
    ) -> Result<Placed, ring::Refusal> {
        self.named(chunk.path).map_err(|_| (0, ChunkRefusal::Path))?;
        let known = self.ring.next();
        let placed = self.ring.place(chunk, limits)?;
        if placed == Placed::New {
            self.ring.replan(known, self.drive.segment, plan);
        }
        Ok(placed)
    }
}
