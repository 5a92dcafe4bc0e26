"""Export: a fitted model as a robot description that simulators load."""

VERSION = 5  # raise it when the same input gives other results: what was made before is made anew
