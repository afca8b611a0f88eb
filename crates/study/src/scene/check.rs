//! Whether a scene's numbers mean something, before any shape is looked at.

use std::collections::HashSet;
use std::fmt::Display;

use glam::DVec3;

use super::{Scene, SceneError, SceneMotion, SceneRegion};

impl Scene {
    /// Checks names and numbers; [`Scene::parse`] and [`Scene::resolve`] do so themselves.
    ///
    /// # Errors
    /// Names the handle and the path of the first value that is not finite or out of its range, an empty list, or a
    /// name that is empty or used twice.
    pub fn check(&self) -> Result<(), SceneError> {
        let at = Place { scene: &self.name, handle: None };
        at.require(!self.name.trim().is_empty(), "name", "a name", "empty")?;
        at.require(!self.handles.is_empty(), "handles", "a list of at least one handle", "empty")?;
        let mut names = HashSet::new();
        for (k, handle) in self.handles.iter().enumerate() {
            at.require(!handle.name.trim().is_empty(), format!("handles[{k}].name"), "a name", "empty")?;
            let unique = names.insert(handle.name.as_str());
            at.require(unique, format!("handles[{k}].name"), "used once", format!("'{}' again", handle.name))?;
            let at = Place { handle: Some(&handle.name), ..at };
            at.region(&handle.region, "region")?;
            if let Some(motion) = &handle.motion {
                at.motion(motion)?;
            }
        }
        Ok(())
    }
}

/// Where in the scene a value stands.
#[derive(Clone, Copy)]
struct Place<'a> {
    scene: &'a str,
    handle: Option<&'a str>,
}

impl Place<'_> {
    fn require(
        &self,
        holds: bool,
        what: impl Into<String>,
        expected: &'static str,
        found: impl Display,
    ) -> Result<(), SceneError> {
        if holds {
            return Ok(());
        }
        Err(SceneError::BadValue {
            scene: self.scene.to_owned(),
            handle: self.handle.map(str::to_owned),
            what: what.into(),
            expected,
            found: found.to_string(),
        })
    }

    fn region(&self, region: &SceneRegion, path: &str) -> Result<(), SceneError> {
        match region {
            SceneRegion::Box { min, max } => self.limits(min, max, path),
            SceneRegion::Sphere { centre, radius } => {
                self.point(*centre, format!("{path}.sphere.centre"))?;
                self.radius(*radius, format!("{path}.sphere.radius"))
            }
            SceneRegion::HalfSpace { point, normal } => {
                self.point(*point, format!("{path}.half_space.point"))?;
                self.direction(*normal, format!("{path}.half_space.normal"))
            }
            SceneRegion::Geodesic { near, radius } => {
                self.point(*near, format!("{path}.geodesic.near"))?;
                self.radius(*radius, format!("{path}.geodesic.radius"))
            }
            SceneRegion::All(parts) => self.parts(parts, &format!("{path}.all")),
            SceneRegion::Any(parts) => self.parts(parts, &format!("{path}.any")),
        }
    }

    fn parts(&self, parts: &[SceneRegion], path: &str) -> Result<(), SceneError> {
        self.require(!parts.is_empty(), path, "a list of at least one region", "empty")?;
        parts.iter().enumerate().try_for_each(|(k, part)| self.region(part, &format!("{path}[{k}]")))
    }

    fn limits(&self, min: &[Option<f64>; 3], max: &[Option<f64>; 3], path: &str) -> Result<(), SceneError> {
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            for (side, limit) in [("min", min[axis]), ("max", max[axis])] {
                let limit = limit.unwrap_or(0.0);
                self.require(
                    limit.is_finite(),
                    format!("{path}.box.{side}.{letter}"),
                    "a finite number or null",
                    limit,
                )?;
            }
            if let (Some(lo), Some(hi)) = (min[axis], max[axis]) {
                let what = format!("{path}.box.min.{letter}");
                self.require(lo <= hi, what, "at most the same component of max", format!("{lo} above {hi}"))?;
            }
        }
        Ok(())
    }

    fn motion(&self, motion: &SceneMotion) -> Result<(), SceneError> {
        if let Some(rotate) = motion.rotate {
            self.direction(rotate.axis, "motion.rotate.axis".to_owned())?;
            self.require(rotate.degrees.is_finite(), "motion.rotate.degrees", "a finite number", rotate.degrees)?;
        }
        if let Some(pivot) = motion.about {
            self.point(pivot, "motion.about".to_owned())?;
        }
        self.point(motion.translate, "motion.translate".to_owned())?;
        let positive = motion.scale.is_finite() && motion.scale > 0.0;
        self.require(positive, "motion.scale", "a finite number above 0", motion.scale)
    }

    fn point(&self, point: DVec3, what: String) -> Result<(), SceneError> {
        self.require(point.is_finite(), what, "three finite numbers", point)
    }

    fn direction(&self, direction: DVec3, what: String) -> Result<(), SceneError> {
        let valid = direction.is_finite() && direction != DVec3::ZERO;
        self.require(valid, what, "three finite numbers that are not all 0", direction)
    }

    fn radius(&self, radius: f64, what: String) -> Result<(), SceneError> {
        self.require(radius.is_finite() && radius >= 0.0, what, "a finite number not below 0", radius)
    }
}
