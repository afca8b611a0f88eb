use std::borrow::Cow;
use std::cell::{Cell, OnceCell};
use std::path::{Component, Path, PathBuf};

use ::gltf::Glb;
use ::gltf::json::Root;
use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use pliant_files::read_regular;

use crate::error::Fault;

/// JSON text and binary chunk of a file, which is a GLB if it says so and plain JSON if not.
pub(super) fn container(bytes: &[u8]) -> Result<(&[u8], Option<Vec<u8>>), Fault> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
    }
    // `Glb::from_slice` subtracts 12 from this length unchecked, and reads chunks beyond it.
    let declared = bytes.get(8..12).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let content = match declared {
        Some(length @ 20..) if length <= bytes.len() => &bytes[..length],
        Some(length) => {
            let reason = format!("truncated: the file declares {length} bytes and has {}", bytes.len());
            return Err(Fault::byte(8, reason));
        }
        None => return Err(Fault::file("truncated: the file ends inside the GLB header")),
    };
    let glb = Glb::from_slice(content).map_err(|e| Fault::file(format!("not a GLB file: {e}")))?;
    let json = match glb.json {
        Cow::Borrowed(json) => json,
        Cow::Owned(_) => return Err(Fault::file("the GLB's JSON chunk is not part of it")),
    };
    Ok((json, glb.bin.map(Cow::into_owned)))
}

/// The file's buffers, each loaded when first asked for: those of images only are never opened.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    chunk: Option<Vec<u8>>,
    folder: Option<&'a Path>,
    loaded: Vec<OnceCell<Vec<u8>>>,
    /// Bytes from other files that nobody has asked about.
    new_external: Cell<u64>,
}

impl<'a> Buffers<'a> {
    /// `chunk` is the binary chunk of a GLB; `folder` the one whose files may be named, none to open no file.
    pub(super) fn new(root: &'a Root, chunk: Option<Vec<u8>>, folder: Option<&'a Path>) -> Self {
        Self { root, chunk, folder, loaded: vec![OnceCell::new(); root.buffers.len()], new_external: Cell::new(0) }
    }

    /// As many bytes as the buffer declares.
    pub(super) fn get(&self, index: usize) -> Result<&[u8], Fault> {
        let name = format!("buffer {index}");
        let (Some(buffer), Some(cell)) = (self.root.buffers.get(index), self.loaded.get(index)) else {
            return Err(Fault::item(name, "is not there"));
        };
        let fail = |reason: String| Fault::item(name.clone(), reason);
        let bytes: &[u8] = match (&buffer.uri, &self.chunk) {
            (Some(uri), _) => match cell.get() {
                Some(bytes) => bytes,
                None => {
                    let bytes = self.load(uri).map_err(fail)?;
                    cell.get_or_init(|| bytes)
                }
            },
            (None, Some(chunk)) if index == 0 => chunk,
            (None, _) => return Err(fail("has neither an address nor the file's binary chunk".to_owned())),
        };
        let declared = usize::try_from(buffer.byte_length.0).ok();
        declared.and_then(|length| bytes.get(..length)).ok_or_else(|| {
            fail(format!("truncated: {} bytes are declared, {} are there", buffer.byte_length.0, bytes.len()))
        })
    }

    fn load(&self, uri: &str) -> Result<Vec<u8>, String> {
        if let Some(data) = uri.strip_prefix("data:") {
            return decode_data(data);
        }
        let folder = self.folder.ok_or("lies in another file, which is not opened here")?;
        let path = path_inside(folder, uri)?;
        let bytes = read_regular(&path, u64::MAX).map_err(|e| e.to_string())?;
        self.new_external.set(self.new_external.get() + bytes.len() as u64);
        Ok(bytes)
    }

    /// Bytes loaded from other files since the last call.
    pub(super) fn take_new_external_bytes(&self) -> u64 {
        self.new_external.take()
    }
}

/// The content of a `data:` address; `media type;base64,text` is the only kind that glTF uses.
fn decode_data(data: &str) -> Result<Vec<u8>, String> {
    let (head, text) = data.split_once(',').ok_or("its data: address has no comma")?;
    if !head.ends_with(";base64") {
        return Err("its data: address is not base64".to_owned());
    }
    let lenient = GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    GeneralPurpose::new(&base64::alphabet::STANDARD, lenient)
        .decode(text)
        .map_err(|e| format!("its data: address is not valid base64: {e}"))
}

/// The file that a relative address names, if it lies in `folder` or below.
fn path_inside(folder: &Path, uri: &str) -> Result<PathBuf, String> {
    let decoded = percent_encoding::percent_decode_str(uri).decode_utf8();
    let decoded = decoded.map_err(|_| format!("its address {uri:?} is not UTF-8"))?;
    let relative = Path::new(decoded.as_ref());
    // Colons and backslashes are refused on every system, since some take them for drives and separators.
    let stays = relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if decoded.is_empty() || !stays || decoded.contains([':', '\\', '\0']) {
        return Err(format!("its address {uri:?} is not that of a file in the folder"));
    }
    // A link may lead outside too.
    let system = |path: &Path, e: std::io::Error| format!("{}: cannot open: {e}", path.display());
    let home = folder.canonicalize().map_err(|e| system(folder, e))?;
    let path = folder.join(relative);
    let target = path.canonicalize().map_err(|e| system(&path, e))?;
    if target.starts_with(&home) { Ok(target) } else { Err(format!("its address {uri:?} leads out of the folder")) }
}
