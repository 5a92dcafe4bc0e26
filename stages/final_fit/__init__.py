"""The final fit: a tree of joints with one degree of freedom each, fitted to all frames, and labels to match (A.4)."""

VERSION = 13  # raise it when the same input gives other results: what was made before is made anew
