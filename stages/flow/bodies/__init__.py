"""Motions between frames that are far apart: rigid bodies are found one after the other, over all frames at once."""
