//! Many pictures on one, in rows and columns with their names.

use super::Picture;
use super::text::{LETTER_WIDTH, LINE_HEIGHT};

/// A row of a contact sheet.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SheetRow {
    /// Stands above the row, at its left.
    pub title: String,
    /// From left to right.
    pub cells: Vec<SheetCell>,
}

/// A picture on a contact sheet.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SheetCell {
    /// The picture; none leaves its place empty.
    pub picture: Option<Picture>,
    /// Stands below it.
    pub caption: String,
}

/// Pixels between cells, and round the sheet.
const GAP: u32 = 8;

const INK: [u8; 3] = [30, 30, 30];

/// Pictures in rows and columns on one colour: a heading above each column, a title above each row, a caption below each picture.
///
/// All columns are as wide as the widest picture or heading, each row as high as its highest picture; pictures are centred.
/// Text is in letters of 6 by 13 pixels; captions are cut where their column ends. Nothing to show makes a picture without pixels.
pub fn contact_sheet(headings: &[String], rows: &[SheetRow], background: [u8; 3]) -> Picture {
    let columns = rows.iter().map(|row| row.cells.len()).chain([headings.len()]).max().unwrap_or(0) as u32;
    if columns == 0 {
        return Picture::filled(0, 0, background);
    }
    let pictures = || rows.iter().flat_map(|row| &row.cells).filter_map(|cell| cell.picture.as_ref());
    let heading_widths = headings.iter().map(|text| text_width(text));
    let cell_width = pictures().map(|picture| picture.width).chain(heading_widths).max().unwrap_or(0);
    let heights: Vec<u32> = rows.iter().map(row_height).collect();
    let width = GAP + columns * (cell_width + GAP);
    let text_rows = 1 + 2 * rows.len() as u32;
    let height = GAP + heights.iter().sum::<u32>() + text_rows * LINE_HEIGHT + (rows.len() as u32 + 1) * GAP;
    let mut sheet = Picture::filled(width, height, background);
    let left = |column: usize| GAP + column as u32 * (cell_width + GAP);
    let centred = |column: usize, text: &str| left(column) + (cell_width - text_width(text).min(cell_width)) / 2;
    for (column, heading) in headings.iter().enumerate() {
        sheet.write_text(centred(column, heading), GAP, heading, INK);
    }
    let mut top = 2 * GAP + LINE_HEIGHT;
    for (row, &height) in rows.iter().zip(&heights) {
        sheet.write_text(GAP, top, &row.title, INK);
        top += LINE_HEIGHT;
        for (column, cell) in row.cells.iter().enumerate() {
            if let Some(picture) = &cell.picture {
                let across = left(column) + (cell_width - picture.width) / 2;
                sheet.put(picture, across, top + (height - picture.height) / 2);
            }
            let room = (cell_width / LETTER_WIDTH) as usize;
            let caption: String = cell.caption.chars().take(room).collect();
            sheet.write_text(centred(column, &caption), top + height, &caption, INK);
        }
        top += height + LINE_HEIGHT + GAP;
    }
    sheet
}

fn row_height(row: &SheetRow) -> u32 {
    row.cells.iter().filter_map(|cell| cell.picture.as_ref()).map(|picture| picture.height).max().unwrap_or(0)
}

fn text_width(text: &str) -> u32 {
    LETTER_WIDTH * text.chars().count() as u32
}
