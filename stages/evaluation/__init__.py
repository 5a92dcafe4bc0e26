"""Evaluation: the yardsticks of A.9, measured on the canonical frame's points."""

VERSION = 6  # raise it when the same input gives other results: what was made before is made anew
