//! Brings points into the order of their cells (ours).
//!
//! They go into buckets of consecutive rows first, then into their cells bucket by bucket: memory is read and written in order,
//! or in stretches that the caches hold, so that a point costs little more in a large cloud than in a small one.

use super::lanes::LANES;
use super::rows::{Rows, Share};
use rayon::prelude::*;
use std::ops::Range;

/// Points of a bucket, unless a row alone has more.
const BUCKET: u32 = 1 << 12;

/// Points sorted by cell; those of a cell are in the order of the cloud, with any number of threads.
pub(super) struct Sorted {
    /// First slot of each entry of the rows, one past the last at the end.
    pub(super) start: Vec<u32>,
    /// Index in the cloud by slot.
    pub(super) order: Vec<u32>,
    /// Coordinates by slot, padded so that eight can be read from any slot on.
    pub(super) columns: [Vec<f32>; 3],
}

impl Sorted {
    /// Sorts the points over which `rows` are laid.
    pub(super) fn new(rows: &Rows, shares: &[Share]) -> Self {
        let buckets = Buckets::of(rows, shares);
        let dealt: Vec<Dealt> = shares.par_iter().map(|share| buckets.deal(rows, share)).collect();
        let points = shares.iter().map(|share| share.points.len()).sum::<usize>();
        let mut sorted = Self {
            start: vec![0; rows.entries() + 1],
            order: vec![0; points],
            columns: [const { Vec::new() }; 3],
        };
        sorted.columns.iter_mut().for_each(|column| column.resize(points + LANES - 1, 0.0));
        let places = sorted.places(&buckets);
        places.into_par_iter().enumerate().for_each(|(bucket, place)| place.fill(bucket, &dealt));
        sorted
    }

    /// Where the points of each bucket belong.
    fn places(&mut self, buckets: &Buckets) -> Vec<Place<'_>> {
        let mut ends = &mut self.start[1..];
        let mut order = &mut self.order[..];
        let mut columns = self.columns.each_mut().map(|column| &mut column[..]);
        let taken = "a bucket ends where the next begins";
        let mut place = |entries: Range<u32>, slots: Range<u32>| Place {
            ends: ends.split_off_mut(..entries.len()).expect(taken),
            order: order.split_off_mut(..slots.len()).expect(taken),
            columns: columns.each_mut().map(|column| column.split_off_mut(..slots.len()).expect(taken)),
            entry: entries.start,
            slot: slots.start,
        };
        let between = |two: &[Begin]| place(two[0].entry..two[1].entry, two[0].slot..two[1].slot);
        buckets.begins.windows(2).map(between).collect()
    }
}

/// Which rows make up each bucket.
struct Buckets {
    /// One per bucket, and one past the last.
    begins: Vec<Begin>,
    of_row: Vec<u32>,
}

/// Where a bucket's entries and slots begin.
struct Begin {
    entry: u32,
    slot: u32,
}

impl Buckets {
    fn of(rows: &Rows, shares: &[Share]) -> Self {
        let (mut begins, mut of_row) = (vec![Begin { entry: 0, slot: 0 }], Vec::new());
        let (mut slot, mut held) = (0, 0);
        for (row, entry) in rows.begins().enumerate() {
            let points = shares.iter().map(|share| share.in_row[row]).sum::<u32>();
            if held > 0 && held + points > BUCKET {
                begins.push(Begin { entry, slot });
                held = 0;
            }
            of_row.push(begins.len() as u32 - 1);
            (slot, held) = (slot + points, held + points);
        }
        begins.push(Begin { entry: rows.entries() as u32, slot });
        Self { begins, of_row }
    }

    /// Deals the points of a share into the buckets.
    fn deal(&self, rows: &Rows, share: &Share) -> Dealt {
        let mut begins = vec![0; self.begins.len()];
        for (bucket, points) in self.of_row.iter().zip(&share.in_row) {
            begins[*bucket as usize + 1] += points;
        }
        (1..begins.len()).for_each(|k| begins[k] += begins[k - 1]);
        let mut next = begins.clone();
        let mut records = vec![Record::default(); share.points.len()];
        for (index, point) in (share.first..).zip(share.points) {
            let (row, entry) = rows.row_and_entry(point);
            let next = &mut next[self.of_row[row] as usize];
            records[*next as usize] = Record { point: [point.x, point.y, point.z], index, entry };
            *next += 1;
        }
        Dealt { begins, records }
    }
}

/// A point on its way.
#[derive(Clone, Copy, Default)]
struct Record {
    point: [f32; 3],
    /// In the cloud.
    index: u32,
    entry: u32,
}

/// The points of a share, bucket by bucket.
struct Dealt {
    begins: Vec<u32>,
    records: Vec<Record>,
}

impl Dealt {
    fn of(&self, bucket: usize) -> &[Record] {
        &self.records[self.begins[bucket] as usize..self.begins[bucket + 1] as usize]
    }
}

/// The part of the tables that belongs to a bucket.
struct Place<'a> {
    /// One past the last slot of each entry.
    ends: &'a mut [u32],
    order: &'a mut [u32],
    columns: [&'a mut [f32]; 3],
    /// First of the bucket.
    entry: u32,
    slot: u32,
}

impl Place<'_> {
    /// Counting sort of a bucket.
    fn fill(self, bucket: usize, dealt: &[Dealt]) {
        let Self { ends, order, columns: [x, y, z], entry, slot } = self;
        let records = || dealt.iter().flat_map(|share| share.of(bucket));
        records().for_each(|record| ends[(record.entry - entry) as usize] += 1);
        let mut before = 0;
        ends.iter_mut().for_each(|end| before += std::mem::replace(end, before));
        records().for_each(|record| {
            // The first free slot of the cell, which ends up one past its last.
            let next = &mut ends[(record.entry - entry) as usize];
            let slot = *next as usize;
            *next += 1;
            ([x[slot], y[slot], z[slot]], order[slot]) = (record.point, record.index);
        });
        ends.iter_mut().for_each(|end| *end += slot);
    }
}
