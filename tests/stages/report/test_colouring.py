"""The page shows the parts' colours, or those of the scans where they have some."""

import base64
import io
import json

import matplotlib.image
import numpy as np
import pytest

from schemas.config import ExportConfig
from stages.export.stage import compute_export
from stages.report.scene import scene_data
from stages.report.stage import compute_report, report_page

ORANGE, TEAL = (255, 128, 0), (0, 128, 128)


@pytest.fixture(scope="module")
def painted(arm):
    """The arm, orange below and teal above, whatever the part; with coloured meshes."""
    result, sequence, *_ = arm
    p = result.canonical_points
    colours = np.where(p[:, 2:] < np.median(p[:, 2]), ORANGE, TEAL).astype(np.uint8)
    joints = tuple(
        joint.model_copy(update={"type": "revolute", "states": (0.0,) * 4, "lower": 0.0, "upper": 0.0})
        for joint in result.model.joints
    )
    simple = result.replace(model=result.model.model_copy(update={"joints": joints}), colours=colours)
    robot = compute_export(simple, None, ExportConfig(triangles=200), "arm")
    return result.replace(colours=colours), sequence, robot


def written(painted, path):
    result, sequence, robot = painted
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    path.write_text(report_page("arm", result, frames, compute_report(result, sequence), robot))
    return path


def test_points_and_meshes_have_the_scans_colours_in_the_pages_data(painted):
    result, sequence, robot = painted
    data = scene_data(result, [sequence.to_input(frame) for frame in sequence.frames()], robot)
    order = np.argsort(result.labels, kind="stable")
    found = np.frombuffer(base64.b64decode(data["points"]["scanColours"]), dtype=np.uint8).reshape(-1, 3)
    np.testing.assert_array_equal(found, result.colours[order])
    found = np.frombuffer(base64.b64decode(data["meshes"]["scanColours"]), dtype=np.uint8).reshape(-1, 3)
    assert len(found) == data["meshes"]["vertexEnds"][-1]
    np.testing.assert_array_equal(found, robot.colours)  # in the order of the parts, and not decimated


def test_without_colours_nothing_is_offered(arm):
    result, sequence, robot, *_ = arm
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    page = report_page("arm", result, frames, compute_report(result, sequence), robot)
    assert 'name="colouring"' not in page
    data = json.loads(page.split('id="data">')[1].split("</script>")[0])
    assert data["points"]["scanColours"] is None
    assert data["meshes"]["scanColours"] is None


@pytest.mark.parametrize("mode", ["points", "meshes"])
def test_the_view_is_coloured_by_scan_on_demand_and_by_part_again(browser, painted, tmp_path, mode):
    browser.open(written(painted, tmp_path / "report.html"))
    browser.evaluate("document.getElementById('show-axes').click()")
    browser.evaluate(f"document.querySelector('input[value={mode}]').click()")
    counts = {}
    for colouring in ("part", "scan"):
        browser.evaluate(f"document.querySelector('input[name=colouring][value={colouring}]').click()")
        browser.settle()
        shown = matplotlib.image.imread(io.BytesIO(browser.screenshot()), format="png")[..., :3].reshape(-1, 3)
        counts[colouring] = [alike(shown, np.array(colour) / 255) for colour in (ORANGE, TEAL)]
        parts = browser.evaluate("data.parts.map((part) => rgb(part.colour))")
        counts[colouring].append(min(alike(shown, np.array(part)) for part in parts))
    assert min(counts["scan"][:2]) > 300
    assert max(counts["part"][:2]) < min(counts["scan"][:2]) / 4
    assert counts["part"][2] > 100
    assert [text for text in browser.complaints if "GPU stall" not in text] == []


def alike(shown, colour):
    """The number of pixels of a colour, however shaded."""
    length = np.linalg.norm(shown, axis=1)
    direction = colour / np.linalg.norm(colour)
    return int(((shown @ direction > 0.9995 * length) & (length > 0.2)).sum())
