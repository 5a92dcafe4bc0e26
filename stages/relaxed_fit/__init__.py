"""The relaxed fit: parts on the canonical frame and a free rigid motion per part and frame (Eq. 5)."""

VERSION = 8  # raise it when the same input gives other results: what was made before is made anew
