"""Merging: parts that touch and move alike become one (A.3)."""

VERSION = 4  # raise it when the same input gives other results: what was made before is made anew
