"""What is asked of touch, and what is told of it, as plain data."""

from dataclasses import dataclass

CONTACT_MIN_N, CONTACT_MAX_N = 1.0, 30.0
"""Force that may count as a contact [N]: with less, the estimate's own error in a fast move could."""

NEIGHBOUR = 0.25
"""Points nearer to each other than this [N·m/rad] are one, and the newer counts."""

SIGMAS = 6.0
"""The least force of a contact, in standard deviations of the estimate at rest."""


@dataclass(frozen=True)
class SetTouch:
    """What the estimate of the outside force has learned, and from what force on [N] a contact is reacted to, 0: never.

    ``bias`` are points of S [N·m/rad], rising, and the force [N] that is estimated there with nothing outside.
    """

    bias: tuple[tuple[float, float], ...] = ()
    contact_N: float = 0.0


@dataclass(frozen=True)
class ContactFelt:
    """An outside force estimated at ``F_ext_hat`` [N] was a contact, as ``contact_N`` [N] says: the joint gives way."""

    tick: int
    F_ext_hat: float
    contact_N: float


@dataclass(frozen=True)
class TouchForgotten:
    """The motors' zeros were found anew: what the outside force had learned is gone, and nothing is given way to."""

    tick: int
