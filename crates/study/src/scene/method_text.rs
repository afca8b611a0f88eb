//! Methods in scenes, written as they are typed.

use pliant_deform::Method;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

pub(super) fn serialize<S: Serializer>(method: &Option<Method>, to: S) -> Result<S::Ok, S::Error> {
    method.as_ref().map(Method::to_string).serialize(to)
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Method>, D::Error> {
    let text = Option::<String>::deserialize(from)?;
    text.map(|text| text.parse().map_err(de::Error::custom)).transpose()
}

#[cfg(test)]
mod tests {
    use crate::Scene;

    /// A method stands in a scene as it is typed, and survives the way to JSON and back; a wrong one is refused with its place and the valid ones.
    #[test]
    fn scenes_keep_their_method() {
        let plain = Scene::builtin("creature").expect("built in");
        assert!(plain.method.is_none() && !plain.to_json().expect("finite").contains("method"));
        for text in
            ["arap:uniform+spokes", "laplacian:two-step", "implicit:rings=1", "dual", "rotation-invariant:edges"]
        {
            let scene = Scene { method: Some(text.parse().expect("a method")), ..plain.clone() };
            let json = scene.to_json().expect("finite");
            assert!(json.contains(&format!("\"method\": \"{text}\"")), "{json}");
            assert_eq!(Scene::parse(json.as_bytes(), "scene.json").expect("read back"), scene);
        }
        let json = plain.to_json().expect("finite").replacen('{', "{ \"method\": \"magic\",", 1);
        let error = Scene::parse(json.as_bytes(), "scene.json").expect_err("no method").to_string();
        for word in ["scene.json:1", "magic", "rotation-invariant"] {
            assert!(error.contains(word), "{error}");
        }
    }
}
