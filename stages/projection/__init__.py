"""Projection: the relaxed model's parts linked to a kinematic tree of screw joints (Eq. 11, A.2)."""

VERSION = 5  # raise it when the same input gives other results: what was made before is made anew
