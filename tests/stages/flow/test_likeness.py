import numpy as np

from stages.flow.likeness import matching_paths


def moving_cloud(steps):
    """A cloud, part of which goes along a line, in the states given."""
    p = np.random.default_rng(0).uniform(size=(300, 3))
    frames = []
    for step in steps:
        frame = p.copy()
        frame[:100, 0] += 0.2 * step
        frames.append(frame)
    return frames


def test_shuffled_frames_are_matched_along_the_motion():
    order = [3, 0, 5, 1, 4, 2]
    (path,) = matching_paths(moving_cloud(order))
    assert [order[t] for t in path] in ([0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0])


def test_frames_in_order_and_many_frames_stay_in_order():
    assert matching_paths(moving_cloud(range(6))) == [list(range(6))]
    shuffled = np.random.default_rng(1).permutation(60)
    assert matching_paths(moving_cloud(shuffled)) == [list(range(60))]


def test_every_frame_is_reached_once_where_motions_part():
    """Two motions from one state: their frames form a star with two arms, of which no single path sees all."""
    frames = [*moving_cloud([3, 2, 1, 0])]
    for step in (1, 2, 3):
        frame = frames[3].copy()
        frame[100:200, 1] -= 0.2 * step
        frames.append(frame)
    for step in (1, 2):
        frame = frames[3].copy()
        frame[200:, 2] += 0.2 * step
        frames.append(frame)
    paths = matching_paths([frames[k] for k in (0, 3, 6, 1, 4, 7, 2, 5, 8)])
    covered = list(paths[0])
    for path in paths[1:]:
        assert path[0] in covered
        covered += path[1:]
    assert sorted(covered) == list(range(9))
    assert len(paths) > 1
