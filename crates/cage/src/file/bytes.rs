//! Little-endian numbers one after the other, and no room made for more of them than there are.

use glam::DVec3;

use super::BindingFault;

/// Appends numbers.
#[derive(Default)]
pub(super) struct Writer {
    pub(super) bytes: Vec<u8>,
}

impl Writer {
    pub(super) fn u32(&mut self, number: u32) {
        self.bytes.extend_from_slice(&number.to_le_bytes());
    }

    pub(super) fn u64(&mut self, number: u64) {
        self.bytes.extend_from_slice(&number.to_le_bytes());
    }

    pub(super) fn count(&mut self, count: usize) {
        self.u64(count as u64);
    }

    pub(super) fn f64(&mut self, number: f64) {
        self.u64(number.to_bits());
    }

    pub(super) fn u32s(&mut self, numbers: &[u32]) {
        self.all(numbers, u32::to_le_bytes);
    }

    pub(super) fn f32s(&mut self, numbers: &[f32]) {
        self.all(numbers, f32::to_le_bytes);
    }

    pub(super) fn points(&mut self, points: &[DVec3]) {
        self.all(points, |p| columns(p.to_array().map(f64::to_le_bytes)));
    }

    pub(super) fn triangles(&mut self, triangles: &[[u32; 3]]) {
        self.u32s(triangles.as_flattened());
    }

    fn all<T: Copy, const N: usize>(&mut self, values: &[T], bytes: impl Fn(T) -> [u8; N]) {
        let start = self.bytes.len();
        self.bytes.resize(start + N * values.len(), 0);
        for (to, value) in self.bytes[start..].as_chunks_mut().0.iter_mut().zip(values) {
            *to = bytes(*value);
        }
    }
}

/// The bytes of a point's coordinates end to end.
fn columns(coordinates: [[u8; 8]; 3]) -> [u8; 24] {
    let mut bytes = [0; 24];
    bytes.copy_from_slice(coordinates.as_flattened());
    bytes
}

/// Takes numbers off the front.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    /// The bytes of `count` values of `size` bytes each, if there are as many.
    fn take(&mut self, what: &'static str, count: u64, size: u64) -> Result<&'a [u8], BindingFault> {
        let left = self.bytes.len() as u64;
        match count.checked_mul(size).filter(|length| *length <= left) {
            // Not longer than a slice, so it fits.
            Some(length) => {
                let (taken, rest) = self.bytes.split_at(length as usize);
                self.bytes = rest;
                Ok(taken)
            }
            None => Err(BindingFault::Count { what, count, size, left }),
        }
    }

    fn number<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], BindingFault> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(what, 1, N as u64)?);
        Ok(bytes)
    }

    fn all<const N: usize, T>(
        &mut self,
        what: &'static str,
        count: u64,
        value: impl Fn([u8; N]) -> T,
    ) -> Result<Vec<T>, BindingFault> {
        let bytes = self.take(what, count, N as u64)?;
        Ok(bytes.as_chunks().0.iter().map(|bytes| value(*bytes)).collect())
    }

    pub(super) fn u32(&mut self, what: &'static str) -> Result<u32, BindingFault> {
        Ok(u32::from_le_bytes(self.number(what)?))
    }

    pub(super) fn u64(&mut self, what: &'static str) -> Result<u64, BindingFault> {
        Ok(u64::from_le_bytes(self.number(what)?))
    }

    /// A count of things in memory, not of what follows.
    pub(super) fn count(&mut self, what: &'static str) -> Result<usize, BindingFault> {
        let found = self.u64(what)?;
        usize::try_from(found).map_err(|_| BindingFault::Value { what, found: found.to_string() })
    }

    /// A finite number.
    pub(super) fn f64(&mut self, what: &'static str) -> Result<f64, BindingFault> {
        let found = f64::from_bits(self.u64(what)?);
        if found.is_finite() { Ok(found) } else { Err(BindingFault::Value { what, found: found.to_string() }) }
    }

    pub(super) fn u32s(&mut self, what: &'static str, count: u64) -> Result<Vec<u32>, BindingFault> {
        self.all(what, count, u32::from_le_bytes)
    }

    pub(super) fn f32s(&mut self, what: &'static str, count: u64) -> Result<Vec<f32>, BindingFault> {
        self.all(what, count, f32::from_le_bytes)
    }

    pub(super) fn points(&mut self, what: &'static str, count: u64) -> Result<Vec<DVec3>, BindingFault> {
        self.all(what, count, |bytes: [u8; 24]| {
            let mut coordinates = bytes.as_chunks().0.iter().map(|c| f64::from_le_bytes(*c));
            DVec3::from_array(std::array::from_fn(|_| coordinates.next().unwrap_or_default()))
        })
    }

    pub(super) fn triangles(&mut self, what: &'static str, count: u64) -> Result<Vec<[u32; 3]>, BindingFault> {
        self.all(what, count, |bytes: [u8; 12]| {
            let mut corners = bytes.as_chunks().0.iter().map(|c| u32::from_le_bytes(*c));
            std::array::from_fn(|_| corners.next().unwrap_or_default())
        })
    }

    /// Refuses what nothing asked for.
    pub(super) fn end(&self) -> Result<(), BindingFault> {
        match self.bytes.len() as u64 {
            0 => Ok(()),
            extra => Err(BindingFault::Unread { extra }),
        }
    }
}
