"""Document of an experiment, in the form that people write and that is stored and sent.

Angles in rad, stiffness in N·m/rad, forces in N, times in s. Each number may also be an expression, a text such as "2 *
hold_s", of the experiment's settings, pi, and the indices of enclosing repetitions.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass as validated

from backend.plain_text import ONE_LINE

FORMAT = 1
"""Version of this document format; others are rejected."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}$")]
Words = Annotated[str, Field(max_length=1000)]
Line = Annotated[str, Field(max_length=1000), ONE_LINE]
Title = Annotated[str, Field(min_length=1, max_length=100), ONE_LINE]
Number = int | float | Annotated[str, Field(max_length=200)]

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class Measure(StrEnum):
    """A measure: a group of metrics computed for a run."""

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
    """Hold the references."""

    do: Literal["hold"]
    duration_s: Number


@validated(frozen=True, kw_only=True, config=_STRICT)
class Step:
    """Step to the given references and hold them; ``F_push`` pushes the joint meanwhile."""

    do: Literal["step"]
    duration_s: Number
    q_ref: Number | None = None
    S_ref: Number | None = None
    F_push: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Ramp:
    """Ramp linearly to the given references, and the push to ``F_push``."""

    do: Literal["ramp"]
    duration_s: Number
    q_ref: Number | None = None
    S_ref: Number | None = None
    F_push: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Pulse:
    """Step to the given references for ``duration_s`` and back for ``rest_s``."""

    do: Literal["pulse"]
    duration_s: Number
    rest_s: Number
    q_ref: Number | None = None
    S_ref: Number | None = None


@validated(frozen=True, kw_only=True, config=_STRICT)
class Sine:
    """Oscillate around the current references, with an amplitude or with ``q_ref`` and ``S_ref`` at the crest.

    The push oscillates around the previous one, with ``F_push`` at the crest.
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
    """Oscillate with a frequency that changes exponentially from one value to another."""

    do: Literal["sweep"]
    duration_s: Number
    from_Hz: Number
    to_Hz: Number
    q_amplitude: Number = 0.0
    S_amplitude: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Prbs:
    """Switch between two levels by a maximum-length sequence of a shift register with ``bits``, ``periods`` times."""

    do: Literal["prbs"]
    chip_s: Number
    bits: Number
    periods: Number = 1
    q_amplitude: Number = 0.0
    S_amplitude: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Multisine:
    """Sum of the first ``lines`` harmonics of ``period_s`` with equal amplitudes; the amplitude is that of the sum."""

    do: Literal["multisine"]
    period_s: Number
    lines: Number
    periods: Number = 2
    q_amplitude: Number = 0.0
    S_amplitude: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Push:
    """Push the joint, on plants that support it (simulated plants)."""

    do: Literal["push"]
    F_push: Number
    duration_s: Number
    shape: Literal["step", "ramp", "smooth"] = "step"


@validated(frozen=True, kw_only=True, config=_STRICT)
class Hand:
    """Push like a person: random strength, length and direction, determined by the seed."""

    do: Literal["hand"]
    F_push: Number
    pushes: Number
    pause_s: Number
    seed: Number = 0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Load:
    """Load the motor shafts, on plants that support it (simulated plants)."""

    do: Literal["load"]
    duration_s: Number
    load_A: Number = 0.0
    load_B: Number = 0.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class Tuning:
    """Change settings of the tuning from the next motion on; omitted settings do not change.

    ``u_plan`` without ``motion`` selects ``time-optimal``; 0 selects ``lambda``.
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
    """Add an obstacle from the next motion on, on plants that support it (simulated plants).

    The obstacle is ``above`` or ``below`` q_wall; ``k_wall`` [N/m] and ``c_wall`` [s/m] apply at the joint pulley.
    """

    do: Literal["wall"]
    q_wall: Number
    side: Literal["above", "below"] = "above"
    k_wall: Number = 20000.0
    c_wall: Number = 1.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class NoWall:
    """Remove the obstacle from the next motion on."""

    do: Literal["no_wall"]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Learn:
    """Rest and calibrate the bias of the external force, for this experiment only."""

    do: Literal["learn"]
    duration_s: Number = 2.0


@validated(frozen=True, kw_only=True, config=_STRICT)
class UntilContact:
    """Execute parts until the external force exceeds ``contact_N`` (0: never), then comply for their remaining time."""

    do: Literal["until_contact"]
    contact_N: Number = 1.5
    parts: Annotated[tuple["Part", ...], Field(min_length=1)]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Choose:
    """Execute the parts for the value of the setting ``by``."""

    do: Literal["choose"]
    by: Name
    of: Mapping[str, tuple["Part", ...]]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Repeat:
    """Execute parts ``times`` times; ``index`` counts from 0 in their expressions."""

    do: Literal["repeat"]
    times: Number
    parts: Annotated[tuple["Part", ...], Field(min_length=1)]
    index: Name = "i"


Motion = Hold | Step | Ramp | Pulse | Sine | Sweep | Prbs | Multisine | Push | Hand | Load | Learn
Part = Annotated[Motion | Tuning | Wall | NoWall | Choose | Repeat | UntilContact, Field(discriminator="do")]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Declared:
    """A setting of an experiment. ``unit`` is an SI unit, "1" for counts; ``choices`` are the values of a choice."""

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
    """A named phase of an experiment; reports plot each phase, and metrics may refer to one."""

    name: Name
    title: Line
    parts: Annotated[tuple[Part, ...], Field(min_length=1)]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Rule:
    """A condition on settings, such as "S_low < S_high", and the remedy if it does not hold."""

    that: Annotated[str, Field(max_length=200)]
    remedy: Line


@validated(frozen=True, kw_only=True, config=_STRICT)
class Bound:
    """A criterion: a metric with a lower or upper bound.

    The bound may also use the plant and tuning: u_max [V], F_max [N], r_j, r_m [m], lam_q, lam_S, lam_motor [s], and
    ``ideal``, true for the parameter set of that name. ``name`` identifies the criterion in programs, by default the
    name of the metric.
    """

    figure: Name
    name: Name | None = None
    below: Number | None = None
    above: Number | None = None
    title: Line = ""


@validated(frozen=True, kw_only=True, config=_STRICT)
class Experiment:
    """An experiment; ``law`` is its control law, or the setting that selects it."""

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
    """Return the JSON schema of an experiment, for editors and programs."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **EXPERIMENT.json_schema()}
