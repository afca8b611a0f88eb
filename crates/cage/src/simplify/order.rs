use glam::DVec3;
use rayon::prelude::*;

/// The numbers of `positions`, all within a unit box around the origin, in an order that keeps neighbours in space near
/// each other (Morton 1966): by the interleaved bits of their cell in a grid of 2048 cells a side, then by number.
pub(super) fn along_z_curve(positions: &[DVec3]) -> Vec<u32> {
    const BITS: u32 = 11;
    let cells = f64::from(1_u32 << BITS);
    let key = |(i, p): (usize, &DVec3)| {
        // A cast takes what is out of range, if only by rounding, to the nearest end.
        let cell = ((*p + 0.5) * cells).to_array().map(|x| (x as u64).min((1 << BITS) - 1));
        let code = spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2;
        // 33 bits, and a number takes no more than the other 31.
        code << 31 | i as u64
    };
    let mut keys: Vec<u64> = positions.par_iter().enumerate().map(key).collect();
    keys.par_sort_unstable();
    keys.into_par_iter().map(|k| (k & (u64::MAX >> 33)) as u32).collect()
}

/// The lowest 11 bits, two zeros between each and the next.
fn spread(bits: u64) -> u64 {
    let mut x = bits;
    x = (x | x << 16) & 0x0000_00ff_0000_ff;
    x = (x | x << 8) & 0x0000_f00f_00f0_0f;
    x = (x | x << 4) & 0x000c_30c3_0c30_c3;
    (x | x << 2) & 0x0249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread_by_three() {
        for bits in [0, 1, 2, 1025, 0b101_1010_1101, 2047] {
            let expected = (0..11).filter(|k| bits >> k & 1 == 1).map(|k| 1 << (3 * k)).sum();
            assert_eq!(spread(bits), expected, "{bits:b}");
        }
    }

    /// Every number once; the eight corners of a box in the order of the curve, whatever order they come in.
    #[test]
    fn order_is_a_permutation_along_the_curve() {
        let corners: Vec<DVec3> =
            (0..8).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)) - 0.5).collect();
        let turned: Vec<DVec3> = (0..8).map(|i| corners[i * 3 % 8]).collect();
        let order = along_z_curve(&turned);
        assert_eq!(order.iter().map(|&i| turned[i as usize]).collect::<Vec<_>>(), corners);
        let same = vec![DVec3::splat(0.5 + 1e-9); 5];
        assert_eq!(along_z_curve(&same), [0, 1, 2, 3, 4]);
    }
}
