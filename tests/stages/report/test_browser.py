"""The page in a headless Chromium: it moves, and asks nobody for anything."""

import io

import matplotlib.image
import numpy as np
import pytest

from stages.report.stage import compute_report, report_page


@pytest.fixture(scope="module")
def file(arm, tmp_path_factory):
    result, sequence, robot, metrics, labels_true = arm
    frames = [sequence.to_input(frame) for frame in sequence.frames()]
    page = report_page("</script>arm", result, frames, compute_report(result, sequence), robot, metrics, labels_true)
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page)
    return path


@pytest.fixture
def page(browser, file):
    browser.open(file)
    yield browser
    complaints = [text for text in browser.complaints if "GPU stall due to ReadPixels" not in text]  # SwiftShader's
    assert complaints == []
    assert set(browser.requests) == {file.as_uri()}


def centroids(result, T):
    """The middle of each part's canonical points, moved."""
    p = result.canonical_points.astype(np.float64)
    middles = np.stack([p[result.labels == part].mean(axis=0) for part in range(len(result.model.parts))])
    return np.einsum("nij,nj->ni", T[:, :3, :3], middles) + T[:, :3, 3]


def pixels(browser):
    """What the window shows (height, width, 3), 0..1."""
    return matplotlib.image.imread(io.BytesIO(browser.screenshot()), format="png")[..., :3]


def test_the_model_is_drawn_in_the_colours_of_its_parts(page, arm):
    page.settle()
    with_axes = pixels(page)
    page.evaluate("document.getElementById('show-axes').click()")
    page.settle()
    shown = pixels(page)
    assert (np.abs(with_axes - shown).max(axis=-1) > 0.2).sum() > 300
    shown = shown.reshape(-1, 3)
    for part in page.evaluate("data.parts.map((part) => rgb(part.colour))"):
        direction = np.array(part) / np.linalg.norm(part)  # shading keeps it
        length = np.linalg.norm(shown, axis=1)
        alike = (shown @ direction > 0.9995 * length) & (length > 0.2)
        assert alike.sum() > 100


def test_every_frame_poses_the_parts_as_the_model_file_says(page, arm):
    result = arm[0]
    for frame in range(result.model.frames):
        page.evaluate(f"reart.setFrame({frame})")
        expected = centroids(result, result.T_frame_canonical[frame])
        np.testing.assert_allclose(page.evaluate("reart.centroids"), expected, atol=2e-3 * np.ptp(expected))


def test_a_slider_moves_its_part_and_what_hangs_on_it_and_nothing_else(page, arm):
    result = arm[0]
    before = np.array(page.evaluate("reart.centroids"))
    page.evaluate(
        "const slider = document.querySelector('input[data-joint=\"0\"]');"
        "slider.value = slider.max; slider.dispatchEvent(new Event('input'));"
    )
    after = np.array(page.evaluate("reart.centroids"))
    moved = np.linalg.norm(after - before, axis=1)
    assert (moved[[1, 2]] > 10).all()
    np.testing.assert_allclose(moved[[0, 3]], 0, atol=1e-9)
    hinge = result.model.joints[0]
    assert page.evaluate("document.querySelector('output').textContent") == f"{np.degrees(hinge.upper):.1f}°"
    assert page.evaluate("document.getElementById('frame-text').textContent") == "posed by hand"
    page.evaluate("document.getElementById('reset').click()")
    np.testing.assert_allclose(page.evaluate("reart.centroids"), before, atol=1e-9)


def test_the_arrow_keys_move_a_slider_that_has_the_focus(page):
    page.evaluate("document.querySelector('input[data-joint=\"1\"]').focus()")
    before = page.evaluate("reart.states[1]")
    page.press("ArrowRight")
    assert page.evaluate("reart.states[1]") > before


@pytest.mark.parametrize("beside_input", [False, True])
def test_playback_runs_through_the_frames_until_it_is_paused(page, arm, beside_input):
    if beside_input:
        page.evaluate("document.getElementById('show-input').click()")
    seen = page.evaluate(
        """new Promise((done) => {
          const seen = [];
          document.getElementById("play").click();
          const look = () => {
            seen.push([reart.frame, player.time]);
            if (seen.length < 400 && new Set(seen.map(([frame]) => frame)).size < 4) requestAnimationFrame(look);
            else { document.getElementById("play").click(); done(seen); }
          };
          look();
        })"""
    )
    assert {frame for frame, _ in seen} == set(range(arm[0].model.frames))
    assert any(time != round(time) for _, time in seen) != beside_input
    assert page.evaluate("reart.playing") is False
    assert page.evaluate("document.getElementById('play').getAttribute('aria-label')") == "Play the fitted sequence"


def test_mouse_wheel_and_keys_turn_and_zoom_the_view(page):
    def camera():
        return page.evaluate("[camera.azimuth, camera.elevation, camera.distance, ...camera.target]")

    start = camera()
    page.drag((300, 400), (360, 430))
    turned = camera()
    assert turned[0] < start[0]
    assert turned[1] > start[1]
    page.evaluate("canvas.focus()")
    page.press("+")
    assert camera()[2] < turned[2]
    page.press("0")
    assert camera() == start


def test_a_finger_turns_the_view_and_two_zoom_it(browser, file):
    def camera():
        return browser.evaluate("[camera.azimuth, camera.distance]")

    browser.open(file, width=390, height=844)
    start = camera()
    browser.touch("touchStart", (150, 350))
    browser.touch("touchMove", (200, 350))
    browser.touch("touchEnd")
    turned = camera()
    assert turned[0] < start[0]
    assert turned[1] == start[1]
    browser.touch("touchStart", (150, 350), (200, 350))
    browser.touch("touchMove", (100, 350), (250, 350))
    browser.touch("touchEnd")
    assert camera()[1] < 0.5 * start[1]
    assert camera()[0] == turned[0]


@pytest.mark.parametrize("mode", ["points", "meshes", "true"])
def test_what_is_shown_can_be_chosen(page, mode):
    page.evaluate(f"document.querySelector('input[value={mode}]').click()")
    page.settle()
    assert np.ptp(pixels(page), axis=-1).max() > 0.3


def test_a_phone_sized_window_needs_no_scrolling_sideways(browser, file):
    browser.open(file, width=390, height=844)
    browser.settle()
    assert browser.evaluate("document.documentElement.scrollWidth") == 390
    assert browser.evaluate("canvas.clientHeight") > 300


def test_dark_and_light_follow_the_system(browser, file):
    brightness = []
    for dark in (False, True):
        browser.open(file, dark=dark)
        browser.settle()
        brightness.append(pixels(browser).mean())
    assert brightness[0] > 0.6 > 0.4 > brightness[1]


def test_without_webgl_the_page_says_so_and_the_rest_works(browser, file):
    broken = "HTMLCanvasElement.prototype.getContext = () => null;"
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=broken)["identifier"]
    browser.open(file)
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
    assert browser.evaluate("document.getElementById('no-webgl').hidden") is False
    before = browser.evaluate("reart.centroids")
    browser.evaluate("reart.setFrame(3)")
    assert browser.evaluate("reart.centroids") != before
    assert browser.complaints == []
