"""What the loop is set to while an experiment runs: the tuning, and the seed of the simulator."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TypeVar

from backend.banks.tuning_settings import TuningChoice
from backend.models.settings import Setting, SettingError, from_values, integer

_T = TypeVar("_T")


@dataclass(frozen=True)
class LoopSettings(TuningChoice):
    """The tuning of an experiment and the seed of the simulator's noise."""

    seed: int = integer(0, 0, 2**31 - 1, "seed", "seed of the simulator's noise")

    @property
    def tuning(self) -> TuningChoice:
        """The tuning alone."""
        return TuningChoice(**self.document())


def split_values(
    settings: Sequence[Setting], make: Callable[[Mapping[str, object]], _T], values: Mapping[str, object]
) -> tuple[_T, LoopSettings]:
    """Build a plan that has ``settings``, and loop settings, from one set of named values.

    Raises SettingError, OutOfRangeError.
    """
    of_loop = {item.name for item in fields(LoopSettings)}
    of_plan = {setting.name for setting in settings}
    for name, value in values.items():
        if name not in of_loop | of_plan:
            legal = (*sorted(of_plan), *sorted(of_loop))
            raise SettingError(name, value, f"unknown setting; known are {', '.join(legal)}", legal=legal)
    return (
        make({name: value for name, value in values.items() if name in of_plan}),
        from_values(LoopSettings, {name: value for name, value in values.items() if name in of_loop}),
    )
