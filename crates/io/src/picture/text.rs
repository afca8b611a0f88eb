//! Text on pictures, in a bitmap font.

use std::convert::Infallible;

use embedded_graphics::Pixel;
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle, iso_8859_1::FONT_6X13};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Point, Size};
use embedded_graphics::text::{Baseline, Text};

use super::Picture;

const FONT: MonoFont<'static> = FONT_6X13;

/// Pixels across one letter, space to the next included.
pub(super) const LETTER_WIDTH: u32 = 6;

/// Pixels down one line.
pub(super) const LINE_HEIGHT: u32 = 13;

impl Picture {
    /// Writes one line of text, letters of 6 by 13 pixels, with its upper left corner at a column and row.
    ///
    /// What would be outside is cut off. Letters beyond Latin-1 and control characters are shown as `?`.
    pub fn write_text(&mut self, column: u32, row: u32, text: &str, colour: [u8; 3]) {
        let visible = |c: char| if c.is_control() { '?' } else { c };
        // What starts outside is not drawn at all; a letter that starts inside has coordinates far below i32::MAX.
        let (Ok(x), Ok(y)) = (i32::try_from(column), i32::try_from(row)) else { return };
        if column >= self.width || row >= self.height {
            return;
        }
        let room = (self.width - column).div_ceil(LETTER_WIDTH) as usize;
        let text: String = text.chars().take(room).map(visible).collect();
        let [red, green, blue] = colour;
        let style = MonoTextStyle::new(&FONT, Rgb888::new(red, green, blue));
        let Ok(_) = Text::with_baseline(&text, Point::new(x, y), style, Baseline::Top).draw(&mut Canvas(self));
    }
}

/// A picture as the font draws to it.
struct Canvas<'a>(&'a mut Picture);

impl OriginDimensions for Canvas<'_> {
    fn size(&self) -> Size {
        Size::new(self.0.width, self.0.height)
    }
}

impl DrawTarget for Canvas<'_> {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(Point { x, y }, colour) in pixels {
            let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { continue };
            if x < self.0.width && y < self.0.height {
                let start = 3 * (y as usize * self.0.width as usize + x as usize);
                self.0.rgb[start..start + 3].copy_from_slice(&[colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}
