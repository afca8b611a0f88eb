//! A binding file belongs to a mesh, not to the file the mesh came from.

use std::path::Path;

use pliant::{
    BindOptions, BindingFault, Format, SavedCage, Silent, SimplifyOptions, TriMesh, creature, read_bytes, simplify,
    write_bytes,
};

/// OBJ holds decimals and PLY binary numbers, both all of an f64: the mesh is the same. What was rounded to f32 is another one, as its
/// poses have other bits, and the refusal says that no more than that is between them.
#[test]
fn the_same_mesh_from_other_formats() {
    let shape = creature(2000).expect("valid");
    let (simplify_options, options) = (SimplifyOptions::default(), BindOptions::default());
    let simplified = simplify(&shape, &simplify_options, &Silent).expect("valid");
    let binding = simplified.bind(&shape, &options, &Silent).expect("valid");
    let file = SavedCage { binding, options, simplified: Some((simplify_options, simplified)) };
    let bytes = file.to_bytes().expect("sound");
    let through = |mesh: &TriMesh, format: Format| {
        let file = write_bytes(mesh, format).expect("written");
        read_bytes(&file, format).expect("read").mesh
    };
    for format in [Format::Obj, Format::Ply] {
        SavedCage::from_bytes(&bytes, &through(&shape, format)).expect("the same mesh");
    }
    let single = shape.positions.iter().map(|p| p.as_vec3().as_dvec3()).collect();
    let single = shape.with_positions(single).expect("finite");
    let fault = SavedCage::from_bytes(&bytes, &single).expect_err("another precision");
    assert!(matches!(fault, BindingFault::OtherMesh { rounds_alike: true, .. }), "{fault}");
    // What holds single precision is the same mesh in all formats again, as decimals too.
    let again = through(&through(&single, Format::Obj), Format::Ply);
    let fault = SavedCage::from_bytes(&bytes, &again).expect_err("another precision");
    let BindingFault::OtherMesh { found, .. } = fault else { panic!("{fault}") };
    assert_eq!(found, pliant::Fingerprint::of(&single));
    let path = Path::new("a folder that is not there/mesh.pliant");
    assert!(
        SavedCage::load(path, &shape)
            .expect_err("missing")
            .to_string()
            .starts_with("a folder that is not there/mesh.pliant: ")
    );
}
