import numpy as np

from stages.kernels.palette import part_colours


def test_colours_of_parts_differ():
    colours = part_colours(30)
    distances = np.linalg.norm(colours[:, None] - colours[None], axis=-1)
    assert distances[~np.eye(30, dtype=bool)].min() > 0.05
