"""Surfaces: graphs over sampled ones, and meshes."""
