//! The mesh of a stage of a bench, whatever its teeth.

use gearwatch_core::bench::Bench;

use super::iso_stiffness_n_per_m;
use super::{Face, FlankStore, HelicalMesh, LoadPoint, MeshError, MeshModel, MeshOptions, MeshState};
use crate::faults::ToothModifications;
use crate::meshes::{MeshKind, MeshPlace};

/// A gear pair of a bench: its section, and for helical teeth the slices along its face.
#[derive(Clone, Debug)]
pub struct StageMesh {
    section: MeshModel,
    face: Option<Box<Face>>,
    /// Helix angle and normal pressure angle (rad).
    helix_rad: f64,
    normal_angle_rad: f64,
}

impl StageMesh {
    /// The pair of stage `stage` (from 0) of a bench.
    ///
    /// # Errors
    /// For a stage that cannot be, in a sentence that says what would be right.
    pub fn new(
        bench: &Bench,
        stage: usize,
        options: &MeshOptions,
        teeth: &ToothModifications,
        flanks: &mut FlankStore,
    ) -> Result<Self, MeshError> {
        Self::of_mesh(bench, MeshPlace { stage, kind: MeshKind::Chain { from: 0 } }, options, teeth, flanks)
    }

    /// A mesh of a bench.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_mesh(
        bench: &Bench,
        place: MeshPlace,
        options: &MeshOptions,
        teeth: &ToothModifications,
        flanks: &mut FlankStore,
    ) -> Result<Self, MeshError> {
        let stage = place.stage;
        let Some(spec) = bench.stages.get(stage) else { return Err(MeshError::no_stage(bench, stage)) };
        let (section, face) = if spec.gearing.helix.is_some() {
            let (section, face) = HelicalMesh::of_stage(bench, stage, options, teeth, flanks)?.into_parts();
            (section, Some(Box::new(face)))
        } else {
            (MeshModel::of_mesh(bench, place, options, teeth, flanks)?, None)
        };
        let normal_angle_rad = spec.pressure_angle_deg.to_radians();
        Ok(Self { section, face, helix_rad: spec.helix_rad(), normal_angle_rad })
    }

    /// The section: of spur gears all of the pair, of helical ones the transverse section.
    #[inline(always)]
    pub fn section(&self) -> &MeshModel {
        &self.section
    }

    /// The slices of helical teeth.
    #[inline(always)]
    pub fn face(&self) -> Option<&Face> {
        self.face.as_deref()
    }

    /// What the compliances take from a mesh force along the transverse line of action (N).
    pub fn at_load(&self, load_n: f64) -> LoadPoint {
        match &self.face {
            None => self.section.at_load(load_n),
            Some(face) => face.at_load(&self.section, load_n),
        }
    }

    /// Static approach (m) under the load at a phase, the static transmission error, and the
    /// tangent stiffness (N/m) there. Infinite approach and no stiffness where no pair can touch.
    pub fn static_point(&self, phase: f64, load: &LoadPoint) -> (f64, f64) {
        match &self.face {
            None => self.section.static_point(phase, load),
            Some(face) => {
                let state = MeshState { phase, displacement_m: [0.0; 2] };
                face.static_point(&self.section, &state, load, load.load_n).unwrap_or((f64::INFINITY, 0.0))
            }
        }
    }

    /// Mean mesh stiffness c_γ b by ISO 6336-1, method B (N/m), at a mesh force (N).
    pub fn iso_stiffness_n_per_m(&self, load_n: f64) -> f64 {
        iso_stiffness_n_per_m(&self.section, self.helix_rad, self.normal_angle_rad, load_n)
    }
}

impl From<MeshModel> for StageMesh {
    fn from(section: MeshModel) -> Self {
        let normal_angle_rad = section.geometry().pinion.pressure_angle_rad;
        Self { section, face: None, helix_rad: 0.0, normal_angle_rad }
    }
}
