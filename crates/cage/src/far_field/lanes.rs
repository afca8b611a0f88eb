//! Numbers side by side, one operation at a time: what the compiler turns into a vector instruction each.

use std::ops::{Add, Div, Mul, Sub};

/// `N` numbers. Never fused: the same bits with every instruction set.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub(super) struct Lanes<T, const N: usize>(pub(super) [T; N]);

impl<T: Copy, const N: usize> Lanes<T, N> {
    /// The same number in every lane.
    #[inline(always)]
    pub(super) fn all(value: T) -> Self {
        Self([value; N])
    }

    /// `f` of each lane.
    #[inline(always)]
    pub(super) fn map(mut self, f: impl Fn(T) -> T) -> Self {
        for k in 0..N {
            self.0[k] = f(self.0[k]);
        }
        self
    }

    /// `f` of each pair of lanes.
    #[inline(always)]
    pub(super) fn with(mut self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        for k in 0..N {
            self.0[k] = f(self.0[k], other.0[k]);
        }
        self
    }

    /// `yes` where `test` of the lanes holds, else `no`.
    #[inline(always)]
    pub(super) fn choose(self, other: Self, test: impl Fn(T, T) -> bool, yes: Self, mut no: Self) -> Self {
        for k in 0..N {
            no.0[k] = if test(self.0[k], other.0[k]) { yes.0[k] } else { no.0[k] };
        }
        no
    }
}

impl<const N: usize> Lanes<f32, N> {
    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        self.map(f32::abs)
    }
}

impl<const N: usize> Lanes<f64, N> {
    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        self.map(f64::abs)
    }
}

impl<T: Copy + Default, const N: usize> Default for Lanes<T, N> {
    fn default() -> Self {
        Self([T::default(); N])
    }
}

impl<T: Copy + Add<Output = T>, const N: usize> Add for Lanes<T, N> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl<T: Copy + Sub<Output = T>, const N: usize> Sub for Lanes<T, N> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl<T: Copy + Mul<Output = T>, const N: usize> Mul for Lanes<T, N> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl<T: Copy + Div<Output = T>, const N: usize> Div for Lanes<T, N> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
    }
}
