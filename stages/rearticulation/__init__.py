"""Rearticulation: a fitted model brought to new poses (A.7)."""
