"""Clouds against each other: registration of rigid groups, and the evidence for a motion."""
