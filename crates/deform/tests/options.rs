//! Options of the methods: what is refused, and their two written forms.

mod common;

use common::pyramid;
use pliant_deform::arap::{Acceleration, ArapEnergy, ArapOptions, EdgeWeightKind, Start};
use pliant_deform::implicit::{FeatureSize, ImplicitConstraints, ImplicitOptions, ImplicitStage};
use pliant_deform::laplacian::{Details, LaplacianOptions};
use pliant_deform::{DeformError, Handle, Method, Region};
use pliant_mesh::VertexSet;

#[test]
fn options_are_checked_and_read() {
    let mesh = pyramid();
    let region = Region::new(5, &VertexSet::all(5), &[Handle::hard(VertexSet::from_iter([0]))]).expect("valid");
    let refused = |options: ArapOptions| match Method::Arap(options).prepare(&mesh, &region) {
        Err(DeformError::BadOption { option, .. }) => option,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("accepted"),
    };
    let with_tolerance = |t| ArapOptions { tolerance: Some(t), ..ArapOptions::default() };
    for t in [f64::NAN, -1e-9, f64::INFINITY] {
        assert_eq!(refused(with_tolerance(t)), "tolerance");
    }
    for smoothness in [-1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(refused(ArapOptions { smoothness, ..ArapOptions::default() }), "smoothness");
    }
    assert_eq!(refused(ArapOptions { iterations: 1_000_000_000, ..ArapOptions::default() }), "iterations");
    let other = Region::new(6, &VertexSet::all(6), region.handles()).expect("valid");
    assert!(matches!(Method::default().prepare(&mesh, &other), Err(DeformError::WrongCount { .. })));

    let text = r#"{"arap": {"weights": "uniform", "energy": "spokes_and_rims", "tolerance": 1e-4}}"#;
    let method: Method = serde_json::from_str(text).expect("valid");
    let expected = ArapOptions {
        weights: EdgeWeightKind::Uniform,
        energy: ArapEnergy::SpokesAndRims,
        iterations: 2,
        tolerance: Some(1e-4),
        ..ArapOptions::default()
    };
    assert_eq!(method, Method::Arap(expected));
    assert!(serde_json::from_str::<Method>(r#"{"arap": {"wieghts": "uniform"}}"#).is_err());
    for method in [Method::default(), Method::Arap(ArapOptions::faithful()), Method::Arap(ArapOptions::converged())] {
        let text = serde_json::to_string(&method).expect("plain data");
        assert_eq!(serde_json::from_str::<Method>(&text).expect("own text"), method);
    }
}

#[test]
fn methods_have_a_short_text_form() {
    let rich = ArapOptions {
        weights: EdgeWeightKind::Uniform,
        energy: ArapEnergy::Spokes,
        smoothness: 0.01,
        iterations: 50,
        tolerance: Some(3.25e-7),
        acceleration: Acceleration::Anderson { window: 5 },
        start: Start::Propagated,
    };
    for (options, text) in [
        (ArapOptions::default(), "arap"),
        (ArapOptions::faithful(), "arap:uniform+spokes"),
        (rich, "arap:uniform+spokes+smooth=0.01+iterations=50+tolerance=3.25e-7+anderson=5+propagated"),
    ] {
        let method = Method::Arap(options);
        assert_eq!(method.to_string(), text);
        assert_eq!(text.parse(), Ok(method));
    }
    assert_eq!("arap:cotangent+spokes-and-rims".parse(), Ok(Method::default()));
    for (text, lists) in [("", "arap"), ("rap", "arap"), ("arap:round", "cotangent"), ("arap:uniform+", "uniform")] {
        let error = text.parse::<Method>().expect_err("unknown").to_string();
        assert!(error.contains(lists), "{text}: {error}");
    }
    assert!("arap:iterations=-1".parse::<Method>().is_err() && "arap:iterations".parse::<Method>().is_err());
}

#[test]
fn laplacian_options_are_read_and_printed() {
    let weights = [EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform];
    let details = [Details::Plain, Details::TwoStep, Details::Similarity, Details::Propagated];
    for options in weights.into_iter().flat_map(|weights| details.map(|details| LaplacianOptions { weights, details }))
    {
        let method = Method::Laplacian(options);
        assert_eq!(method.to_string().parse(), Ok(method.clone()));
        let text = serde_json::to_string(&method).expect("plain data");
        assert_eq!(serde_json::from_str::<Method>(&text).expect("own text"), method);
        assert_eq!(method.with_iterations(7).until_converged(1e-3, 9), method);
    }
    let named = "laplacian:uniform+two-step".parse();
    let expected = LaplacianOptions { weights: EdgeWeightKind::Uniform, details: Details::TwoStep };
    assert_eq!(named, Ok(Method::Laplacian(expected)));
    assert_eq!(Method::Laplacian(LaplacianOptions::default()).to_string(), "laplacian");
    let error = "laplacian:twostep".parse::<Method>().expect_err("unknown").to_string();
    assert!(error.contains("two-step") && error.contains("'twostep'"), "{error}");
    assert!(serde_json::from_str::<Method>(r#"{"laplacian": {"detail": "plain"}}"#).is_err());
}

#[test]
fn implicit_options_are_read_and_printed() {
    for (text, options) in [
        ("implicit", ImplicitOptions::default()),
        (
            "implicit:uniform+rings=1",
            ImplicitOptions { weights: EdgeWeightKind::Uniform, rings: 1, ..Default::default() },
        ),
        (
            "implicit:gradients+keep-features+preview",
            ImplicitOptions {
                constraints: ImplicitConstraints::Gradients,
                features: FeatureSize::Keep,
                stage: ImplicitStage::Preview,
                ..Default::default()
            },
        ),
        (
            "implicit:positions+scale-features",
            ImplicitOptions {
                constraints: ImplicitConstraints::Positions,
                features: FeatureSize::Scale,
                ..Default::default()
            },
        ),
    ] {
        let method = Method::Implicit(options);
        assert_eq!(method.to_string(), text);
        assert_eq!(text.parse(), Ok(method.clone()));
        let json = serde_json::to_string(&method).expect("serialisable");
        assert_eq!(serde_json::from_str::<Method>(&json).expect("the same"), method);
    }
    let defaults: Method = "implicit:cotangent+rings=2+both+auto-features+full".parse().expect("valid");
    assert_eq!(defaults, Method::Implicit(ImplicitOptions::default()));
    for wrong in ["implicit:rings", "implicit:rings=-1", "implicit:tolerance=1", "implicit:both+"] {
        let error = wrong.parse::<Method>().expect_err(wrong).to_string();
        assert!(error.contains("rings=N") && error.contains("scale-features"), "{error}");
    }
}
