"""The flow stage: correspondences between consecutive frames and the flow that they imply (A.1)."""

VERSION = 2  # raise it when the same input gives other results: what was made before is made anew
