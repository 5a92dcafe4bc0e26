"""An arm with every type of joint, and a headless Chromium, driven by its DevTools protocol over a pipe."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.config import ExportConfig
from schemas.metrics import JointMetrics, Metrics
from schemas.model_file import JointConfidence, ModelFile, ModelJoint, ModelPart, Result
from schemas.robot import Robot
from schemas.sequence import PointSequence
from stages.export.stage import compute_export

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
SWITCHES = (
    "--headless",
    "--no-sandbox",  # started as root, it has none
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--disable-extensions",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--force-color-profile=srgb",
    "--remote-debugging-pipe",
)
LOADED = "new Promise((done) => document.readyState === 'complete' ? done() : addEventListener('load', done))"
COMPLAINTS = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")


class Browser:
    """One page at a time. `complaints` are what its console said, `requests` the addresses that it asked for."""

    def __init__(self, process: subprocess.Popen[bytes], commands: int, answers: int) -> None:
        self.process = process
        self._commands = commands
        self._answers = os.fdopen(answers, "rb")
        self._rest = b""
        self._number = 0
        self._session: str | None = None
        self.complaints: list[str] = []
        self.requests: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command, and its answer; events that come before it are noted."""
        self._number += 1
        command = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            command["sessionId"] = self._session
        os.write(self._commands, json.dumps(command).encode() + b"\0")
        while (message := self._read()).get("id") != self._number:
            self._note(message)
        assert "error" not in message, f"{method}: {message['error']}"
        return message["result"]

    def open(self, page: Path, width: int = 1400, height: int = 900, dark: bool = False) -> None:
        """Load a file in a window of a size."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.complaints.clear()
        self.requests.clear()
        self.call("Page.navigate", url=page.resolve().as_uri())
        self.evaluate(LOADED)

    def evaluate(self, expression: str) -> Any:
        """The value of an expression on the page, awaited where it is a promise."""
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def settle(self) -> None:
        """Wait until what was asked for is drawn."""
        self.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def screenshot(self, path: Path | None = None, whole: bool = False) -> bytes:
        """The window, or the whole page, as PNG."""
        picture = self.call("Page.captureScreenshot", captureBeyondViewport=whole)["data"]
        content = base64.b64decode(picture)
        if path is not None:
            path.write_bytes(content)
        return content

    def press(self, key: str) -> None:
        """A key on whatever has the focus."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, text=key if len(key) == 1 else "")

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """The mouse, its left button held."""
        for kind, (x, y) in (("mousePressed", start), ("mouseMoved", end), ("mouseReleased", end)):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def touch(self, kind: str, *fingers: tuple[float, float]) -> None:
        """touchStart, touchMove or touchEnd with the fingers that are down."""
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(fingers)]
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            piece = self._answers.read1(1 << 20)
            assert piece, f"the browser ended: {self.process.poll()}"
            self._rest += piece
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def _note(self, message: dict[str, Any]) -> None:
        if message.get("method") in COMPLAINTS:
            self.complaints.append(json.dumps(message["params"])[:2000])
        elif message.get("method") == "Network.requestWillBeSent":
            self.requests.append(message["params"]["request"]["url"][:200])


def find_browser() -> str | None:
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@contextlib.contextmanager
def running_browser(profile: Path) -> Iterator[Browser]:
    """A browser with a profile of its own, ended with whoever asked for it."""
    program = find_browser()
    if program is None:
        raise FileNotFoundError("no Chromium; `make browser` installs one")
    theirs, commands = os.pipe()
    answers, ours = os.pipe()

    def connect() -> None:  # Chromium reads from descriptor 3 and writes to 4
        reading, writing = os.dup(theirs), os.dup(ours)
        os.dup2(reading, 3)
        os.dup2(writing, 4)

    process = subprocess.Popen(
        [program, *SWITCHES, f"--user-data-dir={profile}", "about:blank"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        close_fds=False,
        preexec_fn=connect,
        start_new_session=True,
    )
    os.close(theirs)
    os.close(ours)
    try:
        yield Browser(process, commands, answers)
    finally:
        process.terminate()
        process.wait(timeout=30)
        os.close(commands)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if find_browser() is None:
        missing = "no Chromium on this machine; `make browser` installs one"
        if os.environ.get("REQUIRE_BROWSER"):
            pytest.fail(missing)
        pytest.skip(missing)
    with running_browser(tmp_path_factory.mktemp("browser")) as started:
        yield started


@pytest.fixture(params=["node", "chromium"])
def run_script(request: pytest.FixtureRequest) -> Callable[[str], Any]:
    """Runs the body of a JavaScript function, and gives what it returns."""
    if request.param == "chromium":
        browser = request.getfixturevalue("browser")
        return lambda body: browser.evaluate(f"(() => {{{body}}})()")
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on this machine; Chromium runs the same script")

    def run(body: str) -> Any:
        script = f"process.stdout.write(JSON.stringify((() => {{{body}}})()))"
        return json.loads(subprocess.run([node, "-"], input=script.encode(), capture_output=True, check=True).stdout)

    return run


Arm = tuple[Result, PointSequence, Robot, Metrics, np.ndarray]


@pytest.fixture(scope="session")
def arm() -> Arm:
    """A base that moves (part 0), a hinged arm (1) with a slider (2), and a ball joint (3); millimetres, 4 frames."""
    rng = np.random.default_rng(0)
    boxes = [
        ((0, 0, 0), (60, 60, 30)),
        ((0, 0, 50), (20, 20, 60)),
        ((0, 0, 110), (12, 12, 50)),
        ((60, 0, 10), (50, 16, 16)),
    ]
    labels = np.repeat(np.arange(4), 150)
    far = np.array([1000.0, -500.0, 200.0])
    p = np.concatenate([np.array(middle) + (rng.uniform(size=(150, 3)) - 0.5) * size for middle, size in boxes]) + far
    pivots = [far + [0, 0, 20], far + [0, 0, 80], far + [35, 0, 10]]
    hinge, slide = (-0.4, 0.0, 0.3, 0.7), (0.0, 0.0, 10.0, 20.0)
    ball = ((0.1, 0.2, -0.3), (0.0, 0.0, 0.0), (0.0, 0.5, 0.0), (0.4, 0.0, 0.1))
    Ts = np.tile(np.eye(4), (4, 4, 1, 1))
    for t in range(4):
        base = about(np.array([0, 0, 0.1 * (t - 1)]), far)
        base[:3, 3] += [5.0 * (t - 1), 0, 0]
        sliding = np.eye(4)
        sliding[2, 3] = slide[t]
        Ts[t, 0] = base
        Ts[t, 1] = base @ about(np.array([0, hinge[t], 0]), pivots[0])
        Ts[t, 2] = Ts[t, 1] @ sliding
        Ts[t, 3] = base @ about(np.array(ball[t]), pivots[2])
    axes = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    kinds: list[tuple[int, int, str, Any]] = [
        (0, 1, "revolute", hinge),
        (1, 2, "prismatic", slide),
        (0, 3, "spherical", ball),
    ]
    joints = tuple(
        ModelJoint(
            id=j,
            name=f"joint_{parent}_{child}",
            parent=parent,
            child=child,
            type=kind,
            axis=axes[j],
            point=tuple(pivots[j]),
            lower=min(states) if kind != "spherical" else 0.0,
            upper=max(states) if kind != "spherical" else 0.5,
            confidence=JointConfidence(part=1, link=0.5, type=0.25),
            states=states,
        )
        for j, (parent, child, kind, states) in enumerate(kinds)
    )
    parts = tuple(ModelPart(id=i, name=f"part_{i}", point_count=150) for i in range(4))
    model = ModelFile(units="millimetre", frames=4, canonical_frame=1, root=0, parts=parts, joints=joints)
    result = Result(model=model, canonical_points=p.astype(np.float32), labels=labels, T_frame_canonical=Ts)
    posed = (Ts[:, labels, :3, :3] @ p[:, :, None])[..., 0] + Ts[:, labels][..., :3, 3]
    sequence = PointSequence(
        points=(posed.reshape(-1, 3) - far) / 150,
        point_counts=np.full(4, 600),
        dropped_counts=np.zeros(4, dtype=np.int64),
        scale=150.0,
        centre=tuple(far),
        units="millimetre",
        frame_names=tuple("abcd"),
    )
    exportable = [joint.model_copy(update={"type": "revolute", "states": (0.0,) * 4}) for joint in joints]
    robot = compute_export(
        result.replace(model=model.model_copy(update={"joints": tuple(exportable)})),
        None,
        ExportConfig(triangles=200),
        "arm",
    )
    lost = JointMetrics(name="wrist", true_type="revolute", predicted_type=None)
    metrics = Metrics(
        units="millimetre",
        diagonal=150.0,
        canonical_frame=1,
        parts_found=4,
        chamfer_percent=0.5,
        parts_true=3,
        ari=0.9,
        joints=(lost,),
    )
    return result, sequence, robot, metrics, np.minimum(labels, 2)


def about(rotation_vector: np.ndarray, point: np.ndarray) -> np.ndarray:
    """The rotation about an axis through a point."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    T[:3, 3] = point - T[:3, :3] @ point
    return T
