use ::gltf::json::{Index, Node, Root};
use glam::{DAffine3, DMat4, DQuat, DVec3};

use crate::error::Fault;
use crate::soup::Soup;

/// Each mesh of the default scene, with its node and its transform to the world, in depth-first order of the nodes.
///
/// The default scene is the one the file names, else its first; without scenes, all nodes that are nobody's child; and
/// without nodes, every mesh once where it is (its "node" is then its own number).
pub(super) fn placed_meshes(root: &Root, soup: &mut Soup) -> Result<Vec<(usize, usize, DAffine3)>, Fault> {
    if root.nodes.is_empty() {
        return Ok((0..root.meshes.len()).map(|mesh| (mesh, mesh, DAffine3::IDENTITY)).collect());
    }
    let mut placed = Vec::new();
    let mut seen = vec![false; root.nodes.len()];
    // A stack, last first: a chain of nodes as deep as the file is long must not exhaust ours.
    let mut stack: Vec<(usize, DAffine3)> =
        top_nodes(root)?.into_iter().rev().map(|n| (n, DAffine3::IDENTITY)).collect();
    while let Some((index, parent)) = stack.pop() {
        let name = || format!("node {index}");
        let node = root.nodes.get(index).ok_or_else(|| Fault::item(name(), "is not there"))?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(Fault::item(name(), "is reached twice: nodes must form trees"));
        }
        let world = parent * local_transform(node).map_err(|reason| Fault::item(name(), reason))?;
        if let Some(mesh) = node.mesh {
            // The joints place a skinned mesh, not its node (glTF 2.0, section 3.7.3.3); it is read in its bind pose.
            let skinned = node.skin.is_some();
            soup.drop("skins", usize::from(skinned));
            placed.push((index, mesh.value(), if skinned { DAffine3::IDENTITY } else { world }));
        }
        stack.extend(node.children.iter().flatten().rev().map(|child| (child.value(), world)));
    }
    let meshes = root.nodes.iter().filter(|n| n.mesh.is_some()).count();
    soup.drop("meshes outside the default scene", meshes - placed.len());
    Ok(placed)
}

fn top_nodes(root: &Root) -> Result<Vec<usize>, Fault> {
    let scene = match root.scene {
        Some(index) => {
            let missing = || Fault::item(format!("scene {}", index.value()), "is the default one, but is not there");
            Some(root.scenes.get(index.value()).ok_or_else(missing)?)
        }
        None => root.scenes.first(),
    };
    if let Some(scene) = scene {
        return Ok(scene.nodes.iter().map(Index::value).collect());
    }
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
        if let Some(flag) = is_child.get_mut(child.value()) {
            *flag = true;
        }
    }
    Ok((0..root.nodes.len()).filter(|&n| !is_child[n]).collect())
}

/// A node's transform to its parent: its matrix, or scale, then rotation, then translation.
fn local_transform(node: &Node) -> Result<DAffine3, String> {
    let transform = match node.matrix {
        Some(columns) => DAffine3::from_mat4(DMat4::from_cols_array(&columns.map(f64::from))),
        None => {
            let vector = |v: Option<[f32; 3]>, default| v.map_or(default, |v| DVec3::from_array(v.map(f64::from)));
            let rotation = match &node.rotation {
                None => DQuat::IDENTITY,
                Some(q) => {
                    let q = DQuat::from_array(q.0.map(f64::from));
                    if !(q.length() > 0.0 && q.is_finite()) {
                        return Err("the rotation is no direction".to_owned());
                    }
                    q.normalize()
                }
            };
            let scale = vector(node.scale, DVec3::ONE);
            DAffine3::from_scale_rotation_translation(scale, rotation, vector(node.translation, DVec3::ZERO))
        }
    };
    if transform.is_finite() { Ok(transform) } else { Err("the transform is not finite".to_owned()) }
}
