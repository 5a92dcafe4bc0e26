"""Motions of people: curves of joint angles over time for each kind of motion, made of sines and smooth pulses.

Angles are anatomical, in degrees, and zero for a person who stands with hanging arms. `flexion` bends forward (a knee
backward, a foot up). `abduction` leads away from the middle (trunk and head to the left). `turn` leads inward (trunk
and head to the right). Time is in periods of the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from stages.ingest.humans.skeleton import PART_NAMES

Curve = Float64[np.ndarray, "frames"]
TURN = 2 * np.pi

# idle sway of each part about three axes, in degrees: a part that does not move could not be identified
_SWAY = {
    "pelvis": (2.0, 2.0, 4.0),
    "belly": (5.0, 4.0, 5.0),
    "chest": (5.0, 4.0, 7.0),
    "head": (9.0, 6.0, 14.0),
    "upper_arm": (8.0, 5.0, 5.0),
    "forearm": (10.0, 0.0, 6.0),
    "hand": (14.0, 9.0, 0.0),
    "thigh": (2.0, 2.0, 2.0),
    "calf": (2.0, 0.0, 0.0),
    "foot": (5.0, 3.0, 3.0),
}


@dataclass
class Motion:
    """The angles of every part relative to its parent, and the height of the feet above the ground (metres)."""

    angles: dict[str, Float64[np.ndarray, "frames 3"]]
    lift: Curve

    def add(
        self, part: str, flexion: Curve | float = 0.0, abduction: Curve | float = 0.0, turn: Curve | float = 0.0
    ) -> None:
        for axis, angle in enumerate((flexion, abduction, turn)):
            self.angles[part][:, axis] += angle

    def add_both(self, part: str, flexion: Curve | float = 0.0, abduction: Curve | float = 0.0) -> None:
        """Add the same angles on the left and the right."""
        for side in "LR":
            self.add(f"{part}.{side}", flexion, abduction)

    def crouch(self, depth: Curve | float) -> None:
        """Bend both legs by `depth` at the hips and the ankles, so that the feet stay flat below the hips."""
        self.add_both("thigh", depth)
        self.add_both("calf", 2 * np.asarray(depth))
        self.add_both("foot", depth)


@dataclass(frozen=True)
class Style:
    """A person's style: the amplitude of the motion, the leading side and the following side."""

    size: float = 1.0
    lead: str = "R"
    follow: str = "L"


def pulse(turns: Curve, width: float = 0.5) -> Curve:
    """A smooth pulse of height 1 around every whole period, which fills a share of about `width` of it."""
    closeness = (1 + np.cos(TURN * turns)) / 2
    return np.asarray(closeness ** (0.5 / width))


def idle(turns: Curve, rng: np.random.Generator) -> Motion:
    """A sway of every part, each at its own pace, and a slow bob of the knees."""
    motion = Motion({part: np.zeros((len(turns), 3)) for part in PART_NAMES}, np.zeros(len(turns)))
    for part in PART_NAMES:
        most = np.array(_SWAY[part.partition(".")[0]])
        pace, phase = rng.uniform(0.5, 1.0, 3), rng.random(3)
        motion.add(part, *(most[:, None] * np.sin(TURN * (turns[:, None] * pace + phase)).T))
    motion.crouch(7 + 4 * np.sin(TURN * (turns + rng.random())))
    motion.add_both("forearm", 15)
    motion.add_both("upper_arm", abduction=6)
    return motion


def _walk(motion: Motion, turns: Curve, style: Style) -> None:
    for side, phase in ((style.lead, turns), (style.follow, turns + 0.5)):
        swing = np.sin(TURN * phase)
        motion.add(f"thigh.{side}", style.size * (24 * swing + 3))
        motion.add(f"calf.{side}", style.size * 46 * pulse(phase))
        motion.add(f"foot.{side}", style.size * (5 * swing - 16 * pulse(phase + 0.3, 0.35)))
        motion.add(f"upper_arm.{side}", style.size * -24 * swing)
        motion.add(f"forearm.{side}", style.size * (12 - 14 * swing))
    lead = np.sin(TURN * turns) * (1 if style.lead == "R" else -1)
    motion.add("pelvis", turn=-4 * lead)
    motion.add("chest", turn=10 * lead)
    motion.add("belly", 4)


def _hop(motion: Motion, turns: Curve, style: Style) -> None:
    low, high = pulse(turns), pulse(turns + 0.5)
    motion.crouch(style.size * 24 * low)
    motion.add_both("foot", style.size * -28 * high)
    motion.add_both("upper_arm", style.size * (45 * high - 20 * low), 14 * high)
    motion.add_both("forearm", style.size * 35 * low)
    motion.add("belly", 12 * low)
    motion.add("chest", 8 * low)
    motion.add("head", -10 * low)
    motion.lift += style.size * 0.15 * high


def _punch(motion: Motion, turns: Curve, style: Style) -> None:
    motion.crouch(8)
    for side, strike in ((style.lead, pulse(turns)), (style.follow, pulse(turns + 0.5))):
        motion.add(f"upper_arm.{side}", 15 + 65 * strike, 6, 14 * strike)
        motion.add(f"forearm.{side}", 100 - 88 * strike)
    to_left = style.size * (pulse(turns) - pulse(turns + 0.5)) * (1 if style.lead == "R" else -1)
    motion.add("pelvis", turn=-7 * to_left)
    motion.add("belly", 6, turn=-8 * to_left)
    motion.add("chest", 4, turn=-14 * to_left)
    motion.add("head", turn=20 * to_left)
    motion.add(f"thigh.{style.lead}", -14)
    motion.add(f"thigh.{style.follow}", 14)
    motion.add(f"calf.{style.lead}", 8)


def _reach(motion: Motion, turns: Curve, style: Style) -> None:
    far, side = pulse(turns, 0.8), style.lead
    left = 1 if side == "L" else -1
    motion.add(f"upper_arm.{side}", style.size * (20 + 115 * far), 8, 10 * far)
    motion.add(f"forearm.{side}", 75 * (1 - far))
    motion.add(f"hand.{side}", -20 * far)
    motion.add(f"upper_arm.{style.follow}", -20 * far, 20 * far)
    motion.add(f"forearm.{style.follow}", 30 * far)
    motion.add("belly", 14 * far, -9 * left * far)
    motion.add("chest", 6 * far, -9 * left * far, 12 * left * far)
    motion.add("head", -18 * far)
    motion.crouch(12 * (1 - far))
    motion.add(f"thigh.{style.follow}", -16 * far)
    motion.add(f"calf.{style.follow}", 14 * far)


def _squat(motion: Motion, turns: Curve, style: Style) -> None:
    deep = style.size * pulse(turns, 0.8)
    motion.crouch(42 * deep)
    motion.add_both("thigh", 12 * deep, 9)
    motion.add("pelvis", 14 * deep)
    motion.add("belly", 12 * deep)
    motion.add("chest", 6 * deep)
    motion.add("head", -22 * deep)
    motion.add_both("upper_arm", 85 * deep)
    motion.add_both("forearm", 10 * deep)


def _kick(motion: Motion, turns: Curve, style: Style) -> None:
    away, cocked = pulse(turns, 0.6), pulse(turns + 0.35, 0.4)
    motion.add(f"thigh.{style.lead}", style.size * (66 * away - 22 * cocked))
    motion.add(f"calf.{style.lead}", style.size * (62 * cocked + 10 * away))
    motion.add(f"foot.{style.lead}", -20 * away)
    motion.add(f"calf.{style.follow}", 14 * away)
    motion.add(f"thigh.{style.follow}", 6 * away)
    motion.add("pelvis", -6 * away)
    motion.add("belly", 10 * away)
    motion.add("chest", 8 * away - 6 * cocked)
    motion.add(f"upper_arm.{style.lead}", -38 * away + 20 * cocked, 14)
    motion.add(f"upper_arm.{style.follow}", 48 * away - 15 * cocked, 22)
    motion.add_both("forearm", 30)


def _wave(motion: Motion, turns: Curve, style: Style) -> None:
    swing = np.sin(TURN * 1.5 * turns)
    motion.add(f"upper_arm.{style.lead}", 75 + 8 * swing, 10, -45 - 10 * swing)
    motion.add(f"forearm.{style.lead}", 85 + 10 * swing, 0, style.size * 26 * swing)
    motion.add(f"hand.{style.lead}", 0, 18 * swing)
    motion.add(f"forearm.{style.follow}", 20 + 18 * np.cos(TURN * turns))
    motion.add("chest", 0, 7 * np.sin(TURN * turns), 8 * np.cos(TURN * turns))
    motion.add("head", 0, -8 * np.sin(TURN * turns))
    motion.crouch(8 + 8 * np.sin(TURN * turns))


def _jack(motion: Motion, turns: Curve, style: Style) -> None:
    wide, air = pulse(turns, 0.7), pulse(2 * turns + 0.5, 0.6)
    motion.add_both("upper_arm", 0, style.size * 112 * wide)
    motion.add_both("forearm", 12 * wide)
    motion.add_both("thigh", 0, style.size * 20 * wide)
    motion.crouch(10 * (1 - air))
    motion.add_both("foot", -18 * air)
    motion.lift += 0.08 * air


def _march(motion: Motion, turns: Curve, style: Style) -> None:
    for side, phase in ((style.lead, turns), (style.follow, turns + 0.5)):
        knee = style.size * pulse(phase, 0.6)
        motion.add(f"thigh.{side}", 70 * knee)
        motion.add(f"calf.{side}", 78 * knee)
        motion.add(f"foot.{side}", -18 * knee)
        motion.add(f"upper_arm.{side}", -30 * knee + 12)
        motion.add(f"forearm.{side}", 55)
    lead = np.cos(TURN * turns) * (1 if style.lead == "R" else -1)
    motion.add("chest", 3, turn=9 * lead)
    motion.add("belly", 3, 4 * lead)


def _twist(motion: Motion, turns: Curve, style: Style) -> None:
    to_right = style.size * np.sin(TURN * turns)
    motion.add("pelvis", turn=8 * to_right)
    motion.add("belly", 4, -8 * to_right, 14 * to_right)
    motion.add("chest", 4, -10 * to_right, 18 * to_right)
    motion.add("head", 0, 6 * to_right, -16 * to_right)
    for side, inward in (("L", to_right), ("R", -to_right)):
        motion.add(f"upper_arm.{side}", 22 + 12 * inward, 34, 10 * inward)
        motion.add(f"forearm.{side}", 38 + 25 * inward)
        motion.add(f"thigh.{side}", 0, 8)
    motion.crouch(10 + 9 * np.cos(2 * TURN * turns))


KINDS: dict[str, Callable[[Motion, Curve, Style], None]] = {
    "walk": _walk,
    "hop": _hop,
    "punch": _punch,
    "reach": _reach,
    "squat": _squat,
    "kick": _kick,
    "wave": _wave,
    "jack": _jack,
    "march": _march,
    "twist": _twist,
}
# seconds of one period
PERIODS = {"walk": 1.9, "hop": 1.5, "kick": 2.2, "jack": 2.2, "march": 1.7, "twist": 2.4}
_USUAL_PERIOD = 1.6


def move(kind: str, seconds: Curve, rng: np.random.Generator) -> Motion:
    """Draw a motion of a kind at given times, with random amplitude, pace, phase and leading side."""
    period = PERIODS.get(kind, _USUAL_PERIOD) * rng.uniform(0.92, 1.12)
    turns = seconds / period + rng.random()
    lead, follow = ("R", "L") if rng.random() < 0.5 else ("L", "R")
    motion = idle(turns, rng)
    KINDS[kind](motion, turns, Style(float(rng.uniform(0.85, 1.1)), lead, follow))
    return motion
