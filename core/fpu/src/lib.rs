//! The square root that the processor has and core, without `unsafe`, cannot reach: for its feature `fpu`. Core with its
//! features builds from its own folder; the firmware only switches this on.
//!
//! Both are correctly rounded (IEEE 754), so this one changes the cost of a result and not its bits: about 5
//! instructions for 58 of libm's.
#![no_std]

/// Square root by the processor's `vsqrt.f32`.
#[cfg(target_arch = "arm")]
#[inline(always)]
pub fn sqrt(x: f32) -> f32 {
    let root: u32;
    // SAFETY: changes the named registers only; every input has a result.
    unsafe {
        core::arch::asm!(
            "vmov s0, {x}",
            "vsqrt.f32 s0, s0",
            "vmov {root}, s0",
            x = in(reg) x.to_bits(),
            root = lateout(reg) root,
            out("s0") _,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    f32::from_bits(root)
}
