"""The hinge and the drawer as fitted models, standing still or on a moving base."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from schemas.kinematic import KinematicModel
from schemas.model_file import Result
from stages.kernels.screw import screw_transform
from stages.result import to_result

CANONICAL = 2


def fitted(scene: Any, free: bool = False) -> Result:
    Ts = scene.Ts_frame_canonical.copy()
    if free:
        along = torch.linspace(-0.1, 0.1, scene.sequence.frame_count, dtype=torch.float64)
        tilt = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
        Ts = screw_transform(tilt, torch.zeros(3, dtype=torch.float64), 3 * along, along).numpy()[:, None] @ Ts
    kind = "revolute" if scene.states[:, 0].any() else "prismatic"
    model = KinematicModel(
        canonical_frame=CANONICAL,
        root=0,
        labels=scene.canonical_labels,
        Ts_frame_canonical=Ts,
        joint_parent=np.array([0]),
        joint_child=np.array([1]),
        joint_types=(kind,),
        axis=scene.axis[None],
        point=scene.point[None],
        states=scene.states[None],
        e_spatial=np.zeros(1),
        e_1dof=np.zeros(1),
        energies={},
    )
    return to_result(model, scene.sequence)


@pytest.fixture
def fit_of() -> Callable[..., Result]:
    return fitted
