"""Rigid motions: transforms, and the motions of groups of points."""
