//! Why a train cannot be simulated.

use crate::mesh::MeshError;
use crate::modal::ModalError;

/// A bench that cannot be simulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A gear pair that cannot be.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The linear train has no separate modes.
    #[error(transparent)]
    Modal(#[from] ModalError),
    /// Something else, in a sentence that says what would be right.
    #[error("{0}")]
    Bench(String),
}
