"""What a run was set to: its plan, the tuning and seed of the loop, and both declared with unit and meaning. Pure.

A session has a tuning and a mode only.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from backend.documents.edge import ABSENT, Edge, json_ready
from backend.documents.kept_wall import KeptWall

VERSION = 1

Value = bool | int | float | str

LAMBDA, TIME_OPTIMAL = MOTIONS = ("lambda", "time-optimal")
"""The two ways to follow a reference: by the paper's law, or by a trajectory with feed-forward."""


@dataclass(frozen=True, kw_only=True)
class KeptLoop:
    """The tuning that a run began with, as ``TuningChoice`` spells it, and the seed of the simulator.

    What an earlier version did not keep is None; ``bank`` 0 stands for gains from geometry. Before ``motion`` was kept,
    ``u_plan`` alone said it (``with_motion``).
    """

    lam_q: float | None = field(default=None, metadata=ABSENT)
    lam_S: float | None = field(default=None, metadata=ABSENT)
    lam_motor: float | None = field(default=None, metadata=ABSENT)
    b: float | None = field(default=None, metadata=ABSENT)
    bank: int | None = field(default=None, metadata=ABSENT)
    interpolate: bool | None = field(default=None, metadata=ABSENT)
    motion: str | None = field(default=None, metadata=ABSENT)
    u_plan: float | None = field(default=None, metadata=ABSENT)
    k_ext: float | None = field(default=None, metadata=ABSENT)
    seed: int | None = field(default=None, metadata=ABSENT)

    @property
    def budget(self) -> float:
        """Voltage limit [V] of the trajectory in use; 0 V in ``lambda``, which has none."""
        return 0.0 if self.motion == LAMBDA or self.u_plan is None else self.u_plan

    def known(self) -> dict[str, Value]:
        """Return by name what was kept."""
        return json_ready({name: value for name, value in vars(self).items() if value is not None})


@dataclass(frozen=True)
class KeptGrant:
    """What the machine granted to the loop of a run: ``priority`` of SCHED_FIFO, 0 under ordinary scheduling.

    ``refusals`` say what it did not grant, why, and the remedy.
    """

    priority: int
    memory_locked: bool
    timer_slack_ns: int
    refusals: tuple[str, ...]


@dataclass(frozen=True)
class DeclaredValue:
    """A setting as it was chosen, with symbol, unit and meaning, so that a stored run explains itself."""

    name: str
    symbol: str
    unit: str
    meaning: str
    value: Value


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """All of it. ``mode`` is that of a session; ``versions`` are those of the packages that computed.

    ``granted`` is absent for a loop that is computed tick by tick, on no clock; ``walls``, what stood in the joint's
    way, where nothing did or where an earlier version kept nothing of it.
    """

    mode: str | None = field(default=None, metadata=ABSENT)
    plan: dict[str, Value] | None = field(default=None, metadata=ABSENT)
    loop: KeptLoop = field(default_factory=KeptLoop)
    declared: tuple[DeclaredValue, ...] | None = field(default=None, metadata=ABSENT)
    versions: dict[str, str] | None = field(default=None, metadata=ABSENT)
    granted: KeptGrant | None = field(default=None, metadata=ABSENT)
    walls: tuple[KeptWall, ...] | None = field(default=None, metadata=ABSENT)
    version: int = VERSION

    @property
    def law(self) -> str:
        """The law that played the plan, as ``Law`` spells it: one that chose none had the cascade."""
        return str((self.plan or {}).get("controller", "cascade"))

    @property
    def experiment(self) -> str | None:
        """The text of the experiment; None where the plan is none that is data."""
        text = (self.plan or {}).get("experiment")
        return None if text is None else str(text)

    def told(self) -> dict[str, Value]:
        """Return plan and tuning by name."""
        return {**(self.plan or {}), **self.loop.known()}


def with_motion(parts: Mapping[str, Any]) -> dict[str, Any]:
    """Return parts of a tuning, with the motion that a voltage limit implies where they name none.

    A limit alone chooses ``time-optimal``; a limit of 0 V chooses ``lambda``, as what was written before ``motion``
    existed means.
    """
    if parts.get("motion") is not None or parts.get("u_plan") is None:
        return dict(parts)
    try:
        is_lambda = float(parts["u_plan"]) == 0.0
    except (TypeError, ValueError):
        return dict(parts)  # who reads the value refuses it
    if is_lambda:
        return {**{name: value for name, value in parts.items() if name != "u_plan"}, "motion": LAMBDA}
    return {**parts, "motion": TIME_OPTIMAL}


def loop_apart(document: Any) -> Any:
    """Return settings with the tuning in a part of its own: early sessions had it beside the mode."""
    if not isinstance(document, Mapping) or "mode" not in document or "loop" in document:
        return document
    return {"mode": document["mode"], "loop": {name: part for name, part in document.items() if name != "mode"}}


SETTINGS: Edge[RunSettings] = Edge(RunSettings, "what it was set to", VERSION, loop_apart)
