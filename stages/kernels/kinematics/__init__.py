"""Trees of rigid parts and joints: their motions, joints in closed form, and the fit of a whole tree."""
