"""Benchmarks are scripts, not a package: each is loaded from its file."""

import importlib.util
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def load_benchmark(monkeypatch):
    """benchmarks/NAME.py as a module, by name; neither it nor what it imports from its folder is kept."""

    def load(name):
        monkeypatch.syspath_prepend(str(FOLDER))
        specification = importlib.util.spec_from_file_location(f"benchmark_{name}", FOLDER / f"{name}.py")
        module = importlib.util.module_from_spec(specification)
        monkeypatch.setitem(sys.modules, f"benchmark_{name}", module)
        specification.loader.exec_module(module)
        monkeypatch.delitem(sys.modules, "run", raising=False)
        return module

    return load
