"""The result: the content of model.json and model.npz, in the input's units."""

from __future__ import annotations

import io
import json
import zipfile

import numpy as np
from jaxtyping import Float64

from schemas.assessment import Assessment, Spread
from schemas.joints import SCREW
from schemas.kinematic import CONFIDENCES, KinematicModel
from schemas.model_file import JointConfidence, ModelFile, ModelJoint, ModelPart, Numbers, Result, Vector
from schemas.seal import BLANK, sealed, sha256
from schemas.sequence import PointSequence
from stages.final_fit.working import contact_points
from stages.kernels.points.normalisation import Normalisation
from stages.kernels.points.precision import float32_holds


def compute_result(model: KinematicModel, sequence: PointSequence, assessment: Assessment | None = None) -> Result:
    """Convert a model to the result, in the canonical frame and the input's units, with what is known of its worth.

    Raises ValueError for a model with screw joints, whose kind only the final fit decides.
    """
    undecided = [joint for joint, kind in enumerate(model.kinds) if kind == SCREW]
    if undecided:
        raise ValueError(
            f"KinematicModel.joint_types: joints {undecided} are screws, expected kinds that are decided; "
            "run the final fit first"
        )
    p_canonical = sequence.to_input(sequence.frames()[model.canonical_frame])
    single = float32_holds(p_canonical)
    space = Normalisation(np.asarray(sequence.centre), sequence.scale)
    model = model.replace(point=contact_points(model, sequence.frames()[model.canonical_frame]))
    counts = np.bincount(model.labels, minlength=model.part_count).tolist()
    return Result(
        model=ModelFile(
            version=1 if single else 2,
            units=sequence.units,
            frames=sequence.frame_count,
            canonical_frame=model.canonical_frame,
            root=model.root,
            parts=tuple(ModelPart(id=i, name=f"part_{i}", point_count=count) for i, count in enumerate(counts)),
            joints=tuple(_joint(model, sequence, joint, assessment) for joint in range(len(model.joint_types))),
            verdict=None if assessment is None else assessment.verdict,
        ),
        canonical_points=p_canonical.astype(np.float32) if single else p_canonical,
        labels=model.labels,
        T_frame_canonical=space.motions_to_input(model.Ts_frame_canonical),
        colours=None if sequence.colours is None else sequence.by_frame(sequence.colours)[model.canonical_frame],
    )


def _joint(model: KinematicModel, sequence: PointSequence, joint: int, assessment: Assessment | None) -> ModelJoint:
    parent, child = int(model.joint_parent[joint]), int(model.joint_child[joint])
    kind = model.kinds[joint]
    states = model.states_of(joint) * kind.units(sequence.scale)
    sizes = np.linalg.norm(states, axis=1, keepdims=True) if kind.is_ball else states
    return ModelJoint(
        id=joint,
        name=f"joint_{parent}_{child}",
        parent=parent,
        child=child,
        type=kind.name,
        axis=_vector(model.axis[joint]),
        point=_vector(sequence.to_input(model.point[joint])),
        lower=_number_or_tuple(sizes.min(axis=0)),
        upper=_number_or_tuple(sizes.max(axis=0)),
        confidence=_confidence(model, joint),
        spread=None if assessment is None else _in_units(assessment.spreads[joint], sequence.scale),
        states=tuple(map(_number_or_tuple, states)),
    )


def _confidence(model: KinematicModel, joint: int) -> JointConfidence | None:
    if model.confidence is None:
        return None
    return JointConfidence(**dict(zip(CONFIDENCES, model.confidence[joint].tolist(), strict=True)))


def _in_units(spread: Spread, scale: float) -> Spread:
    return spread.model_copy(update={"place": None if spread.place is None else spread.place * scale})


def _number_or_tuple(numbers: Float64[np.ndarray, "size"]) -> Numbers:
    """A joint's state or limit: one number, or a tuple for several degrees of freedom."""
    values = numbers.tolist()
    return values[0] if len(values) == 1 else tuple(values)


def _vector(p: Float64[np.ndarray, "3"]) -> Vector:
    x, y, z = p.tolist()
    return x, y, z


def result_files(result: Result) -> dict[str, bytes]:
    """The bytes of model.json and model.npz. Equal results give equal bytes.

    model.json holds the digests of both, so that damage and a mixture of two models are detected.
    """
    arrays = _npz_bytes(result.arrays())
    model = result.model.model_copy(update={"json_sha256": BLANK, "npz_sha256": sha256(arrays)})
    text = json.dumps(model.model_dump(mode="json", exclude_none=True), indent=1, allow_nan=False) + "\n"
    return {"model.json": sealed(text.encode()), "model.npz": arrays}


def _npz_bytes(arrays: dict[str, np.ndarray]) -> bytes:
    """Serialise arrays as numpy.savez does, but without the time of writing in the archive."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, array, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0)), entry.getvalue())
    return buffer.getvalue()
