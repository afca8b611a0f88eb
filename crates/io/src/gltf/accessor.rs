use ::gltf::json::Root;
use ::gltf::json::accessor::{Accessor, ComponentType, Type, sparse};
use ::gltf::json::validation::Checked;

use super::buffers::Buffers;
use crate::error::Fault;

/// Reads accessors, with every offset, length and type checked.
pub(super) struct Accessors<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    /// Numbers that may still be made.
    allowance: u64,
}

/// Numbers that every file may expand to, and how many more for each byte that they are read from.
///
/// A scene may place one mesh many times, and a sparse accessor is mostly zeros, so a small file can honestly be a large
/// mesh; but not without end.
const ALLOWANCE: u64 = 1 << 24;
const ALLOWANCE_PER_BYTE: u64 = 64;

/// Equally spaced elements of one type.
struct Elements<'n> {
    /// The accessor, for messages.
    name: &'n str,
    component: ComponentType,
    /// Components of an element.
    width: usize,
    count: usize,
}

impl<'a> Accessors<'a> {
    /// The numbers made are bounded by `file_length` and by the buffers in other files.
    pub(super) fn new(root: &'a Root, buffers: &'a Buffers<'a>, file_length: usize) -> Self {
        let allowance = ALLOWANCE.saturating_add(ALLOWANCE_PER_BYTE.saturating_mul(file_length as u64));
        Self { root, buffers, allowance }
    }

    /// All components of an accessor, element after element: three a position (`Vec3`), one an index (`Scalar`).
    ///
    /// Positions may be f32 or, as `KHR_mesh_quantization` has it, 8- or 16-bit integers; indices are unsigned integers.
    pub(super) fn numbers(&mut self, index: usize, wanted: Type) -> Result<Vec<f64>, Fault> {
        let name = format!("accessor {index}");
        let accessor = self.root.accessors.get(index).ok_or_else(|| Fault::item(&name, "is not there"))?;
        let elements = Elements::of(accessor, wanted, &name)?;
        let total = elements.count.saturating_mul(elements.width);
        let mut numbers = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.unwrap_or_default().0;
                let bytes = self.elements(view.value(), offset, &elements)?;
                self.spend(total, &name)?;
                bytes.decode(&elements)
            }
            None => {
                self.spend(total, &name)?;
                vec![0.0; total]
            }
        };
        if let Some(sparse) = &accessor.sparse {
            self.substitute(sparse, &elements, &mut numbers)?;
        }
        if accessor.normalized {
            normalise(&mut numbers, elements.component);
        }
        Ok(numbers)
    }

    fn spend(&mut self, numbers: usize, name: &str) -> Result<(), Fault> {
        let external = ALLOWANCE_PER_BYTE.saturating_mul(self.buffers.take_new_external_bytes());
        let left = self.allowance.saturating_add(external).checked_sub(numbers as u64);
        self.allowance = left.ok_or_else(|| {
            Fault::item(name, "with it the scene expands to more than 64 numbers for each byte of the file")
        })?;
        Ok(())
    }

    /// The bytes of `elements` at `offset` in a buffer view.
    fn elements(&self, view_index: usize, offset: u64, elements: &Elements<'_>) -> Result<Bytes<'a>, Fault> {
        let fail = |reason: &str| Fault::item(elements.name, reason);
        let view = self.root.buffer_views.get(view_index).ok_or_else(|| fail("its buffer view is not there"))?;
        let buffers: &'a Buffers<'a> = self.buffers;
        let buffer = buffers.get(view.buffer.value())?;
        let size = elements.width * elements.component.size();
        let stride = match view.byte_stride {
            Some(stride) if stride.0 != 0 => stride.0,
            _ => size,
        };
        if stride < size {
            return Err(fail("the stride is smaller than an element"));
        }
        let usable = |n: u64| usize::try_from(n).map_err(|_| fail("an offset or length is too large"));
        let start = usable(view.byte_offset.unwrap_or_default().0)?;
        let bytes = usable(view.byte_length.0)?
            .checked_add(start)
            .and_then(|end| buffer.get(start..end))
            .ok_or_else(|| fail("its buffer view ends beyond the buffer"))?;
        let bytes = bytes.get(usable(offset)?..).ok_or_else(|| fail("it starts beyond its buffer view"))?;
        // The last element need not be followed by the gap to the next.
        let needed = match elements.count {
            0 => Some(0),
            n => stride.checked_mul(n - 1).and_then(|gap| gap.checked_add(size)),
        };
        match needed {
            Some(needed) if needed <= bytes.len() => Ok(Bytes { bytes, stride }),
            _ => Err(fail(&format!("its {} elements end beyond its buffer view", elements.count))),
        }
    }

    /// Overwrites single elements, as sparse accessors do.
    fn substitute(&self, sparse: &sparse::Sparse, elements: &Elements<'_>, numbers: &mut [f64]) -> Result<(), Fault> {
        let fail = |reason: &str| Fault::item(elements.name, reason);
        let Checked::Valid(index_type) = sparse.indices.component_type else {
            return Err(fail("the component type of its sparse indices is unknown"));
        };
        let count = usize::try_from(sparse.count.0).ok().filter(|&n| n <= elements.count);
        let count = count.ok_or_else(|| fail("it has more sparse elements than elements"))?;
        let index_layout = Elements { name: elements.name, component: index_type.0, width: 1, count };
        let value_layout = Elements { count, ..*elements };
        let indices = self.elements(sparse.indices.buffer_view.value(), sparse.indices.byte_offset.0, &index_layout)?;
        let values = self.elements(sparse.values.buffer_view.value(), sparse.values.byte_offset.0, &value_layout)?;
        let values = values.decode(&value_layout);
        for (&index, value) in indices.decode(&index_layout).iter().zip(values.chunks_exact(elements.width)) {
            if index >= elements.count as f64 {
                return Err(fail("a sparse index is out of range"));
            }
            let start = index as usize * elements.width;
            numbers[start..start + elements.width].copy_from_slice(value);
        }
        Ok(())
    }
}

impl<'n> Elements<'n> {
    /// The elements of an accessor that is used as `wanted`.
    fn of(accessor: &Accessor, wanted: Type, name: &'n str) -> Result<Self, Fault> {
        let fail = |reason: String| Fault::item(name, reason);
        let Checked::Valid(component) = accessor.component_type else {
            return Err(fail("the component type is unknown".to_owned()));
        };
        if accessor.type_ != Checked::Valid(wanted) {
            return Err(fail(format!("the type is {:?}, where {wanted:?} is needed", accessor.type_)));
        }
        let component = component.0;
        let (use_, allowed): (_, &[ComponentType]) = match wanted {
            Type::Scalar => ("indices", &[ComponentType::U8, ComponentType::U16, ComponentType::U32]),
            _ => (
                "positions",
                &[ComponentType::F32, ComponentType::I8, ComponentType::U8, ComponentType::I16, ComponentType::U16],
            ),
        };
        if !allowed.contains(&component) {
            return Err(fail(format!("{use_} cannot have the component type {component:?}")));
        }
        let count = usize::try_from(accessor.count.0).map_err(|_| fail("the count is too large".to_owned()))?;
        Ok(Self { name, component, width: wanted.multiplicity(), count })
    }
}

/// Bytes that hold all of some [`Elements`], one every `stride`.
struct Bytes<'b> {
    bytes: &'b [u8],
    stride: usize,
}

impl Bytes<'_> {
    fn decode(&self, elements: &Elements<'_>) -> Vec<f64> {
        let size = elements.component.size();
        let mut numbers = Vec::with_capacity(elements.count * elements.width);
        for i in 0..elements.count {
            let element = &self.bytes[i * self.stride..];
            let components = element.chunks_exact(size).take(elements.width);
            numbers.extend(components.map(|raw| component(raw, elements.component)));
        }
        numbers
    }
}

/// A number from exactly as many bytes as its type has.
fn component(raw: &[u8], kind: ComponentType) -> f64 {
    match kind {
        ComponentType::I8 => f64::from(raw[0] as i8),
        ComponentType::U8 => f64::from(raw[0]),
        ComponentType::I16 => f64::from(i16::from_le_bytes([raw[0], raw[1]])),
        ComponentType::U16 => f64::from(u16::from_le_bytes([raw[0], raw[1]])),
        ComponentType::U32 => f64::from(u32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]])),
        ComponentType::F32 => f64::from(f32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]])),
    }
}

/// Integers as fractions of their type's largest value (glTF 2.0, section 3.11); floats stay.
fn normalise(numbers: &mut [f64], component: ComponentType) {
    let largest = match component {
        ComponentType::I8 => f64::from(i8::MAX),
        ComponentType::U8 => f64::from(u8::MAX),
        ComponentType::I16 => f64::from(i16::MAX),
        ComponentType::U16 => f64::from(u16::MAX),
        ComponentType::U32 | ComponentType::F32 => return,
    };
    for number in numbers {
        *number = (*number / largest).max(-1.0);
    }
}
