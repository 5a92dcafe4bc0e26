import numpy as np
import pytest

from schemas.config import ExportConfig
from schemas.errors import InputError
from stages.export.robot import compute_export

CONFIG = ExportConfig(triangles=400)


def changed(result, **fields):
    return result.replace(model=result.model.model_copy(update=fields))


def with_joint(result, **fields):
    return changed(result, joints=(result.model.joints[0].model_copy(update=fields),))


def test_limits_lie_a_margin_beyond_the_observed_range(hinge, fit_of):
    [joint] = compute_export(fit_of(hinge), None, CONFIG, "box").joints
    assert (joint.lower, joint.upper) == pytest.approx((-0.5 - 0.11, 0.6 + 0.11))


def test_a_joint_that_never_moved_still_has_a_range(hinge, fit_of):
    still = with_joint(fit_of(hinge), states=(0.0,) * 5, lower=0.0, upper=0.0)
    [joint] = compute_export(still, None, CONFIG, "box").joints
    assert joint.lower < 0 < joint.upper


def test_a_scan_in_millimetres_is_exported_in_metres(drawer, fit_of):
    result = fit_of(drawer)
    metres, millimetres = (
        compute_export(changed(result, units=units), None, CONFIG, "box") for units in ("metre", "millimetre")
    )
    assert millimetres.vertices == pytest.approx(metres.vertices / 1000, rel=1e-6, abs=1e-9)
    assert millimetres.joints[0].states == pytest.approx(np.divide(metres.joints[0].states, 1000))
    assert millimetres.links[0].mass == pytest.approx(metres.links[0].mass / 1e9, rel=1e-6)
    scaled = compute_export(
        changed(result, units="unknown"), None, ExportConfig(triangles=400, metres_per_unit=1e-3), "box"
    )
    assert scaled.vertices == pytest.approx(millimetres.vertices)


def test_a_box_weighs_what_its_volume_does_at_the_stated_density(hinge, fit_of):
    frames = [hinge.sequence.to_input(frame) for frame in hinge.sequence.frames()]
    robot = compute_export(fit_of(hinge), frames, ExportConfig(density=500.0), "box")
    body = 500.0 * np.prod([0.78, 0.8, 0.4])  # the body's box in metres
    assert robot.links[0].solid == "mesh"
    assert body < robot.links[0].mass < 1.35 * body
    assert robot.links[0].centre == pytest.approx([1 - 0.51, 0.0, -1.0], abs=0.05)


def test_a_moving_base_is_told_from_one_that_stands(hinge, fit_of):
    assert compute_export(fit_of(hinge, free=True), None, CONFIG, "box").free_base
    assert not compute_export(fit_of(hinge), None, CONFIG, "box").free_base


def test_a_part_without_points_is_a_light_link_without_meshes(hinge, fit_of):
    result = fit_of(hinge)
    robot = compute_export(result.replace(labels=np.zeros_like(result.labels)), None, CONFIG, "box")
    assert robot.links[1].solid == "none"
    assert robot.links[1].mass == pytest.approx(robot.links[0].mass / 1000)
    assert {mesh.link for mesh in robot.meshes} == {0}


def test_points_in_one_place_are_refused(hinge, fit_of):
    result = fit_of(hinge)
    with pytest.raises(InputError, match="canonical_points: found one place only"):
        compute_export(result.replace(canonical_points=np.ones_like(result.canonical_points)), None, CONFIG, "box")
