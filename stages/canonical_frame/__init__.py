"""Choice of the canonical frame among candidates: the lowest energy (A.5)."""

VERSION = 9  # raise it when the same input gives other results: what was made before is made anew
