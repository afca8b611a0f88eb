use glam::Vec3;

/// The colour (sRGB) of `t` from 0 to 1 on viridis: dark violet, blue, green, yellow, with lightness rising evenly, so
/// that equal steps look equal, on grey paper and to the colour-blind too.
///
/// Numbers outside take the colour of the nearer end, NaN takes grey. A polynomial fit by Matt Zucker (2017, CC0) to the
/// map of van der Walt and Smith (2015).
pub fn colour_map(t: f64) -> [u8; 3] {
    if t.is_nan() {
        return [128, 128, 128];
    }
    const COEFFICIENTS: [Vec3; 7] = [
        Vec3::new(0.277_727_33, 0.005_407_344_5, 0.334_099_8),
        Vec3::new(0.105_093_04, 1.404_613_5, 1.384_590_1),
        Vec3::new(-0.330_861_83, 0.214_847_56, 0.095_095_16),
        Vec3::new(-4.634_230_6, -5.799_101, -19.332_441),
        Vec3::new(6.228_27, 14.179_933, 56.690_55),
        Vec3::new(4.776_385, -13.745_145, -65.353_035),
        Vec3::new(-5.435_456, 4.645_852_6, 26.312_435),
    ];
    let t = t.clamp(0.0, 1.0) as f32;
    let colour = COEFFICIENTS.iter().rev().fold(Vec3::ZERO, |sum, &c| sum * t + c);
    colour.to_array().map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// An sRGB byte as a share of light.
pub(super) fn to_linear(colour: [u8; 3]) -> Vec3 {
    let light = |byte: u8| {
        let c = f32::from(byte) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    Vec3::new(light(colour[0]), light(colour[1]), light(colour[2]))
}

/// A share of light as an sRGB byte.
pub(super) fn from_linear(light: Vec3) -> [u8; 3] {
    light.to_array().map(|l| {
        let l = l.clamp(0.0, 1.0);
        let c = if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
        (255.0 * c).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every byte survives the way to light and back.
    #[test]
    fn bytes_round_trip() {
        for byte in 0..=255 {
            assert_eq!(from_linear(to_linear([byte; 3])), [byte; 3]);
        }
    }

    /// The published ends of viridis are (68, 1, 84) and (253, 231, 37), and its lightness rises all the way.
    #[test]
    fn map_is_viridis() {
        for (t, expected) in [(0.0, [68, 1, 84]), (1.0, [253, 231, 37])] {
            for (found, expected) in colour_map(t).into_iter().zip(expected) {
                // The fit's author states errors of about 1 %.
                assert!((i32::from(found) - expected).abs() <= 5, "{:?}", colour_map(t));
            }
        }
        let luminance = |t| to_linear(colour_map(t)).dot(Vec3::new(0.2126, 0.7152, 0.0722));
        for i in 0..50 {
            let t = f64::from(i) / 50.0;
            assert!(luminance(t) < luminance(t + 0.02), "at {t}");
        }
    }
}
