"""Trees of rigid parts and joints: their poses, the closed-form fit of a joint, and the fit of a whole tree."""
