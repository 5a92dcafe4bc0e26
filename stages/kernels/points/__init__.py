"""Clouds of points: neighbours, sampling, scale and precision."""
