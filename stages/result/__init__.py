"""The result: what model.json and model.npz say of a fitted model, in the input's units."""

VERSION = 3  # raise it when the same input gives other results: what was made before is made anew
