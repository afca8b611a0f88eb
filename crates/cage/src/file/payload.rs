//! What follows the header: options, report, cage, rows, and where they come from.
//!
//! | part | numbers |
//! |---|---|
//! | options | rule, its parameter, support, exact, smoothing, tiny |
//! | report | the fields of [`BindReport`] in their order |
//! | cage | number of vertices and of faces, positions, triangles |
//! | rows | see [`rows`] |
//! | smoothing rows, where flagged | the same, numbered as the cage is |
//! | simplification, where flagged | kind and value of the size, boundary weight, report, origins, owners |
//!
//! Counts and integers of options and reports are u64; the kinds of things, vertex numbers and lengths of rows u32; weights f32, all else
//! f64.

use glam::DVec3;
use pliant_mesh::TriMesh;

use super::bytes::{Reader, Writer};
use super::{BindingFault, SavedCage, header, rows};
use crate::{BindOptions, BindReport, Binding, CageSize, Prune, Simplified, SimplifyOptions, SimplifyReport, Support};

/// How a row is called.
const ROW: &str = "row";

/// How a row of [`Binding::smoothing_row`] is called.
const SMOOTHING_ROW: &str = "smoothing row";

/// Writes all that a header does not say, and returns the flags it has to say.
pub(super) fn write(saved: &SavedCage) -> Result<(u32, Vec<u8>), BindingFault> {
    let SavedCage { binding, options, simplified } = saved;
    let mut flags = 0;
    let mut writer = Writer::default();
    write_options(options, &mut writer);
    write_report(binding.report(), &mut writer);
    let triangles = binding.cage_topology.triangles();
    writer.count(binding.cage.len());
    writer.count(triangles.len());
    writer.points(&binding.cage);
    writer.triangles(triangles);
    rows::write(&binding.rows, &mut writer);
    if let Some(smoothing) = &binding.smoothing {
        flags |= header::SMOOTHED;
        // The ranks are made again on reading.
        let packed = &binding.packed;
        rows::write(&smoothing.renumbered(&packed.rank, &packed.by_rank), &mut writer);
    }
    if let Some((options, simplified)) = simplified {
        flags |= header::SIMPLIFIED;
        let same_bits = |p: &DVec3, q: &DVec3| p.to_array().map(f64::to_bits) == q.to_array().map(f64::to_bits);
        let mesh = &simplified.mesh;
        let same_places = mesh.positions.len() == binding.cage.len()
            && mesh.positions.iter().zip(&binding.cage).all(|(p, q)| same_bits(p, q));
        if !same_places || mesh.triangles() != triangles {
            return Err(BindingFault::Unmatched);
        }
        check_origins(&simplified.origin, &simplified.owner, &binding.cage, &binding.shape)?;
        write_simplified(options, simplified, &mut writer);
    }
    Ok((flags, writer.bytes))
}

/// Reads what [`write`] wrote for a header with these flags.
pub(super) fn read(payload: &[u8], flags: u32, shape: &TriMesh) -> Result<SavedCage, BindingFault> {
    let mut reader = Reader::new(payload);
    let options = read_options(&mut reader)?;
    let report = read_report(&mut reader)?;
    let (vertices, faces) = (reader.u64("cage vertices")?, reader.u64("cage faces")?);
    let positions = reader.points("cage vertices", vertices)?;
    let triangles = reader.triangles("cage faces", faces)?;
    let cage = TriMesh::new(positions, triangles)?;
    let cage_vertices = cage.vertex_count();
    let made = rows::read(&mut reader, ROW, shape.vertex_count(), cage_vertices)?;
    let smoothing = match flags & header::SMOOTHED != 0 {
        true => Some(rows::read(&mut reader, SMOOTHING_ROW, cage_vertices, cage_vertices)?),
        false => None,
    };
    let simplified = match flags & header::SIMPLIFIED != 0 {
        true => Some(read_simplified(&mut reader, &cage, shape)?),
        false => None,
    };
    reader.end()?;
    if report.rows != shape.vertex_count() {
        return Err(BindingFault::Value { what: "the report's number of rows", found: report.rows.to_string() });
    }
    let binding = Binding::of_rows(shape, &cage, made, smoothing, report);
    Ok(SavedCage { binding, options, simplified })
}

fn write_options(options: &BindOptions, writer: &mut Writer) {
    let BindOptions { prune, support, smoothing, tiny, exact } = *options;
    match prune {
        Prune::None => {
            writer.u32(0);
            writer.u64(0);
        }
        Prune::Magnitude(share) => {
            writer.u32(1);
            writer.f64(share);
        }
        Prune::Local { neighbours } => {
            writer.u32(2);
            writer.count(neighbours);
        }
        Prune::Smooth { neighbours } => {
            writer.u32(3);
            writer.count(neighbours);
        }
    }
    writer.u32(match support {
        Support::Surface => 0,
        Support::Space => 1,
        Support::Rings => 2,
    });
    writer.u32(u32::from(exact));
    writer.count(smoothing);
    writer.f64(tiny);
}

fn read_options(reader: &mut Reader<'_>) -> Result<BindOptions, BindingFault> {
    let prune = match reader.u32("rule")? {
        0 => match reader.u64("parameter of no rule")? {
            0 => Prune::None,
            found => return Err(BindingFault::Value { what: "parameter of no rule", found: found.to_string() }),
        },
        1 => Prune::Magnitude(reader.f64("share of magnitude")?),
        2 => Prune::Local { neighbours: reader.count("neighbours")? },
        3 => Prune::Smooth { neighbours: reader.count("neighbours")? },
        found => return Err(BindingFault::Value { what: "rule", found: found.to_string() }),
    };
    let support = match reader.u32("support")? {
        0 => Support::Surface,
        1 => Support::Space,
        2 => Support::Rings,
        found => return Err(BindingFault::Value { what: "support", found: found.to_string() }),
    };
    let exact = read_bool(reader, "exact")?;
    let options =
        BindOptions { prune, support, exact, smoothing: reader.count("smoothing")?, tiny: reader.f64("tiny")? };
    options.check()?;
    Ok(options)
}

fn read_bool(reader: &mut Reader<'_>, what: &'static str) -> Result<bool, BindingFault> {
    match reader.u32(what)? {
        0 => Ok(false),
        1 => Ok(true),
        found => Err(BindingFault::Value { what, found: found.to_string() }),
    }
}

fn write_report(report: &BindReport, writer: &mut Writer) {
    // Named one by one: a field that is added has to be written, too.
    let BindReport {
        rows,
        kept_mean,
        kept_median,
        kept_p99,
        kept_max,
        rest_error_rms,
        rest_error_max,
        negative_share,
        largest_magnitude,
        unsafe_rows,
        replaced_rows,
        cage_open_edges,
        linear_precision_error,
        unmeasured_rows,
    } = *report;
    writer.count(rows);
    writer.f64(kept_mean);
    writer.count(kept_median);
    writer.count(kept_p99);
    writer.count(kept_max);
    writer.f64(rest_error_rms);
    writer.f64(rest_error_max);
    writer.f64(negative_share);
    writer.f64(largest_magnitude);
    writer.count(unsafe_rows);
    writer.count(replaced_rows);
    writer.count(cage_open_edges);
    writer.f64(linear_precision_error);
    writer.count(unmeasured_rows);
}

fn read_report(reader: &mut Reader<'_>) -> Result<BindReport, BindingFault> {
    const WHAT: &str = "a number of the report";
    Ok(BindReport {
        rows: reader.count(WHAT)?,
        kept_mean: reader.f64(WHAT)?,
        kept_median: reader.count(WHAT)?,
        kept_p99: reader.count(WHAT)?,
        kept_max: reader.count(WHAT)?,
        rest_error_rms: reader.f64(WHAT)?,
        rest_error_max: reader.f64(WHAT)?,
        negative_share: reader.f64(WHAT)?,
        largest_magnitude: reader.f64(WHAT)?,
        unsafe_rows: reader.count(WHAT)?,
        replaced_rows: reader.count(WHAT)?,
        cage_open_edges: reader.count(WHAT)?,
        linear_precision_error: reader.f64(WHAT)?,
        unmeasured_rows: reader.count(WHAT)?,
    })
}

fn write_simplified(options: &SimplifyOptions, simplified: &Simplified, writer: &mut Writer) {
    let SimplifyOptions { size, boundary_weight } = *options;
    match size {
        CageSize::Vertices(vertices) => {
            writer.u32(0);
            writer.count(vertices);
        }
        CageSize::Fraction(share) => {
            writer.u32(1);
            writer.f64(share);
        }
        CageSize::Error(error) => {
            writer.u32(2);
            writer.f64(error);
        }
    }
    writer.f64(boundary_weight);
    let SimplifyReport { asked, reached, estimated_error, locked, unused, flipped_faces } = simplified.report;
    writer.u32(u32::from(asked.is_some()));
    writer.count(asked.unwrap_or_default());
    writer.count(reached);
    writer.f64(estimated_error);
    writer.count(locked);
    writer.count(unused);
    writer.count(flipped_faces);
    writer.u32s(&simplified.origin);
    writer.u32s(&simplified.owner);
}

fn read_simplified(
    reader: &mut Reader<'_>,
    cage: &TriMesh,
    shape: &TriMesh,
) -> Result<(SimplifyOptions, Simplified), BindingFault> {
    const WHAT: &str = "a number of the simplification";
    let size = match reader.u32("kind of size")? {
        0 => CageSize::Vertices(reader.count(WHAT)?),
        1 => CageSize::Fraction(reader.f64(WHAT)?),
        2 => CageSize::Error(reader.f64(WHAT)?),
        found => return Err(BindingFault::Value { what: "kind of size", found: found.to_string() }),
    };
    let options = SimplifyOptions { size, boundary_weight: reader.f64(WHAT)? };
    let (was_asked, asked) = (read_bool(reader, WHAT)?, reader.count(WHAT)?);
    let report = SimplifyReport {
        asked: was_asked.then_some(asked),
        reached: reader.count(WHAT)?,
        estimated_error: reader.f64(WHAT)?,
        locked: reader.count(WHAT)?,
        unused: reader.count(WHAT)?,
        flipped_faces: reader.count(WHAT)?,
    };
    let origin = reader.u32s("origins", cage.vertex_count() as u64)?;
    let owner = reader.u32s("owners", shape.vertex_count() as u64)?;
    check_origins(&origin, &owner, &cage.positions, &shape.positions)?;
    Ok((options, Simplified { mesh: cage.clone(), origin, owner, report }))
}

/// What [`Simplified`] says of its origins and owners.
fn check_origins(origin: &[u32], owner: &[u32], cage: &[DVec3], shape: &[DVec3]) -> Result<(), BindingFault> {
    if origin.len() != cage.len() || owner.len() != shape.len() {
        return Err(BindingFault::Unmatched);
    }
    for (j, (&v, place)) in origin.iter().zip(cage).enumerate() {
        let after_the_last = j == 0 || origin[j - 1] < v;
        if !after_the_last || shape.get(v as usize) != Some(place) {
            return Err(BindingFault::Origin { cage_vertex: j, shape_vertex: v });
        }
        if owner[v as usize] as usize != j {
            return Err(BindingFault::Owner { shape_vertex: v as usize, owner: owner[v as usize] });
        }
    }
    let sound = |o: &u32| (*o as usize) < cage.len() || *o == Simplified::NO_OWNER;
    match owner.iter().position(|o| !sound(o)) {
        Some(v) => Err(BindingFault::Owner { shape_vertex: v, owner: owner[v] }),
        None => Ok(()),
    }
}
