"""Assessment: how exactly a model's joints are known, and how far the model can be trusted."""

VERSION = 3  # raise it when the same input gives other results: what was made before is made anew
