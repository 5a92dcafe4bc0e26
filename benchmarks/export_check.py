"""Whether exported robots are what the models say: `python benchmarks/export_check.py WORKDIR [--anew] [--assets DIR]`.

WORKDIR is a finished run's working directory, or one data set's folder in it. Of every sequence, robot.urdf and
robot.xml are loaded by other programs (MuJoCo, yourdfpy, trimesh) and checked: no warnings; parts where model.npz says
in every frame; each joint moves its own bodies and no others over its whole range; no links push each other apart at
zero; a thousand steps stay finite; meshes are closed or said not to be, and lie on the true surface. That is made of
all frames' points, moved back by the true motions; or with `--assets` (robot descriptions) sampled anew and densely,
which noisy or partial frames need. `--anew` exports anew by this code rather than checking what the run wrote. The
record goes to results/export-DATE.json.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
import tempfile
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import mujoco
import numpy as np
import trimesh
import yourdfpy
from jaxtyping import Float64
from run import FOLDER, Machine, commit, machine

from pipeline.results.model_folder import read_model_folder
from pipeline.results.report_tables import Cell, Row, Table, to_markdown
from pipeline.run.task import package_versions
from pipeline.store import artifacts
from pipeline.store.files import write_files
from pipeline.store.keys import canonical_json
from schemas.artifact import Schema
from schemas.config import IngestConfig, PipelineConfig
from schemas.errors import InputError
from schemas.manifest import Manifest
from schemas.model_file import ModelJoint, Result
from schemas.sequence import NO_PART, IngestedSequence
from stages.export.stage import WRITERS, compute_export
from stages.ingest.sources import list_sources
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import KDTree

STEPS = 1000
PLACE = 1e-5  # most that a part may be off, as a share of the diagonal
SURFACE_PERCENT = 1.0  # most that meshes may be off the true surface in the mean, in % of the diagonal
STILL = 1e-9  # metres and radians by which a body that is not to move may
SAMPLES = 100_000  # on the meshes
TRUE_POINTS = 50_000  # on the true surface, sampled anew


class Check(Schema):
    """What was found of one robot; lengths in % of the diagonal."""

    sequence: str
    links: int
    joints: int
    free_base: bool
    warnings: tuple[str, ...]
    place_percent: dict[str, float]
    wrong_joints: tuple[str, ...]
    unstable: tuple[str, ...]
    overlapping: tuple[str, ...]
    open_meshes: tuple[str, ...]
    unsaid_open_meshes: tuple[str, ...]
    mesh_to_true_percent: float | None
    true_to_mesh_percent: float | None

    @property
    def surface_percent(self) -> float | None:
        if self.mesh_to_true_percent is None or self.true_to_mesh_percent is None:
            return None
        return (self.mesh_to_true_percent + self.true_to_mesh_percent) / 2

    @property
    def faults(self) -> tuple[str, ...]:
        faults = [*self.warnings, *(f"joint {name} moves others" for name in self.wrong_joints)]
        faults += [f"{what}: parts are off" for what, off in self.place_percent.items() if not off <= 100 * PLACE]
        faults += [f"{what}: unstable" for what in self.unstable]
        faults += [f"{what}: links are pushed apart at once" for what in self.overlapping]
        faults += [f"{file} is open, which robot.urdf does not say" for file in self.unsaid_open_meshes]
        if self.surface_percent is not None and not self.surface_percent <= SURFACE_PERCENT:
            faults.append("meshes are off the true surface")
        return tuple(faults)


class Record(Schema):
    """benchmarks/results/export-DATE.json."""

    date: datetime
    commit: str
    machine: Machine
    packages: dict[str, str]
    anew: bool
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Exported:
    """A model and its exported files."""

    sequence: str
    result: Result
    folder: Path

    @property
    def scale(self) -> float:
        """Metres per unit of the model."""
        return {"centimetre": 0.01, "millimetre": 0.001}.get(self.result.model.units, 1.0)

    @property
    def diagonal(self) -> float:
        """Of the canonical points' box, in metres."""
        return self.scale * float(np.linalg.norm(np.ptp(self.result.canonical_points, axis=0)))

    def metres(self, joint: ModelJoint) -> float:
        """What a state of one is in a robot description."""
        return self.scale if joint.type == "prismatic" else 1.0

    def subtree(self, joint: int) -> set[str]:
        """The names of the parts that a joint moves."""
        model = self.result.model
        parts = [model.joints[joint].child]
        for part in parts:
            parts += [other.child for other in model.joints if other.parent == part]
        return {model.parts[part].name for part in parts}

    def displacement(self, Ts: dict[str, np.ndarray], t: int, from_root: bool) -> float:
        """How far the motions of the parts, in metres, take their points off where model.npz puts them in frame t."""
        Ts_model = self.result.T_frame_canonical[t]
        if from_root:
            Ts_model = np.linalg.inv(Ts_model[self.result.model.root]) @ Ts_model
        everywhere = self.result.canonical_points.astype(np.float64)
        worst = 0.0
        for part in self.result.model.parts:
            own = everywhere[self.result.labels == part.id]
            p = own if len(own) else everywhere
            expected = self.scale * move_points(Ts_model[part.id], p)
            found = move_points(Ts[part.name], self.scale * p)
            worst = max(worst, float(np.linalg.norm(found - expected, axis=1).max()))
        return 100 * worst / self.diagonal


def main(words: list[str] | None = None) -> int:
    """Check all sequences. The exit code is 1 where one has a fault, 2 where there is nothing to check."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("workdir", type=Path, help="a finished run's working directory, or a data set's folder in it")
    parser.add_argument("--only", nargs="+", metavar="SEQUENCE", help="these sequences only")
    parser.add_argument("--anew", action="store_true", help="export anew by this code")
    parser.add_argument("--assets", type=Path, help="robot descriptions, NAME/NAME.urdf: sample true surfaces anew")
    parser.add_argument("--results", type=Path, default=FOLDER / "results", help="where the record is kept")
    arguments = parser.parse_args(words)
    found = [*arguments.workdir.glob("*/export-*/manifest.json"), *arguments.workdir.glob("*/*/export-*/manifest.json")]
    directories = [
        path.parent.resolve() for path in sorted(found) if not arguments.only or path.parts[-3] in arguments.only
    ]
    if not directories:
        print(f"error: {arguments.workdir}: found no export, expected a finished run; check the path", file=sys.stderr)
        return 2
    assets = arguments.assets and arguments.assets.resolve()
    checks = []
    for artifact in directories:
        with tempfile.TemporaryDirectory() as scratch, working_in(Path(scratch)):
            exported, surface = prepare(artifact, arguments.anew, assets)
            checks.append(check(exported, surface))
        print(f"{checks[-1].sequence}: {'; '.join(checks[-1].faults) or 'as the model says'}", flush=True)
    record = Record(
        date=datetime.now(UTC),
        commit=commit(),
        machine=machine(),
        packages=package_versions() | {"mujoco": mujoco.__version__, "yourdfpy": yourdfpy.__version__},
        anew=arguments.anew,
        checks=tuple(checks),
    )
    path = arguments.results / f"export-{record.date:%Y-%m-%d-%H%M}.json"
    path.write_text(record.model_dump_json(indent=1) + "\n")
    print(f"\n{to_markdown(table(record))}\nwritten: {path}")
    return int(any(entry.faults for entry in checks))


def prepare(artifact: Path, anew: bool, assets: Path | None) -> tuple[Exported, np.ndarray | None]:
    """The exported robot of an artifact, and points on the true surface in metres where the truth is known."""
    manifest = artifacts.read_manifest(artifact)
    result = read_model_folder(artifact.with_name(f"result-{manifest.upstream['result']}"))
    ingested = artifacts.read(artifact.with_name(f"ingest-{manifest.upstream['ingest']}"), IngestedSequence)
    folder = artifact
    if anew:
        folder = Path.cwd() / "robot"
        frames = [ingested.sequence.to_input(frame) for frame in ingested.sequence.frames()]
        config = PipelineConfig.model_validate(manifest.config)
        robot = compute_export(result, frames, config.export, manifest.sequence)
        for writer in WRITERS.values():
            write_files(folder, writer(robot))
    exported = Exported(manifest.sequence, result, folder)
    if assets is not None:
        ingested = dense(manifest, assets, ingested)
    surface = true_surface(ingested, result.model.canonical_frame)
    return exported, None if surface is None else exported.scale * surface


def dense(manifest: Manifest, assets: Path, ingested: IngestedSequence) -> IngestedSequence:
    """The same robot in the same motion, sampled densely and without a sensor's faults."""
    config = IngestConfig.model_validate(manifest.config["ingest"])
    depth = config.roboart.depth.model_copy(update={"cameras": 0})
    perfect = config.roboart.model_copy(
        update={"points": TRUE_POINTS, "noise_percent": 0.0, "viewpoints": 0, "depth": depth}
    )
    [source] = [source for source in list_sources(config, assets) if source.name == manifest.sequence]
    seed = [manifest.seed, zlib.crc32(canonical_json(["ingest", {}]).encode())]  # as the task's own
    again = source.load(config.model_copy(update={"roboart": perfect}), np.random.default_rng(seed))
    if ingested.truth is None or again.truth is None or again.truth.part_names != ingested.truth.part_names:
        raise InputError(f"{assets}: found another {manifest.sequence} than the run's; give the same descriptions")
    return again


def true_surface(ingested: IngestedSequence, canonical_frame: int) -> Float64[np.ndarray, "points 3"] | None:
    """All frames' points where their true parts lie in the canonical frame, in the input's units."""
    sequence, truth = ingested.sequence, ingested.truth
    if truth is None:
        return None
    labels = sequence.by_frame(truth.labels)
    clouds = []
    for frame, own, Ts in zip(sequence.frames(), labels, truth.Ts_frame_first, strict=True):
        of_object = own != NO_PART
        Ts_back = (truth.Ts_frame_first[canonical_frame] @ np.linalg.inv(Ts))[own[of_object]]
        clouds.append(move_points(Ts_back, frame[of_object]))
    return sequence.to_input(np.concatenate(clouds))


def check(exported: Exported, surface: Float64[np.ndarray, "points 3"] | None) -> Check:
    """Everything about one robot."""
    said: list[str] = []
    with listening(said):
        urdf = yourdfpy.URDF.load(str(exported.folder / "robot.urdf"))
        if not urdf.validate():
            said.append("yourdfpy: robot.urdf is not valid")
        loaded = {
            file: mujoco.MjModel.from_xml_path(str(exported.folder / file)) for file in ("robot.urdf", "robot.xml")
        }
    unstable = [file for file, model in loaded.items() if not stable(model)]
    if (log := Path("MUJOCO_LOG.TXT")).exists():
        said += [f"mujoco: {line}" for line in log.read_text().splitlines() if line]
    meshes = {path.name: trimesh.load(path) for path in sorted((exported.folder / "meshes").glob("*.stl"))}
    open_meshes = tuple(name for name, mesh in meshes.items() if not mesh.is_watertight)
    text = (exported.folder / "robot.urdf").read_text()
    note = text[: text.find("-->")].partition("not closed:")[2]
    placed = urdf.scene.to_mesh()
    mesh_points, _ = trimesh.sample.sample_surface(placed, SAMPLES, seed=0)
    both = (None, None) if surface is None else chamfer(np.asarray(mesh_points), surface, exported.diagonal)
    return Check(
        sequence=exported.sequence,
        links=len(exported.result.model.parts),
        joints=len(exported.result.model.joints),
        free_base=loaded["robot.xml"].nq > len(exported.result.model.joints),
        warnings=tuple(said),
        place_percent=places(exported, urdf, loaded),
        wrong_joints=tuple(name for model in loaded.values() for name in wrong_joints(exported, model)),
        unstable=tuple(unstable),
        overlapping=tuple(file for file, model in loaded.items() if contacts(model)),
        open_meshes=open_meshes,
        unsaid_open_meshes=tuple(name for name in open_meshes if name not in note),
        mesh_to_true_percent=both[0],
        true_to_mesh_percent=both[1],
    )


def places(exported: Exported, urdf: yourdfpy.URDF, loaded: dict[str, mujoco.MjModel]) -> dict[str, float]:
    """The greatest displacement of a part over all frames, by file and program, in % of the diagonal."""
    model = exported.result.model
    names = [part.name for part in model.parts]

    def in_yourdfpy(states: dict[str, float]) -> dict[str, np.ndarray]:
        urdf.update_cfg(states)
        return {name: np.asarray(urdf.get_transform(name, names[model.root])) for name in names}

    def motions(now: dict[str, np.ndarray], zero: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Of the canonical frame's points; a root that MuJoCo took for a piece of its world stands still."""
        return {name: now[name] @ np.linalg.inv(zero[name]) if name in now else np.eye(4) for name in names}

    at_zero = in_yourdfpy({joint.name: 0.0 for joint in model.joints})
    urdf_model, xml_model = loaded["robot.urdf"], loaded["robot.xml"]
    worst: dict[str, float] = {}
    for t in range(model.frames):
        states = {joint.name: exported.metres(joint) * float(joint.states[t]) for joint in model.joints}
        found = {
            "robot.urdf in yourdfpy": motions(in_yourdfpy(states), at_zero),
            "robot.urdf in mujoco": motions(bodies(urdf_model, states), bodies(urdf_model)),
            "robot.xml in mujoco": motions(bodies(xml_model, frame=t), bodies(xml_model)),
        }
        for what, Ts in found.items():
            off = exported.displacement(Ts, t, from_root="urdf" in what)
            worst[what] = max(worst.get(what, 0.0), off)
    return worst


def wrong_joints(exported: Exported, model: mujoco.MjModel) -> Iterator[str]:
    """The joints that, moved over their range, do not move exactly the bodies that hang on them."""
    for index, joint in enumerate(exported.result.model.joints):
        low, high = model.joint(joint.name).range
        start, moved = bodies(model, {joint.name: low}), set()
        for state in np.linspace(low, high, 6)[1:]:
            now = bodies(model, {joint.name: state})
            moved |= {name for name, T in now.items() if np.abs(T - start[name]).max() > STILL}
        if moved != exported.subtree(index) or not low < high:
            yield joint.name


def bodies(
    model: mujoco.MjModel, states: dict[str, float] | None = None, frame: int | None = None
) -> dict[str, np.ndarray]:
    """Where each body stands at given joint states, or in a key frame; otherwise at zero."""
    data = mujoco.MjData(model)
    if frame is not None:
        mujoco.mj_resetDataKeyframe(model, data, model.key(f"frame_{frame}").id)
    for name, state in (states or {}).items():
        data.qpos[model.joint(name).qposadr[0]] = state
    mujoco.mj_kinematics(model, data)
    Ts = np.tile(np.eye(4), (model.nbody, 1, 1))
    Ts[:, :3, :3], Ts[:, :3, 3] = data.xmat.reshape(-1, 3, 3), data.xpos
    return {model.body(index).name: T for index, T in enumerate(Ts) if index}


def stable(model: mujoco.MjModel) -> bool:
    """Whether a thousand steps from zero, and from the first key frame, stay finite without a warning."""
    for key in range(-1, min(model.nkey, 1)):
        data = mujoco.MjData(model)
        if key >= 0:
            mujoco.mj_resetDataKeyframe(model, data, key)
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
        finite = np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()
        if not finite or any(warning.number for warning in data.warning):
            return False
    return True


def contacts(model: mujoco.MjModel) -> int:
    """How many places there are at zero where bodies push each other."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return int(data.ncon)


def chamfer(
    a: Float64[np.ndarray, "points 3"], b: Float64[np.ndarray, "others 3"], diagonal: float
) -> tuple[float, float]:
    """The mean distances from a to the nearest of b and from b to the nearest of a, in % of the diagonal."""
    return tuple(100 * float(KDTree(q).query(p)[0].mean()) / diagonal for p, q in ((a, b), (b, a)))


@contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """MuJoCo writes its log into the current folder."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


@contextmanager
def listening(said: list[str]) -> Iterator[None]:
    """Note what is said by warnings and logs of at least that level."""
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: said.append(f"{record.name}: {record.getMessage()}")  # type: ignore[method-assign]
    logging.getLogger().addHandler(handler)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield
        said += [f"{entry.category.__name__}: {entry.message}" for entry in caught]
    finally:
        logging.getLogger().removeHandler(handler)


def table(record: Record) -> Table:
    """A line a robot."""
    columns = (
        "robot",
        "links",
        "joints",
        "urdf off %",
        "mjcf off %",
        "open",
        "mesh to true %",
        "true to mesh %",
        "faults",
    )
    rows = []
    for entry in record.checks:
        urdf, xml = (
            max(off for what, off in entry.place_percent.items() if what.startswith(file))
            for file in ("robot.urdf", "robot.xml")
        )
        cells = [str(entry.links), str(entry.joints), f"{urdf:.1e}", f"{xml:.1e}", str(len(entry.open_meshes))]
        for percent in (entry.mesh_to_true_percent, entry.true_to_mesh_percent):
            cells.append("-" if percent is None else f"{percent:.2f}")
        rows.append(Row(entry.sequence, tuple(map(Cell, [*cells, "; ".join(entry.faults) or "none"]))))
    return Table("Exported robots", columns, tuple(rows), words=True)


if __name__ == "__main__":
    sys.exit(main())
