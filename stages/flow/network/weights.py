"""Tensors on disk as safetensors, which holds arrays and text but no code. Equal content gives equal bytes."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from schemas.errors import InputError
from stages.flow.network.model import FeatureNetwork

FORMAT = "rearticulate flow network 1"
DIGEST = "digest"  # the note with a file's digest, which older files lack
MOST_MIB = 512
SHIPPED = Path(__file__).with_name("weights.safetensors")  # new ones need a new stages.flow.VERSION


def weights_file(network: FeatureNetwork, notes: Mapping[str, str]) -> bytes:
    """A file of a network's weights, with notes on their training."""
    return safetensors_bytes(network.state_dict(), {"format": FORMAT, **notes})


def safetensors_bytes(tensors: Mapping[str, Tensor], notes: Mapping[str, str]) -> bytes:
    """A safetensors file of tensors and texts, with their digest. The bytes do not depend on the order of either.

    The library itself writes the texts in an order that differs between processes.
    """
    ordered = {name: tensors[name].detach().contiguous() for name in sorted(tensors)}
    content = save(ordered, {**notes, DIGEST: _digest(ordered, notes)})
    size = int.from_bytes(content[:8], "little")
    header, data = json.loads(content[8 : 8 + size]), content[8 + size :]
    texts = header.pop("__metadata__")
    entries = sorted(header.items(), key=lambda item: (item[1]["data_offsets"], item[0]))
    text = json.dumps({"__metadata__": dict(sorted(texts.items())), **dict(entries)}, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)  # the data is aligned
    return len(text).to_bytes(8, "little") + text + data


def _digest(tensors: Mapping[str, Tensor], notes: Mapping[str, str]) -> str:
    """SHA-256 (hex) over the texts, and the tensors' names, types, shapes and values."""
    texts = sorted((name, text) for name, text in notes.items() if name != DIGEST)
    total = hashlib.sha256(json.dumps(texts).encode())
    for name in sorted(tensors):
        tensor = tensors[name].detach().cpu().contiguous()
        total.update(f"{name} {tensor.dtype} {tuple(tensor.shape)} ".encode())
        total.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return total.hexdigest()


def load_network(path: Path = SHIPPED) -> FeatureNetwork:
    """Load a network with the weights of a file, for inference. Raises InputError if they do not fit this network."""
    tensors, _ = read_safetensors(path, FORMAT)
    network = FeatureNetwork()
    check_state(path, tensors, network.state_dict())
    network.load_state_dict(tensors)
    return network.eval()


def check_state(path: Path | str, tensors: Mapping[str, Tensor], expected: Mapping[str, Tensor]) -> None:
    """Raise InputError unless the tensors of a file are finite and have the expected names and shapes."""
    for name, tensor in expected.items():
        if name not in tensors:
            raise InputError(f"{path}: found no {name}, expected weights of the flow network; take another file")
        found = tensors[name]
        if found.shape != tensor.shape or found.dtype != tensor.dtype:
            raise InputError(
                f"{path}: {name}: found shape {tuple(found.shape)} of {found.dtype}, expected {tuple(tensor.shape)} of "
                f"{tensor.dtype}; these are weights of another network"
            )
        if not torch.isfinite(found).all():
            raise InputError(f"{path}: {name}: found NaN or infinity, expected finite numbers; take another file")
    if extra := sorted(tensors.keys() - expected.keys()):
        raise InputError(
            f"{path}: found {extra[0]}, which the flow network has not; these are weights of another network"
        )


def read_safetensors(path: Path, expected_format: str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read the arrays and texts of a safetensors file in one of our formats.

    Raises InputError for any other file, for one that is too large, and for one that differs from its digest.
    """
    if not os.path.isfile(path):
        raise InputError(f"{path}: found no such file, expected weights (.safetensors); check the path")
    try:
        if (size := path.stat().st_size) > MOST_MIB * 2**20:
            raise InputError(f"{path}: found {size / 2**20:.0f} MiB, expected at most {MOST_MIB}; take another file")
        with safe_open(path, framework="pt") as file:
            notes = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in list(file.keys())}
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error}); check its permissions") from error
    except (SafetensorError, ValueError, RuntimeError) as error:
        raise InputError(
            f"{path}: found something else than safetensors ({error}), expected weights as `reart train-flow` writes "
            "them; pickles (.pt, .pth) are not read"
        ) from error
    if notes.get("format") != expected_format:
        raise InputError(
            f"{path}: found format {notes.get('format')!r}, expected {expected_format!r}; take another file"
        )
    if DIGEST in notes and notes[DIGEST] != _digest(tensors, notes):
        raise InputError(f"{path}: found content that does not fit its digest: the file is damaged; take another one")
    return tensors, notes
