//! The copies that scans and sorts are compared with copy: every word that was asked for, and no other.

mod common;
#[path = "common/data.rs"]
mod data;

use common::gpu_test;
use data::{Random, assert_same};
use tyndall::passes::bench_copy::{BenchCopy, CopyShape};
use tyndall::vk::Recorder;

const SENTINEL: u32 = 0xDEAD_BEEF;

#[test]
fn every_shape_copies_what_it_was_asked_for() {
    gpu_test(|ctx| {
        let words = Random(1).words(70_000);
        let from = ctx.upload("from", &words).unwrap();
        for (workgroup, rows, width) in [(256, 1, 1), (128, 16, 1), (256, 1, 4), (64, 4, 4)] {
            let copy = BenchCopy::new(ctx, CopyShape { workgroup, rows, width }).unwrap();
            for n in [0, 4, 1020, 1024, 1028, 69_996, 70_000] {
                let to = ctx.upload("to", &vec![SENTINEL; words.len()]).unwrap();
                let mut rec = Recorder::new(ctx).unwrap();
                copy.record(&mut rec, &from, &to, n as u32);
                rec.submit_and_wait().unwrap();
                let got = ctx.read_back(&to).unwrap();
                assert_same(&format!("{n} words, {rows} rows of {width}"), &got[..n], &words[..n]);
                assert!(got[n..].iter().all(|&word| word == SENTINEL), "{n} words: copied more");
            }
        }
    });
}
