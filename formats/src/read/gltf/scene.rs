//! What stands in the scene: every node with a mesh, and its transform into the coordinates of the scene.

use super::super::ReadError;
use super::Context;
use super::schema::Root;
use super::transform::Transform;
use crate::Diagnostics;

/// A mesh where it stands.
pub(super) struct Placed {
    pub(super) mesh: usize,
    pub(super) transform: Transform,
}

/// All meshes of the default scene; of all scenes where none is the default; of the nodes without a parent where there
/// is no scene; each mesh once as it stands where there is no node.
pub(super) fn placed(
    root: &Root,
    diagnostics: &mut Diagnostics,
    context: &Context<'_>,
) -> Result<Vec<Placed>, ReadError> {
    if root.nodes.is_empty() {
        if !root.meshes.is_empty() {
            diagnostics.add_many("meshes that stand in no scene taken as they are", root.meshes.len() as u64);
        }
        return Ok((0..root.meshes.len()).map(|mesh| Placed { mesh, transform: Transform::IDENTITY }).collect());
    }
    let roots = roots(root, diagnostics, context)?;
    let mut visited = vec![false; root.nodes.len()];
    let mut placed = Vec::new();
    // For each level of the tree the nodes that are left, and where they stand: no transform for each that waits.
    let mut open = vec![(roots.iter(), Transform::IDENTITY)];
    while let Some((left, parent)) = open.last_mut() {
        let Some(&index) = left.next() else {
            open.pop();
            continue;
        };
        let Some(node) = root.nodes.get(index) else {
            let found = format!("nodes[{index}], but there are {}", root.nodes.len());
            return Err(context.part("scenes or nodes".to_owned(), found, "a node of this file"));
        };
        if std::mem::replace(&mut visited[index], true) {
            let found = "that it is reached twice: it has two parents, or is its own ancestor".to_owned();
            return Err(context.part(format!("nodes[{index}]"), found, "a tree of nodes; export the file again"));
        }
        let transform = parent.after(&Transform::of_node(node));
        if !node.children.is_empty() {
            open.push((node.children.iter(), transform));
        }
        let Some(mesh) = node.mesh else { continue };
        if mesh >= root.meshes.len() {
            let found = format!("meshes[{mesh}], but there are {}", root.meshes.len());
            return Err(context.part(format!("nodes[{index}]"), found, "a mesh of this file"));
        }
        if node.skin.is_some() {
            diagnostics.add("meshes with a skin taken as they stand", || format!("nodes[{index}]"));
        }
        if node.extensions.instancing.is_some() {
            let kind = "nodes with many instances (EXT_mesh_gpu_instancing), of which one is taken";
            diagnostics.add(kind, || format!("nodes[{index}]"));
        }
        placed.push(Placed { mesh, transform });
    }
    Ok(placed)
}

fn roots(root: &Root, diagnostics: &mut Diagnostics, context: &Context<'_>) -> Result<Vec<usize>, ReadError> {
    if let Some(index) = root.scene {
        let Some(scene) = root.scenes.get(index) else {
            let found = format!("scenes[{index}] as the default, but there are {}", root.scenes.len());
            return Err(context.part("scene".to_owned(), found, "a scene of this file"));
        };
        let others = root.scenes.len() as u64 - 1;
        diagnostics.add_many("scenes beside the default one left out", others);
        return Ok(scene.nodes.clone());
    }
    if root.scenes.is_empty() {
        let mut has_parent = vec![false; root.nodes.len()];
        for child in root.nodes.iter().flat_map(|node| &node.children) {
            if let Some(flag) = has_parent.get_mut(*child) {
                *flag = true;
            }
        }
        let roots: Vec<usize> = (0..root.nodes.len()).filter(|&i| !has_parent[i]).collect();
        diagnostics.add_many("nodes without a parent taken, because there is no scene", roots.len() as u64);
        if roots.is_empty() {
            let found = "that every node has a parent".to_owned();
            return Err(context.part("nodes".to_owned(), found, "a tree of nodes; export the file again"));
        }
        return Ok(roots);
    }
    if root.scenes.len() > 1 {
        diagnostics.add_many("scenes taken together, because none is the default", root.scenes.len() as u64);
    }
    let mut seen = vec![false; root.nodes.len()];
    let mut roots: Vec<usize> = root.scenes.iter().flat_map(|scene| scene.nodes.iter().copied()).collect();
    roots.retain(|&i| seen.get_mut(i).is_none_or(|flag| !std::mem::replace(flag, true)));
    Ok(roots)
}
