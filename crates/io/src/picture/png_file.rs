//! Pictures as PNG files, exact or small.

use color_quant::NeuQuant;
use png::{BitDepth, ColorType, Compression, Encoder, Filter, SrgbRenderingIntent};

use super::{Picture, PictureError};

impl Picture {
    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// The picture has no pixels, or not as many as its size says.
    pub fn to_png(&self) -> Result<Vec<u8>, PictureError> {
        self.check()?;
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(ColorType::Rgb);
        finish(encoder, &self.rgb)?;
        Ok(bytes)
    }

    /// The bytes of a PNG file of at most 256 colours, less than half as large as [`Picture::to_png`]'s for a shaded surface.
    ///
    /// A picture of up to 256 colours keeps them all. One of more gets the neural network of Dekker (1994), whose colours are off by one or
    /// two of 255 on the average and by more where they are rare; the colour of the first pixel, which is the background's, is kept.
    ///
    /// # Errors
    /// As [`Picture::to_png`].
    pub fn to_small_png(&self) -> Result<Vec<u8>, PictureError> {
        self.check()?;
        let (palette, indices) = self.palette();
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(ColorType::Indexed);
        encoder.set_palette(palette.concat());
        encoder.set_compression(Compression::High);
        // Neighbouring indices are no neighbouring colours: differences say nothing.
        encoder.set_filter(Filter::NoFilter);
        finish(encoder, &indices)?;
        Ok(bytes)
    }

    fn check(&self) -> Result<(), PictureError> {
        let expected = 3 * u64::from(self.width) * u64::from(self.height);
        if expected == 0 || self.rgb.len() as u64 != expected {
            let found = format!("{} bytes for {} x {}", self.rgb.len(), self.width, self.height);
            return Err(PictureError::bad("content", "three bytes for each of its pixels", found));
        }
        Ok(())
    }

    /// Up to 256 colours, and the one of each pixel.
    fn palette(&self) -> (Vec<[u8; 3]>, Vec<u8>) {
        let pixels = || self.rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2]]);
        let mut colours: Vec<[u8; 3]> = pixels().collect();
        colours.sort_unstable();
        colours.dedup();
        if colours.len() <= MOST_COLOURS {
            let index = |pixel| colours.partition_point(|colour| *colour < pixel) as u8;
            let indices = pixels().map(index).collect();
            return (colours, indices);
        }
        let background = [self.rgb[0], self.rgb[1], self.rgb[2]];
        let opaque = |[r, g, b]: [u8; 3]| [r, g, b, u8::MAX];
        // It is trained by what is left to choose: most pixels are background.
        let others: Vec<u8> = pixels().filter(|pixel| *pixel != background).flat_map(opaque).collect();
        let network = NeuQuant::new(EVERY_PIXEL, MOST_COLOURS - 1, &others);
        let mut palette = vec![background];
        palette.extend(network.color_map_rgb().chunks_exact(3).map(|c| [c[0], c[1], c[2]]));
        let index = |pixel| if pixel == background { 0 } else { network.index_of(&opaque(pixel)) as u8 + 1 };
        let indices = pixels().map(index).collect();
        (palette, indices)
    }
}

/// As many as a byte tells apart.
const MOST_COLOURS: usize = 256;

/// The network is trained by each pixel, not by every tenth.
const EVERY_PIXEL: i32 = 1;

fn finish(mut encoder: Encoder<'_, &mut Vec<u8>>, data: &[u8]) -> Result<(), PictureError> {
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    let written =
        encoder.write_header().and_then(|mut writer| writer.write_image_data(data).and_then(|()| writer.finish()));
    written.map_err(|e| PictureError::bad("content", "a PNG image", e))
}
