//! As many numbers side by side as a vector register holds, with the operators of one number.
//!
//! Nothing is fused and no operation is approximate, so every lane has the bits that a single number would have, with any
//! instruction set.

use std::ops::{Add, Div, Mul, Sub};

use pulp::{Simd, bytemuck};

macro_rules! lanes {
    ($name:ident, $number:ty, $register:ident, $lanes:ident, $all:ident, $add:ident, $sub:ident, $mul:ident, $div:ident,
     $min:ident, $max:ident, $abs:ident, $sqrt:ident, $less:ident, $select:ident) => {
        /// Lanes of one register.
        #[derive(Clone, Copy)]
        pub(crate) struct $name<S: Simd> {
            simd: S,
            value: S::$register,
        }

        impl<S: Simd> $name<S> {
            /// Numbers in a register.
            pub(crate) const COUNT: usize = S::$lanes;

            /// The same number in every lane.
            #[inline(always)]
            pub(crate) fn all(simd: S, number: $number) -> Self {
                Self { simd, value: simd.$all(number) }
            }

            /// Register `at` of `numbers`, whose length is a multiple of [`Self::COUNT`].
            #[inline(always)]
            pub(crate) fn load(simd: S, numbers: &[$number], at: usize) -> Self {
                Self { simd, value: bytemuck::cast_slice(numbers)[at] }
            }

            /// Puts the lanes where [`Self::load`] would take them from.
            #[inline(always)]
            pub(crate) fn store(self, numbers: &mut [$number], at: usize) {
                bytemuck::cast_slice_mut(numbers)[at] = self.value;
            }

            #[inline(always)]
            pub(crate) fn min(self, other: Self) -> Self {
                Self { value: self.simd.$min(self.value, other.value), ..self }
            }

            #[inline(always)]
            pub(crate) fn max(self, other: Self) -> Self {
                Self { value: self.simd.$max(self.value, other.value), ..self }
            }

            #[inline(always)]
            pub(crate) fn abs(self) -> Self {
                Self { value: self.simd.$abs(self.value), ..self }
            }

            #[inline(always)]
            pub(crate) fn sqrt(self) -> Self {
                Self { value: self.simd.$sqrt(self.value), ..self }
            }

            /// `yes` where this is less than `limit`, else `no`.
            #[inline(always)]
            pub(crate) fn if_below(self, limit: Self, yes: Self, no: Self) -> Self {
                let mask = self.simd.$less(self.value, limit.value);
                Self { value: self.simd.$select(mask, yes.value, no.value), ..self }
            }
        }

        impl<S: Simd> Add for $name<S> {
            type Output = Self;

            #[inline(always)]
            fn add(self, other: Self) -> Self {
                Self { value: self.simd.$add(self.value, other.value), ..self }
            }
        }

        impl<S: Simd> Sub for $name<S> {
            type Output = Self;

            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self { value: self.simd.$sub(self.value, other.value), ..self }
            }
        }

        impl<S: Simd> Mul for $name<S> {
            type Output = Self;

            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                Self { value: self.simd.$mul(self.value, other.value), ..self }
            }
        }

        impl<S: Simd> Div for $name<S> {
            type Output = Self;

            #[inline(always)]
            fn div(self, other: Self) -> Self {
                Self { value: self.simd.$div(self.value, other.value), ..self }
            }
        }
    };
}

lanes!(
    Singles,
    f32,
    f32s,
    F32_LANES,
    splat_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    div_f32s,
    min_f32s,
    max_f32s,
    abs_f32s,
    sqrt_f32s,
    less_than_f32s,
    select_f32s
);
lanes!(
    Doubles,
    f64,
    f64s,
    F64_LANES,
    splat_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    div_f64s,
    min_f64s,
    max_f64s,
    abs_f64s,
    sqrt_f64s,
    less_than_f64s,
    select_f64s
);
