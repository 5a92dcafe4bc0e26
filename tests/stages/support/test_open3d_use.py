"""Open3D that cannot be loaded is named, with a remedy, wherever it is needed."""

import subprocess
import sys

import numpy as np
import pytest

from schemas.config import DepthConfig, ExportConfig, FlowConfig
from schemas.errors import InputError
from stages.export import geometry
from stages.flow.descriptors import fpfh
from stages.ingest.roboart.depth_camera import DepthSensor, scan_depth
from stages.ingest.roboart.sensor import sample_visible
from stages.ingest.roboart.surface import Surface

POINTS = np.random.default_rng(0).uniform(size=(200, 3))
SENSOR = DepthSensor(DepthConfig(cameras=1, width=8, height=8), np.zeros(3), 1.0, 0.0)
SURFACE = Surface(POINTS[:3][None], np.zeros(1, dtype=np.int64))


@pytest.fixture(params=[OSError("libGL.so.1: cannot open"), ImportError("none"), AttributeError("_ARRAY\n_API")])
def cause(request, monkeypatch):
    class Broken:
        def find_spec(self, name, *_):
            if name == "open3d":
                raise request.param

    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    return " ".join(str(request.param).split())


@pytest.mark.parametrize(
    "use",
    [
        lambda: fpfh(POINTS, FlowConfig()),
        lambda: geometry.part_mesh(POINTS, 0.1, ExportConfig(triangles=20)),
        lambda: scan_depth(SURFACE, np.eye(4)[None], np.ones((1, 3)), SENSOR, 5, np.random.default_rng(0)),
        lambda: sample_visible(SURFACE, np.eye(4)[None], np.ones((1, 3)), 5, np.random.default_rng(0)),
    ],
)
def test_open3d_that_cannot_be_loaded_is_named_with_a_remedy(cause, use):
    with pytest.raises(InputError) as caught:
        use()
    assert f"Open3D cannot be loaded here ({cause}); mend its installation" in str(caught.value)


def test_no_module_loads_it_before_it_is_needed():
    code = "import sys, stages.export.stage, stages.flow.stage, stages.report.stage; assert 'open3d' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
