"""Features of a cloud's points by the network."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32, Float64

from stages.flow.network.geometry import cloud_geometry
from stages.flow.network.model import FEATURES, Clouds, FeatureNetwork
from stages.flow.network.weights import load_network

network_of = lru_cache(load_network)


def describe(points: Float64[np.ndarray, "points 3"], weights: Path) -> Float32[np.ndarray, "points 64"]:
    """f(P) (A.1), scaled so that dot products are the logits of the matching matrix S(P).

    `points` are in the normalised frame. Raises InputError for a file that holds no weights of the network.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network: FeatureNetwork = network_of(weights).to(device)
    with torch.inference_mode():
        features = network(Clouds.of([cloud_geometry(points)], device))[0]
    return (features / FEATURES**0.25).cpu().numpy()
