"""The 18 robots of the data set: their types, their split, and the sources of their descriptions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from schemas.errors import InputError

RobotKind = Literal["arm", "biped", "hand", "mobile manipulator", "humanoid", "quadruped"]
Split = Literal["train", "validation", "test"]


@dataclass(frozen=True)
class Package:
    """A URDF in a PyPI package. package:// names are relative to the same folder as `urdf`."""

    distribution: str
    urdf: str


@dataclass(frozen=True)
class RobotEntry:
    """A robot's type (Table 3) and split (Table 4), and the sources of its description.

    `module` is the robot's name in robot_descriptions, which clones its repository. `homepage` has the descriptions
    that neither that nor a package provides.
    """

    kind: RobotKind
    split: Split
    package: Package | None = None
    module: str | None = None
    homepage: str | None = None


def _example(urdf: str) -> Package:
    return Package("example-robot-data", f"example-robot-data/robots/{urdf}")


# Table 4 lists Panda twice for validation and Nao nowhere: the second Panda is Nao.
# Reachy and Nao have several generations: robot_descriptions has the first Reachy, and no Nao.
ROBOTS: dict[str, RobotEntry] = {
    "a1": RobotEntry("quadruped", "test", _example("a1_description/urdf/a1.urdf"), "a1"),
    "allegro": RobotEntry(
        "hand", "test", _example("allegro_hand_description/urdf/allegro_right_hand.urdf"), "allegro_hand"
    ),
    "atlas": RobotEntry("humanoid", "train", None, "atlas_v4"),
    "barrett": RobotEntry("hand", "test", None, "barrett_hand"),
    "baxter": RobotEntry("arm", "train", _example("baxter_description/urdf/baxter.urdf"), "baxter"),
    "bolt": RobotEntry("biped", "test", _example("bolt_description/robots/bolt.urdf"), "bolt"),
    "cassie": RobotEntry("biped", "validation", None, "cassie"),
    "icub": RobotEntry("humanoid", "test", Package("icub-models", "iCub/robots/iCubGazeboV2_5/model.urdf"), "icub"),
    "iiwa": RobotEntry("arm", "train", Package("pybullet", "kuka_iiwa/model.urdf"), "iiwa14"),
    "jvrc": RobotEntry("humanoid", "test", Package("jvrc-description", "jvrc_description/urdf/jvrc1.urdf"), "jvrc"),
    "kinova": RobotEntry("arm", "test", _example("kinova_description/robots/kinova.urdf")),
    "laikago": RobotEntry("quadruped", "train", _example("laikago_description/urdf/laikago.urdf"), "laikago"),
    "nao": RobotEntry("humanoid", "validation", homepage="github.com/jrl-umi3218/nao_description"),
    "panda": RobotEntry("arm", "validation", _example("panda_description/urdf/panda.urdf"), "panda"),
    "reachy": RobotEntry("mobile manipulator", "test", None, "reachy"),
    "solo": RobotEntry("quadruped", "test", _example("solo_description/robots/solo12.urdf"), "solo"),
    "spot": RobotEntry("quadruped", "validation", homepage="github.com/bdaiinstitute/spot_description"),
    "ur5": RobotEntry("arm", "test", _example("ur_description/urdf/ur5_robot.urdf")),
}


def robot_names() -> list[str]:
    """The names of all robots of the data set, whether this machine has their descriptions or not."""
    return sorted(ROBOTS)


def robot_entry(name: str) -> RobotEntry:
    """The catalogue's entry of a robot. Raises InputError for an unknown name."""
    if name not in ROBOTS:
        raise InputError(f"robot {name!r}: not known, expected one of {', '.join(robot_names())}; check the spelling")
    return ROBOTS[name]


def robot_kind(name: str) -> RobotKind:
    """A robot's type (the supplement's Table 3). Raises InputError for an unknown name."""
    return robot_entry(name).kind


def robot_split(name: str) -> Split:
    """The split that a robot belongs to (the supplement's Table 4). Raises InputError for an unknown name."""
    return robot_entry(name).split
