"""An experiment as data: what a person writes, keeps, sends and runs. Pure.

Angles in rad, stiffness in N·m/rad, forces in N, times in s. Wherever a number stands an expression may stand as well,
a text such as "2 * hold_s", of the experiment's settings, pi, and the index of the repetitions around it.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass as validated

from backend.plain_text import ONE_LINE

FORMAT = 1
"""Version of this form; another one is refused."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}$")]
Words = Annotated[str, Field(max_length=1000)]
Line = Annotated[str, Field(max_length=1000), ONE_LINE]
Title = Annotated[str, Field(min_length=1, max_length=100), ONE_LINE]
Number = int | float | Annotated[str, Field(max_length=200)]

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class Measure(StrEnum):
    """What is measured of a run, each with figures of its own."""

    STEPS = "steps"
    COMPLIANCE = "compliance"
    LOADS = "loads"
    RESPONSE = "response"
    DISTURBANCE = "disturbance"
    BODE = "bode"
    PUSHES = "pushes"
    HOLDS = "holds"
    IMPACT = "impact"


@validated(frozen=True, kw_only=True, config=_STRICT)
class Hold:
    """Stay at the references as they are."""

    do: Literal["hold"]
    duration_s: Number


@validated(frozen=True, kw_only=True, config=_STRICT)
class Step:
    """Jump to the references that are named, and stay there; the joint is pushed with ``F_push`` meanwhile."""

    do: Literal["step"]
    duration_s: Number
    q_ref: Number | None = None
    S_ref: Number | None = None
    F_push: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Ramp:
    """Move evenly to the references that are named, and arrive at the end; so does the push, at ``F_push``."""

    do: Literal["ramp"]
    duration_s: Number
    q_ref: Number | None = None
    S_ref: Number | None = None
    F_push: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Pulse:
    """Jump to the references that are named for ``duration_s``, and back for ``rest_s``."""

    do: Literal["pulse"]
    duration_s: Number
    rest_s: Number
    q_ref: Number | None = None
    S_ref: Number | None = None


@validated(frozen=True, kw_only=True, config=_STRICT)
class Sine:
    """Oscillate around the references as they are, by an amplitude or up to ``q_ref`` and ``S_ref`` at the crest.

    So does the push, around the one before, up to ``F_push`` at the crest.
    """

    do: Literal["sine"]
    duration_s: Number
    period_s: Number
    q_amplitude: Number = 0.0
    S_amplitude: Number = 0.0
    q_ref: Number | None = None
    S_ref: Number | None = None
    F_push: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Sweep:
    """Oscillate from one frequency to another, by the same factor in equal times."""

    do: Literal["sweep"]
    duration_s: Number
    from_Hz: Number
    to_Hz: Number
    q_amplitude: Number = 0.0
    S_amplitude: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Prbs:
    """Jump between two levels by a maximum-length sequence of a register of ``bits``, ``periods`` times."""

    do: Literal["prbs"]
    chip_s: Number
    bits: Number
    periods: Number = 1
    q_amplitude: Number = 0.0
    S_amplitude: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Multisine:
    """Add the first ``lines`` harmonics of ``period_s``, all alike, ``periods`` times; the sum keeps the amplitude."""

    do: Literal["multisine"]
    period_s: Number
    lines: Number
    periods: Number = 2
    q_amplitude: Number = 0.0
    S_amplitude: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Push:
    """Push the joint, where the plant can be pushed by command (the simulator)."""

    do: Literal["push"]
    F_push: Number
    duration_s: Number
    shape: Literal["step", "ramp", "smooth"] = "step"


@validated(frozen=True, kw_only=True, config=_STRICT)
class Hand:
    """Push like a person: smooth, of different strength, length and direction; the same seed gives the same pushes."""

    do: Literal["hand"]
    F_push: Number
    pushes: Number
    pause_s: Number
    seed: Number = 0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Load:
    """Load the motors' shafts, where the plant can (the simulator)."""

    do: Literal["load"]
    duration_s: Number
    load_A: Number = 0.0
    load_B: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Tuning:
    """Change parts of the tuning, its bank or the motion, from the next part on; what is not named stays.

    ``u_plan`` without ``motion`` chooses ``time-optimal``, 0 chooses ``lambda``.
    """

    do: Literal["tuning"]
    lam_q: Number | None = None
    lam_S: Number | None = None
    lam_motor: Number | None = None
    b: Number | None = None
    bank: Number | None = None
    interpolate: bool | None = None
    motion: Literal["lambda", "time-optimal"] | None = None
    u_plan: Number | None = None
    k_ext: Number | None = None


@validated(frozen=True, kw_only=True, config=_STRICT)
class Wall:
    """Put a wall in the joint's way from the next motion on, where the plant takes one (the simulator).

    It stands ``above`` q_wall, or ``below`` it; ``k_wall`` [N/m] and ``c_wall`` [s/m] count at the joint pulley.
    """

    do: Literal["wall"]
    q_wall: Number
    side: Literal["above", "below"] = "above"
    k_wall: Number = 20000.0
    c_wall: Number = 1.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class NoWall:
    """Take the wall away from the next motion on."""

    do: Literal["no_wall"]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Learn:
    """Stay at rest: what the outside force reads there is taken off from then on, for this experiment alone."""

    do: Literal["learn"]
    duration_s: Number = 2.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class UntilContact:
    """Play parts until an outside force above ``contact_N`` (0: none) is felt; it gives way for their rest."""

    do: Literal["until_contact"]
    contact_N: Number = 1.5
    parts: Annotated[tuple["Part", ...], Field(min_length=1)]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Choose:
    """Play the parts under the value of the setting ``by``."""

    do: Literal["choose"]
    by: Name
    of: Mapping[str, tuple["Part", ...]]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Repeat:
    """Play parts so many times; ``index`` counts from 0 in their expressions."""

    do: Literal["repeat"]
    times: Number
    parts: Annotated[tuple["Part", ...], Field(min_length=1)]
    index: Name = "i"


Motion = Hold | Step | Ramp | Pulse | Sine | Sweep | Prbs | Multisine | Push | Hand | Load | Learn
Part = Annotated[Motion | Tuning | Wall | NoWall | Choose | Repeat | UntilContact, Field(discriminator="do")]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Declared:
    """A setting of an experiment. ``unit`` is SI, "1" for counts; a choice is one of ``choices``."""

    name: Name
    kind: Literal["number", "integer", "choice", "boolean"] = "number"
    symbol: Line
    unit: Line = "1"
    meaning: Line
    default: bool | Number
    minimum: Number | None = None
    maximum: Number | None = None
    choices: tuple[Line, ...] = ()


@validated(frozen=True, kw_only=True, config=_STRICT)
class Section:
    """A named stretch of an experiment; the report draws each, and figures may be of one."""

    name: Name
    title: Line
    parts: Annotated[tuple[Part, ...], Field(min_length=1)]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Rule:
    """A comparison of settings that has to hold, "S_low < S_high", and what to do where it does not."""

    that: Annotated[str, Field(max_length=200)]
    remedy: Line


@validated(frozen=True, kw_only=True, config=_STRICT)
class Bound:
    """A figure of the result that has to stay below or above a bound, for the run to pass.

    The bound may also name figures of the plant and the tuning: u_max [V], F_max [N], r_j, r_m [m], lam_q, lam_S,
    lam_motor [s], and ``ideal``, true of the parameter set of that name. ``name`` is what programs call it, that of the
    figure where none is given.
    """

    figure: Name
    name: Name | None = None
    below: Number | None = None
    above: Number | None = None
    title: Line = ""


@validated(frozen=True, kw_only=True, config=_STRICT)
class Experiment:
    """An experiment. ``law`` is the control law that it runs under, or the setting that chooses it."""

    format: Literal[1]
    name: Name
    title: Title
    description: Words = ""
    law: Name = "cascade"
    settings: Annotated[tuple[Declared, ...], Field(max_length=40)] = ()
    rules: tuple[Rule, ...] = ()
    phases: Annotated[tuple[Section, ...], Field(min_length=1, max_length=100)]
    measures: tuple[Measure, ...] = (Measure.STEPS,)
    criteria: Annotated[tuple[Bound, ...], Field(max_length=50)] = ()


EXPERIMENT: TypeAdapter[Experiment] = TypeAdapter(Experiment)


def build_json_schema() -> dict[str, Any]:
    """Return the JSON schema of an experiment, for editors and for whoever writes one by a program."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **EXPERIMENT.json_schema()}
