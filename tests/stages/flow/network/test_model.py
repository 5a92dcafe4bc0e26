import numpy as np
import torch

from stages.flow.network.geometry import cloud_geometry
from stages.flow.network.model import FEATURES, Clouds, FeatureNetwork, gather


def test_a_cloud_has_the_same_features_alone_and_in_company():
    torch.manual_seed(0)
    network = FeatureNetwork().eval()
    rng = np.random.default_rng(0)
    geometries = [cloud_geometry(rng.normal(size=(300, 3)) * [1, 0.5, 0.2]) for _ in range(2)]
    with torch.inference_mode():
        together = network(Clouds.of(geometries))
        alone = network(Clouds.of(geometries[1:]))
    assert together.shape == (2, 300, FEATURES)
    torch.testing.assert_close(together[1:], alone, atol=1e-5, rtol=1e-4)
    assert (together[0] - together[1]).abs().max() > 1e-3


def test_gather_takes_each_cloud_s_own_points():
    values = torch.arange(2 * 4 * 3, dtype=torch.float32).reshape(2, 4, 3)
    index = torch.tensor([[[0, 3]], [[1, 1]]])
    expected = torch.stack(
        [torch.stack([torch.stack([values[b, k] for k in row]) for row in index[b]]) for b in (0, 1)]
    )
    torch.testing.assert_close(gather(values, index), expected)
