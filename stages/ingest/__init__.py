"""Ingest: convert files or a data set to a normalised sequence of frames with known scale and centre."""

VERSION = 2  # raise it when the same input gives other results: what was made before is made anew
