"""The parts of a training step (A.1): augmentation by rotation, the matching loss, and the score of matches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64
from scipy.spatial.transform import Rotation
from torch import Tensor, nn
from torch.nn import functional

from stages.flow.network.model import FEATURES, Clouds, FeatureNetwork
from stages.flow.training.pairs import Pair

NEAR = 0.02  # a match is right up to this distance from the true place, in diagonals


@dataclass(frozen=True)
class Batch:
    """A batch of pairs: all first clouds, then all second ones."""

    clouds: Clouds
    match: Int64[Tensor, "clouds fine"]
    known: Bool[Tensor, "clouds fine"]

    @classmethod
    def of(cls, pairs: Sequence[Pair]) -> Batch:
        match = [pair.match_first for pair in pairs] + [pair.match_second for pair in pairs]
        known = [pair.known_first for pair in pairs] + [pair.known_second for pair in pairs]
        return cls(
            Clouds.of([pair.first for pair in pairs] + [pair.second for pair in pairs]),
            torch.from_numpy(np.stack(match)),
            torch.from_numpy(np.stack(known)),
        )


@dataclass(frozen=True)
class Score:
    """A network's score on pairs: the loss, and the shares of right matches, mutual matches, and right mutual ones."""

    loss: float
    right: float
    mutual: float
    mutual_right: float


def turned(batch: Batch, turn_degrees: float, rng: np.random.Generator) -> Batch:
    """Rotate each pair at random, mirror some, and rotate one cloud of each by up to `turn_degrees` more."""
    pairs = len(batch.match) // 2
    whole = Rotation.random(pairs, rng).as_matrix()
    whole[rng.random(pairs) < 0.5, :, 0] *= -1.0
    axes = rng.normal(size=(pairs, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    own = Rotation.from_rotvec(axes * np.radians(rng.uniform(0, turn_degrees, (pairs, 1)))).as_matrix()
    R = torch.from_numpy(np.concatenate([whole, own @ whole]).astype(np.float32)).transpose(1, 2)
    clouds = batch.clouds
    changed = replace(clouds, points=clouds.points @ R, normals=clouds.normals @ R, queries=clouds.queries @ R)
    return replace(batch, clouds=changed)


def scores(first: Float32[Tensor, "pairs n d"], second: Float32[Tensor, "pairs m d"]) -> Float32[Tensor, "pairs n m"]:
    """Logits of the matching matrix S(P)."""
    return first @ second.transpose(1, 2) / FEATURES**0.5


def matching_loss(network: nn.Module, batch: Batch) -> Tensor:
    """Cross-entropy of each known point's true counterpart, in both directions (L_corr)."""
    logits = _logits(network, batch)
    pairs = len(batch.match) // 2
    first, second = batch.known[:pairs], batch.known[pairs:]
    forward = functional.cross_entropy(logits[first], batch.match[:pairs][first])
    backward = functional.cross_entropy(logits.transpose(1, 2)[second], batch.match[pairs:][second])
    return (forward + backward) / 2


def score(network: FeatureNetwork, batches: Sequence[Batch]) -> Score:
    """Score the network's matches. Batches have equal weights."""
    network.eval()
    with torch.inference_mode():
        found = [_score(network, batch) for batch in batches]
    network.train()
    return Score(*np.mean(found, axis=0).tolist())


def _score(network: FeatureNetwork, batch: Batch) -> tuple[float, float, float, float]:
    pairs = len(batch.match) // 2
    logits = _logits(network, batch)
    known, match = batch.known[:pairs], batch.match[:pairs]
    loss = functional.cross_entropy(logits[known], match[known])
    chosen, back = logits.argmax(dim=2), logits.argmax(dim=1)
    mutual = torch.gather(back, 1, chosen) == torch.arange(chosen.shape[1])
    places = batch.clouds.queries[pairs:]
    at = [torch.gather(places, 1, index[..., None].expand(-1, -1, 3)) for index in (chosen, match)]
    diagonal = (places.amax(dim=1) - places.amin(dim=1)).norm(dim=-1)
    right = (at[0] - at[1]).norm(dim=-1) < NEAR * diagonal[:, None]
    both = mutual & known
    return (
        loss.item(),
        right[known].float().mean().item(),
        mutual.float().mean().item(),
        (right & both).sum().item() / max(1, int(both.sum())),
    )


def _logits(network: nn.Module, batch: Batch) -> Tensor:
    features = network(batch.clouds)
    pairs = len(batch.match) // 2
    return scores(features[:pairs].float(), features[pairs:].float())
