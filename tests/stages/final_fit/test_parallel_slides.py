from dataclasses import replace

import numpy as np
import pytest

from schemas.config import FinalFitConfig
from stages.final_fit.parallel_slides import hang_slides

PRICE, ITERATIONS = FinalFitConfig().part_price, FinalFitConfig().iterations
CABINET = ([-0.3, -0.4, -0.3], [0.3, 0.2, 0.3])
ABOVE, BELOW = ([-0.29, -0.41, 0.02], [0.29, 0.15, 0.29]), ([-0.29, -0.41, -0.29], [0.29, 0.15, 0.01])
TELESCOPE = (
    ([-0.3, -0.4, -0.3], [0.3, 0.0, 0.3]),
    ([-0.2, -0.35, -0.2], [0.2, 0.5, 0.2]),
    ([-0.13, 0.1, -0.13], [0.13, 0.9, 0.13]),
)


def test_a_drawer_hangs_on_its_cabinet_and_not_on_the_drawer_beside_it(slides):
    cabinet = slides((CABINET, ABOVE, BELOW))
    hung = hang_slides(cabinet.fit, cabinet.frames, PRICE, ITERATIONS)
    np.testing.assert_array_equal(hung.chain.tree.parents, [-1, 0, 0])
    np.testing.assert_allclose(hung.chain.Ts, cabinet.chain.Ts, atol=0.02)


def test_it_does_so_where_it_touches_that_one_more_but_moves_less_against_the_cabinet(slides):
    apart = ([-0.05, -0.41, -0.29], [0.05, 0.15, 0.01])  # touches the cabinet's floor only, and the drawer above widely
    cabinet = slides((CABINET, ABOVE, apart))
    hung = hang_slides(cabinet.fit, cabinet.frames, PRICE, ITERATIONS)
    np.testing.assert_array_equal(hung.chain.tree.parents, [-1, 0, 0])


@pytest.mark.parametrize(("corners", "turn"), [(TELESCOPE, 0.0), ((CABINET, ABOVE, BELOW), 0.5)])
def test_a_telescope_and_slides_along_other_axes_stay(slides, corners, turn):
    thing = slides(corners, turn)
    assert hang_slides(thing.fit, thing.frames, PRICE, ITERATIONS) is thing.fit


def test_a_part_without_points_stays_where_it_is(slides):
    cabinet = slides((CABINET, ABOVE, BELOW))
    unseen = replace(cabinet.fit, labels=np.minimum(cabinet.labels, 1))
    assert hang_slides(unseen, cabinet.frames, PRICE, ITERATIONS) is unseen
