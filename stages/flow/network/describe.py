"""Features of a cloud's points from the network."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float32, Float64

from schemas.config import FlowConfig
from stages.flow.network.geometry import cloud_geometry
from stages.flow.network.model import FEATURES, Clouds
from stages.flow.network.weights import SHIPPED, load_network

network_of = lru_cache(load_network)


def describe(points: Float64[np.ndarray, "points 3"], config: FlowConfig) -> Float32[np.ndarray, "points 64"]:
    """f(P) (A.1) of a cloud in the normalised frame, scaled so that dot products are the logits of S(P).

    Raises InputError if the configured file does not hold the network's weights.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network = network_of(config.network.weights or SHIPPED).to(device)
    with torch.inference_mode():
        features = network(Clouds.of([cloud_geometry(points)], device))[0]
    return (features / FEATURES**0.25).cpu().numpy()
