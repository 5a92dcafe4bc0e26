"""Ingest: files, or a dataset's own format, to a sequence of frames with scale and centre known."""

VERSION = 1  # raise it when the same input gives other results: what was made before is made anew
