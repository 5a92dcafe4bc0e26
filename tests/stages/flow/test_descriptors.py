import numpy as np
from scipy.spatial.transform import Rotation

from schemas.config import FlowConfig
from stages.flow.descriptors import SHARPNESS, fpfh
from stages.flow.stage import compute_flow


def test_descriptors_have_one_length_and_do_not_turn_with_the_cloud(hinge):
    points = hinge.sequence.frames()[0]
    turned = points @ Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix().T + [1.0, -2.0, 0.5]
    features, again = (fpfh(p, FlowConfig()) / SHARPNESS**0.5 for p in (points, turned))
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1)
    assert np.median(np.linalg.norm(again - features, axis=1)) < 0.05


def test_the_estimator_fpfh_says_where_matched_points_went(hinge):
    flow = compute_flow(hinge.sequence, FlowConfig(estimator="fpfh"), np.random.default_rng(0))
    frames = hinge.sequence.frames()
    assert flow.match_counts.sum() > 20
    for pair in flow.pairs():
        source, target = frames[pair.source_frame], frames[pair.target_frame]
        np.testing.assert_allclose(source[pair.source_index] + pair.flow, target[pair.target_index])
        assert ((pair.confidence >= 0) & (pair.confidence <= 1)).all()
