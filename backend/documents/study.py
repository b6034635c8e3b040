"""A study as data: one experiment, simulated many times with other settings, another plant, other noise. Pure.

A name without a dot is a setting of the experiment or of the loop; one with a dot is a number of the plant, such as
``motor.c0`` or, of a row of numbers, ``spring.k.0``. All numbers in SI.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass as validated

from backend.documents.experiment import Experiment, Name, Title, Words
from backend.models.run import Value

FORMAT = 1
"""Version of this form; another one is refused."""

POINTS_MAX = 100_000
"""Runs of one study, at most."""

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
Number = int | float
Varied = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}(\.[A-Za-z0-9_]{1,40}){0,2}$")]


@validated(frozen=True, kw_only=True, config=_STRICT)
class Axis:
    """What is gone through value by value: ``values``, or ``count`` from ``first`` to ``last``.

    ``spacing`` even: equal differences; factor: equal ratios.
    """

    over: Varied
    values: Annotated[tuple[Value, ...], Field(max_length=POINTS_MAX)] = ()
    first: Number | None = None
    last: Number | None = None
    count: Annotated[int, Field(ge=2, le=POINTS_MAX)] | None = None
    spacing: Literal["even", "factor"] = "even"


@validated(frozen=True, kw_only=True, config=_STRICT)
class Spread:
    """How a number of the plant is drawn around what it is: by ``relative`` of itself, or by ``absolute``.

    That is the half width of ``uniform``, the standard deviation of ``normal``, which ends at three of them.
    """

    of: Varied
    by: Literal["uniform", "normal"] = "uniform"
    relative: Annotated[float, Field(gt=0.0, le=10.0)] | None = None
    absolute: Annotated[float, Field(gt=0.0)] | None = None


@validated(frozen=True, kw_only=True, config=_STRICT)
class Study:
    """All combinations of the ``axes``, each with all ``draws`` of the plant, each of these with all ``seeds``.

    ``experiment`` is a name, or ``written`` is one. ``seed`` begins the draws; the noise has the seeds from the setting
    ``seed`` on. Every combination meets the same draws and the same noise.
    """

    format: Literal[1]
    name: Name
    title: Title
    description: Words = ""
    experiment: Annotated[str, Field(min_length=1, max_length=60)] = "tracking"
    written: Experiment | None = None
    settings: Mapping[Name, Value] = Field(default_factory=dict)
    axes: Annotated[tuple[Axis, ...], Field(max_length=6)] = ()
    spread: Annotated[tuple[Spread, ...], Field(max_length=40)] = ()
    draws: Annotated[int, Field(ge=1, le=POINTS_MAX)] = 1
    seeds: Annotated[int, Field(ge=1, le=POINTS_MAX)] = 1
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0


STUDY: TypeAdapter[Study] = TypeAdapter(Study)
