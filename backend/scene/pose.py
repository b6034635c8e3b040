"""From a sample to how the actuator looks: lengths, angles and colours, without any drawing."""

import math
from dataclasses import dataclass
from itertools import pairwise

from backend.scene import layout
from plant.dynamics import Spring

SOLID_FORCE_N = 50.0
PRESSED_N = 0.05
"""Force [N] from which on the joint is drawn as pressing on a wall."""

# Dark blue to amber, even in lightness, distinguishable with every kind of colour vision; red is kept for faults.
_FORCE_COLOURS = ((0.0, (52, 78, 130)), (0.35, (72, 130, 168)), (0.65, (150, 178, 140)), (1.0, (245, 176, 40)))
SLACK_COLOUR = (140, 146, 156)
_COLOUR_STEPS = 40


@dataclass(frozen=True)
class Side:
    """One tendon with its spring and reel. ``sag`` is the length of slack tendon [m], 0 while it pulls."""

    theta: float
    force_N: float
    spring_length: float
    sag: float
    colour: tuple[int, int, int]

    @property
    def slack(self) -> bool:
        """Whether the tendon hangs loose."""
        return self.sag > 0.0


@dataclass(frozen=True)
class Pose:
    """How the actuator looks at one instant; angles in rad, lengths in m, ``fan`` is ± the angle that 2 N·m yields.

    ``fan`` is 0 while a tendon is slack: S is not known then.
    ``F_ext_hat`` [N] is nan where it is not known, as in recordings of earlier versions; ``pressed``: it presses on a
    wall.
    """

    q: float
    q_ref: float
    fan: float
    F_push: float
    F_ext_hat: float
    pressed: bool
    A: Side
    B: Side


def pose(sample: dict[str, float], r_m: float, r_j: float, spring_A: Spring, spring_B: Spring) -> Pose:
    """Return the pose for ``sample`` (signals by name). Elongations follow equation 1, the force the load cell.

    Without a reference the ghost stands where the joint is.
    """
    x_A = r_m * sample["theta_A"] - r_j * sample["q"]
    x_B = r_m * sample["theta_B"] + r_j * sample["q"]
    A = _side(sample["theta_A"], x_A, sample["F_A"], spring_A)
    B = _side(sample["theta_B"], x_B, sample["F_B"], spring_B)
    return Pose(
        q=sample["q"],
        q_ref=sample["q"] if math.isnan(sample["q_ref"]) else sample["q_ref"],
        fan=0.0 if A.slack or B.slack or math.isnan(sample["S"]) else layout.FAN_TORQUE / max(sample["S"], 1.0),
        F_push=sample["F_push"],
        F_ext_hat=sample.get("F_ext_hat", math.nan),
        pressed=abs(sample.get("F_wall", math.nan)) >= PRESSED_N,
        A=A,
        B=B,
    )


def can_be_drawn(sample: dict[str, float]) -> bool:
    """Return whether all is known that a pose needs; a broken sensor reads nan."""
    return all(math.isfinite(sample[name]) for name in ("q", "theta_A", "theta_B"))


def force_colour(force_N: float) -> tuple[int, int, int]:
    """Return the colour of a tendon that pulls with ``force_N``, in steps fine enough to look continuous."""
    level = round(_COLOUR_STEPS * min(max(force_N / SOLID_FORCE_N, 0.0), 1.0)) / _COLOUR_STEPS
    for (low, begin), (high, end) in pairwise(_FORCE_COLOURS):
        if level <= high:
            part = (level - low) / (high - low)
            red, green, blue = (round(a + part * (b - a)) for a, b in zip(begin, end, strict=True))
            return red, green, blue
    return _FORCE_COLOURS[-1][1]


def _side(theta: float, x: float, force_N: float, spring: Spring) -> Side:
    force_N = 0.0 if math.isnan(force_N) else force_N
    slack = x <= spring.x_slack
    compressed = min(max(x, spring.x_slack), spring.x_solid)
    return Side(
        theta=theta,
        force_N=force_N,
        spring_length=layout.SPRING_FREE - compressed,
        sag=max(spring.x_slack - x, 1e-4) if slack else 0.0,
        colour=SLACK_COLOUR if slack else force_colour(force_N),
    )
