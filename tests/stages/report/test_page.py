import base64
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from schemas.assessment import Spread, Verdict
from schemas.metrics import JointMetrics
from schemas.sequence import IngestedSequence
from stages.report import scene
from stages.report.drawings import heat_svg, tree_svg
from stages.report.scene import Scale, part_meshes
from stages.report.stage import compute_report, report_files, report_page

VOID = {"meta", "link", "input", "br", "img"}


class Page(HTMLParser):
    """A page's elements: attributes by tag, scripts by type, and the text outside of them."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.scripts, self.text = [], [], {}, []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            kind = self.elements[-1][1].get("type", "")
            self.scripts[kind] = self.scripts.get(kind, "") + data
        else:
            self.text.append(data)

    def all(self, tag, **attributes):
        return [a for t, a in self.elements if t == tag and attributes.items() <= a.items()]


@pytest.fixture
def page(arm):
    result, sequence, robot, metrics, labels_true = arm
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    return report_page("arm", result, frames, compute_report(result, sequence), robot, metrics, labels_true)


def scene_of(page):
    return json.loads(Page(page).scripts["application/json"])


def test_points_of_no_part_are_grey_among_the_true_parts(arm):
    result, sequence, robot, metrics, labels_true = arm
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    labels = np.where(np.arange(len(labels_true)) % 3 == 0, -1, labels_true)
    page = report_page("arm", result, frames, compute_report(result, sequence), robot, metrics, labels)
    colours = np.frombuffer(base64.b64decode(scene_of(page)["points"]["trueColours"]), np.uint8).reshape(-1, 3)
    assert (colours == 128).all(axis=1).sum() == (labels == -1).sum()


def test_the_page_is_one_file_that_names_no_address(page):
    parsed = Page(page)
    assert not re.search(r"https?:|//[a-z]|@import|url\(", re.sub(r"<script.*?</script>", "", page, flags=re.S))
    assert not re.search(r"https?:|import\s*\(|fetch|XMLHttpRequest", parsed.scripts[""])
    assert [a["href"] for a in parsed.all("link")] == ["data:,"]
    assert parsed.all("img") == []


def test_nothing_else_than_the_pages_own_script_may_run(page):
    [policy] = Page(page).all("meta", **{"http-equiv": "Content-Security-Policy"})
    assert policy["content"].startswith("default-src 'none'")
    assert re.search(r"script-src 'sha256-[A-Za-z0-9+/]{43}='$", policy["content"])


@pytest.mark.parametrize("name", ["</script><script>alert(1)</script>", '"><img src=x onerror=alert()>', "$name &amp;"])
def test_no_name_is_taken_for_markup(arm, name):
    result, sequence, robot, metrics, labels_true = arm
    joint = result.model.joints[0].model_copy(update={"name": name})
    part = result.model.parts[0].model_copy(update={"name": name})
    changes = {"joints": (joint, *result.model.joints[1:]), "parts": (part, *result.model.parts[1:])}
    result = result.replace(model=result.model.model_copy(update=changes))
    metrics = metrics.replace(joints=(JointMetrics(name=name, true_type="revolute", predicted_type=None),))
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    page = Page(report_page(name, result, frames, compute_report(result, sequence), robot, metrics, labels_true))
    assert len(page.all("script")) == 2
    assert page.all("img") == []
    assert sum(name in text for text in page.text) >= 5


def test_every_joint_has_a_labelled_slider_within_its_limits_and_a_ball_joint_has_three(page, arm):
    model = arm[0].model
    parsed = Page(page)
    for joint in model.joints:
        fields = parsed.all("input", **{"data-joint": str(joint.id)})
        assert all(joint.name in field["aria-label"] for field in fields)
        if joint.type == "spherical":
            assert len(fields) == 3
        else:
            [field] = fields
            assert (float(field["min"]), float(field["max"])) == (joint.lower, joint.upper)


def test_points_and_frames_are_where_they_were(page, arm):
    result, sequence, *_ = arm
    scene = scene_of(page)

    def decoded(text):
        q = np.frombuffer(base64.b64decode(text), dtype="<i2").reshape(-1, 3)
        return scene["centre"] + q / 32767 * scene["half"]

    precision = scene["half"] / 32767
    p = decoded(scene["points"]["positions"])
    by_part = result.canonical_points[np.argsort(result.labels, kind="stable")]
    np.testing.assert_allclose(p, by_part, atol=precision)
    assert scene["points"]["ends"] == np.cumsum([part.point_count for part in result.model.parts]).tolist()
    for shown, frame in zip(scene["frames"], sequence.frames(), strict=True):
        np.testing.assert_allclose(decoded(shown), sequence.to_input(frame), atol=precision)


def test_meshes_are_where_the_points_are(arm):
    result, _, robot, *_ = arm
    for part, mesh in enumerate(part_meshes(robot)):
        p = result.canonical_points[result.labels == part]
        np.testing.assert_allclose(mesh.vertices.mean(axis=0), p.mean(axis=0), atol=0.2 * np.ptp(p))


def test_the_page_stays_small_however_many_points_and_triangles_there_are(arm, monkeypatch):
    result, _, robot, metrics, _ = arm
    many = np.random.default_rng(0).normal(size=(60_000, 3))
    result = result.replace(
        canonical_points=np.tile(result.canonical_points, (100, 1)), labels=np.tile(result.labels, 100)
    )
    monkeypatch.setattr(scene, "MOST_TRIANGLES", 400)
    frames = [many] * result.model.frames
    report = compute_report(result, arm[1])
    assert sum(len(mesh.triangles) for mesh in part_meshes(robot)) < 700
    assert len(report_page("many", result, frames, report, robot, metrics)) < 1_500_000


def test_a_model_without_robot_truth_motion_or_joints_has_a_page(samples):
    result = samples["result"]
    still = result.model.model_copy(update={"joints": (), "parts": result.model.parts[:1]})
    result = result.replace(
        model=still, labels=np.zeros(4, dtype=np.int64), T_frame_canonical=result.T_frame_canonical[:, :1]
    )
    report = samples["report"].replace(residuals=np.zeros((3, 1)), sampling=0.0)
    page = Page(report_page("still", result, [np.ones((3, 3))] * 3, report))
    assert [field["value"] for field in page.all("input", name="mode")] == ["points"]
    assert "Against the truth" not in page.text
    assert "One rigid part: nothing to move." in page.text


def test_what_the_user_should_know_is_told(arm):
    result, sequence, robot, *_ = arm
    robot = robot.replace(remarks=("nothing moved <at all>",))
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    page = Page(report_page("arm", result, frames, compute_report(result, sequence), robot))
    assert "nothing moved <at all>" in page.text


def test_the_verdict_and_the_spreads_are_told(arm):
    result, sequence, robot, *_ = arm
    first, *others = result.model.joints
    spread = Spread(direction=np.radians(0.314), place=2.17)
    told = {
        "joints": (first.model_copy(update={"spread": spread}), *others),
        "verdict": Verdict(trust="doubtful", reasons=("<b>the first</b>", "the second")),
    }
    result = result.replace(model=result.model.model_copy(update=told))
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    page = Page(report_page("arm", result, frames, compute_report(result, sequence), robot))
    assert page.all("div", **{"class": "verdict doubtful"})
    assert {"trust: doubtful", "<b>the first</b>", "the second", "± 0.31°", "± 2.2 mm"} <= set(page.text)


def test_a_page_of_an_older_model_has_no_verdict(page):
    parsed = Page(page)
    assert not [a for a in parsed.all("div") if "verdict" in a.get("class", "")]
    assert "±" not in "".join(parsed.text)


def test_the_truth_is_told_where_there_is_one(page):
    text = " ".join(Page(page).text)
    assert "Against the truth" in text
    assert "0.900" in text
    assert "not found" in text


def test_the_tree_is_drawn_with_a_node_for_each_part_and_told_in_words(arm):
    drawing = Page(tree_svg(arm[0].model))
    assert len(drawing.all("circle", **{"class": "node"})) == 4
    [svg] = drawing.all("svg")
    assert svg["aria-label"].startswith("Kinematic tree: root 0; 0 to 1 revolute")


def test_misfit_stands_out_from_noise():
    residuals = np.array([[0.0, 0.0], [0.5, 0.5], [0.5, 2.0]])
    cells = Page(heat_svg(residuals, 0, 0.5, ["a", "b"])).all("rect", **{"class": "cell"})
    depth = np.array([float(cell["fill-opacity"]) for cell in cells]).reshape(2, 3)
    assert depth[1, 2] == 1
    assert (depth[:, 0] == 0).all()
    assert (depth[0, 1:] < 0.2).all()


def test_one_point_is_a_scene():
    scale = Scale([np.ones((1, 3))])
    assert (scale.half, scale.centre.tolist()) == (1.0, [1, 1, 1])


def test_the_same_model_gives_the_same_files(arm):
    result, sequence, robot, metrics, _ = arm
    ingested, report = IngestedSequence(sequence=sequence), compute_report(result, sequence)
    first, again = (report_files("arm", result, ingested, report, robot, metrics) for _ in range(2))
    assert first == again
    assert first.keys() == {"report.html", "report.png"}
    assert first["report.png"].startswith(b"\x89PNG")
