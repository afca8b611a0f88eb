use super::Picture;

/// Pictures side by side from left to right, `gap` pixels apart and each centred in height, on one colour.
///
/// No pictures make a picture without pixels.
pub fn strip(pictures: &[Picture], gap: u32, background: [u8; 3]) -> Picture {
    let gaps = gap * (pictures.len().max(1) as u32 - 1);
    let width = pictures.iter().map(|p| p.width).sum::<u32>() + gaps;
    let height = pictures.iter().map(|p| p.height).max().unwrap_or(0);
    let mut joined = Picture::filled(width, height, background);
    let mut left = 0;
    for picture in pictures {
        let top = (height - picture.height) / 2;
        joined.put(picture, left, top);
        left += picture.width + gap;
    }
    joined
}

impl Picture {
    /// Copies a picture into this one, its upper left corner at a column and row; it must fit.
    pub(super) fn put(&mut self, picture: &Picture, left: u32, top: u32) {
        let length = 3 * picture.width as usize;
        for row in 0..picture.height as usize {
            let to = 3 * ((top as usize + row) * self.width as usize + left as usize);
            self.rgb[to..to + length].copy_from_slice(&picture.rgb[row * length..][..length]);
        }
    }
}

/// Cuts the margins off pictures of one size: the same rectangle out of each, the smallest that keeps every pixel whose
/// colour is not `background` in any of them, and `margin` pixels more where there are any.
///
/// So pictures that share a camera still do. Pictures of different sizes, or without anything on them, stay as they are.
pub fn trim_alike(pictures: &[Picture], margin: u32, background: [u8; 3]) -> Vec<Picture> {
    let same_size = pictures.windows(2).all(|pair| (pair[0].width, pair[0].height) == (pair[1].width, pair[1].height));
    let Some(first) = pictures.first().filter(|p| same_size && p.width > 0) else { return pictures.to_vec() };
    let (mut left, mut right, mut top, mut bottom) = (u32::MAX, 0, u32::MAX, 0);
    for picture in pictures {
        for (i, pixel) in (0u32..).zip(picture.rgb.chunks_exact(3)) {
            if pixel != background {
                let (x, y) = (i % picture.width, i / picture.width);
                (left, right, top, bottom) = (left.min(x), right.max(x), top.min(y), bottom.max(y));
            }
        }
    }
    if left > right {
        return pictures.to_vec();
    }
    let (left, top) = (left.saturating_sub(margin), top.saturating_sub(margin));
    let right = right.saturating_add(margin).min(first.width - 1);
    let bottom = bottom.saturating_add(margin).min(first.height - 1);
    let cut = |picture: &Picture| {
        let row = |y: u32| {
            let start = 3 * (y as usize * picture.width as usize + left as usize);
            &picture.rgb[start..start + 3 * (right - left + 1) as usize]
        };
        let rgb = (top..=bottom).flat_map(|y| row(y).iter().copied()).collect();
        Picture { width: right - left + 1, height: bottom - top + 1, rgb }
    };
    pictures.iter().map(cut).collect()
}
