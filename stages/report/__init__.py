"""Report: one self-contained page of a fitted model."""

VERSION = 5  # raise it when the same input gives other results: what was made before is made anew
