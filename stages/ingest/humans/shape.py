"""The shape of a body: MakeHuman's macro shapes, mixed by gender, age, build and origin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np
from jaxtyping import Float64

from stages.ingest.humans.assets import base_mesh, shape_offsets, shape_path

# names of the shapes at equal steps from 0 to 1
GENDERS = ("male", "female")
AGES = ("baby", "child", "young", "old")
MUSCLES = ("minmuscle", "averagemuscle", "maxmuscle")
WEIGHTS = ("minweight", "averageweight", "maxweight")
HEIGHTS = ("minheight", "maxheight")
PROPORTIONS = ("idealproportions", "uncommonproportions")
ORIGINS = ("african", "asian", "caucasian")
# bodies are of school age or older, and not of extreme build
_AGE = (0.4, 1.0)
_BUILD = (0.15, 0.85)
_HEIGHT = (0.3, 0.6)  # nobody is taller than 2 m


@dataclass(frozen=True)
class Shape:
    """Parameters from 0 to 1; those of `origins` add up to 1. Age: 0 is a baby, 1/3 a child, 2/3 young, 1 old."""

    gender: float = 0.5
    age: float = 2 / 3
    muscle: float = 0.5
    weight: float = 0.5
    height: float = 0.5
    proportions: float = 0.5
    origins: tuple[float, float, float] = (1 / 3, 1 / 3, 1 / 3)

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Draw a body of any gender, age and build."""
        gender = float(rng.integers(2)) * 0.8 + 0.2 * rng.random()
        age = float(rng.uniform(*_AGE))
        muscle, weight, proportions = rng.uniform(*_BUILD, size=3).tolist()
        height = float(rng.uniform(*_HEIGHT))
        african, asian, caucasian = rng.dirichlet(np.ones(3)).tolist()
        return cls(gender, age, muscle, weight, height, proportions, (african, asian, caucasian))


def shaped_vertices(shape: Shape) -> Float64[np.ndarray, "vertices 3"]:
    """All vertices of the mesh at rest, in metres: the reference plus the weighted shapes."""
    vertices = base_mesh().vertices.copy()
    for name, share in shape_shares(shape).items():
        vertices += share * shape_offsets(name)
    return vertices


def shape_shares(shape: Shape) -> dict[str, float]:
    """Yield MakeHuman's macro shapes with their shares in a body, except those without a share."""
    return {name: share for name, share in _shares(shape) if share > 0 and shape_path(name).exists()}


def _shares(shape: Shape) -> Iterator[tuple[str, float]]:
    gender, age = _steps(shape.gender, GENDERS), _steps(shape.age, AGES)
    build = (gender, age, _steps(shape.muscle, MUSCLES), _steps(shape.weight, WEIGHTS))
    for words, share in _combined(*build):
        yield f"macrodetails/universal-{words}", share
        yield f"breast/{words}-averagecup-averagefirmness", share  # exists for women only
    for words, share in _combined(dict(zip(ORIGINS, shape.origins, strict=True)), gender, age):
        yield f"macrodetails/{words}", share
    for words, share in _combined(*build, _steps(shape.height, HEIGHTS)):
        yield f"macrodetails/height/{words}", share
    for words, share in _combined(*build, _steps(shape.proportions, PROPORTIONS)):
        yield f"macrodetails/proportions/{words}", share  # does not exist for babies


def _steps(value: float, names: tuple[str, ...]) -> dict[str, float]:
    """Linear interpolation between names at equal steps from 0 to 1."""
    at = value * (len(names) - 1)
    return {name: max(0.0, 1.0 - abs(at - step)) for step, name in enumerate(names)}


def _combined(*mixtures: dict[str, float]) -> Iterator[tuple[str, float]]:
    """Yield each combination of names, joined by dashes, with the product of their shares unless that is 0."""
    for names in product(*mixtures):
        share = float(np.prod([mixture[name] for mixture, name in zip(mixtures, names, strict=True)]))
        if share > 0:
            yield "-".join(names), share
