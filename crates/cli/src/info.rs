use anyhow::Result;
use pliant::{Model, ReadReport, count};
use serde::Serialize;

use crate::args::InfoOptions;
use crate::console::{Console, print_json};

/// What there is to say of a mesh.
#[derive(Serialize)]
struct Info {
    model: String,
    vertices: usize,
    faces: usize,
    edges: usize,
    components: usize,
    euler_characteristic: i64,
    /// Genus, summed over components; only where it is defined: manifold, closed, no unused vertex.
    genus: Option<i64>,
    closed: bool,
    boundary_edges: usize,
    boundary_loops: usize,
    manifold: bool,
    /// The first place where it is not, in words.
    not_manifold: Option<String>,
    non_manifold_edges: usize,
    consistently_oriented: bool,
    size: [f64; 3],
    diagonal: f64,
    /// In cubed units of the model; of a closed mesh only.
    signed_volume: Option<f64>,
    file: Option<ReadReport>,
    notes: Vec<String>,
}

pub(crate) fn run(options: &InfoOptions) -> Result<()> {
    let console = Console::new(options.json);
    let model = Model::open(&options.model, &console)?;
    let info = Info::of(&model);
    if options.json {
        return print_json(&info);
    }
    info.print(&console)
}

impl Info {
    fn of(model: &Model) -> Self {
        let (mesh, topology) = (&model.mesh, model.mesh.topology());
        let unused = (0..mesh.vertex_count()).filter(|&v| topology.vertex_faces(v).is_empty()).count();
        let components = topology.components().1 - unused;
        let manifold = topology.require_manifold();
        let closed = topology.is_closed();
        let euler_characteristic = topology.euler_characteristic();
        Self {
            model: model.name.clone(),
            vertices: mesh.vertex_count(),
            faces: mesh.face_count(),
            edges: topology.edges().len(),
            components,
            euler_characteristic,
            genus: (manifold.is_ok() && closed).then(|| components as i64 - euler_characteristic / 2),
            closed,
            boundary_edges: topology.boundary_edge_count(),
            boundary_loops: topology.boundary_loops().len(),
            manifold: manifold.is_ok(),
            not_manifold: manifold.err().map(|e| e.to_string()),
            non_manifold_edges: topology.non_manifold_edge_count(),
            consistently_oriented: topology.require_oriented().is_ok(),
            size: mesh.bounds().size().to_array(),
            diagonal: mesh.bounds().diagonal(),
            signed_volume: closed.then(|| mesh.signed_volume()),
            file: model.file.clone(),
            notes: model.notes(),
        }
    }

    fn print(&self, console: &Console) -> Result<()> {
        console.say(&self.model)?;
        console.say(&format!(
            "  {} vertices, {} faces, {} edges, {} component{}",
            count(self.vertices),
            count(self.faces),
            count(self.edges),
            count(self.components),
            if self.components == 1 { "" } else { "s" },
        ))?;
        let [x, y, z] = self.size;
        console.say(&format!("  size {x:.6} x {y:.6} x {z:.6}, diagonal {:.6} (units of the file)", self.diagonal))?;
        let surface = if self.closed {
            "closed".to_owned()
        } else {
            format!("open: {} boundary edges in {} loops", count(self.boundary_edges), count(self.boundary_loops))
        };
        let genus = self.genus.map_or(String::new(), |g| format!(", genus {g}"));
        console.say(&format!("  {surface}; Euler characteristic {}{genus}", self.euler_characteristic))?;
        match &self.not_manifold {
            None => console.say("  manifold")?,
            Some(why) if self.non_manifold_edges > 0 => {
                console.say(&format!("  {why} ({} such edges)", count(self.non_manifold_edges)))?;
            }
            Some(why) => console.say(&format!("  {why}"))?,
        }
        if !self.consistently_oriented {
            console.say("  faces are not consistently oriented")?;
        }
        if let Some(volume) = self.signed_volume {
            let inside_out = if volume < 0.0 { " (negative: the faces look inward)" } else { "" };
            console.say(&format!("  volume {volume:.6e} cubed units{inside_out}"))?;
        }
        for note in &self.notes {
            console.say(&format!("  note: {note}"))?;
        }
        Ok(())
    }
}
