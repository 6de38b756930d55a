//! Simulator of the gear bench: mesh stiffness, faults, dynamics, effects, sensors.
