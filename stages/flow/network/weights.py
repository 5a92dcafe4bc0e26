"""The network's weights on disk: safetensors, which holds arrays and text and can't hold code."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from schemas.errors import InputError
from stages.flow.network.model import FeatureNetwork

FORMAT = "rearticulate flow network 1"
SHIPPED = Path(__file__).with_name("weights.safetensors")  # other ones need another version of the flow task


def weights_file(network: FeatureNetwork, notes: Mapping[str, str]) -> bytes:
    """A file of a network's weights, with notes on how they came about."""
    return save(network.state_dict(), {"format": FORMAT, **notes})


def load_network(path: Path = SHIPPED) -> FeatureNetwork:
    """A network with the weights of a file, for use. Raises InputError where these are not weights of this network."""
    tensors, _ = read_safetensors(path, FORMAT)
    network = FeatureNetwork()
    for name, expected in network.state_dict().items():
        if name not in tensors:
            raise InputError(f"{path}: found no {name}, expected weights of the flow network; take another file")
        if tensors[name].shape != expected.shape:
            raise InputError(
                f"{path}: {name}: found shape {tuple(tensors[name].shape)}, expected {tuple(expected.shape)}; "
                "these are weights of another network"
            )
        if not torch.isfinite(tensors[name]).all():
            raise InputError(f"{path}: {name}: found NaN or infinity, expected finite numbers; take another file")
    if extra := sorted(tensors.keys() - network.state_dict().keys()):
        raise InputError(
            f"{path}: found {extra[0]}, which the flow network has not; these are weights of another network"
        )
    network.load_state_dict(tensors)
    return network.eval()


def read_safetensors(path: Path, expected_format: str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """The arrays and texts of a safetensors file of one of our formats. Raises InputError for any other file."""
    if not path.is_file():
        raise InputError(f"{path}: found no such file, expected weights (.safetensors); check the path")
    try:
        with safe_open(path, framework="pt") as file:
            notes = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in list(file.keys())}
    except (SafetensorError, OSError) as error:
        raise InputError(
            f"{path}: found something else than safetensors ({error}), expected weights as `reart train-flow` writes "
            "them; pickles (.pt, .pth) are not read"
        ) from error
    if notes.get("format") != expected_format:
        raise InputError(
            f"{path}: found format {notes.get('format')!r}, expected {expected_format!r}; take another file"
        )
    return tensors, notes
