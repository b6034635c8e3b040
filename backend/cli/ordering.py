"""What ``experiment`` and ``identify`` share: settings from words, a headless run, its result on the screen."""

import asyncio
import getpass
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from backend.cli.output import angles, errors, fail, meter, out, print_json
from backend.cli.place import database_of, parameters_in_force
from backend.cli.run_tables import show_run
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.execution.runner import Order, Outcome
    from backend.experiments.plans import LoopSettings
    from backend.models.settings import Setting
    from backend.operating.kept_figures import KeptFigures
    from backend.reports.model import Source
    from plant.parameters import PlantParameters

_Plan = TypeVar("_Plan")


@dataclass(frozen=True)
class _Played:
    """How an order went, all that is stored of it, and the files that were written."""

    outcome: "Outcome"
    source: "Source"
    files: tuple[Path, ...]

    def document(self) -> dict[str, Any]:
        """Return what a program wants to know of it."""
        from backend.reports.build import metrics_document

        return {**metrics_document(self.source), "files": [str(path) for path in self.files]}


class _Play(Protocol):
    def __call__(self, order: "Order", folder: Path | None, *, hidden: bool, own_folder: bool = False) -> _Played: ...


def values_of(words: list[str]) -> dict[str, object]:
    """Return named values from ``key=value`` words; one that is not of that form ends the command."""
    values: dict[str, object] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name:
            fail(f"--set {word}: write key=value, for example --set lam_q=0.6", status=2)
        values[name.strip()] = value.strip()
    return values


@dataclass(frozen=True)
class Standing:
    """A tuning that holds where nothing is said, part by part, and in words where it comes from."""

    parts: dict[str, object]
    origin: str


def ordered(
    settings: "Sequence[Setting]",
    make: "Callable[[Mapping[str, object]], _Plan]",
    values: dict[str, object],
    standing: Standing,
) -> "tuple[_Plan, LoopSettings, str]":
    """Return a plan that has ``settings`` and is made by ``make``, and loop settings: what is said, else what stands.

    The text says of each part of the tuning where it comes from. Raises SettingError, OutOfRangeError.
    """
    from backend.experiments.plans import split_values
    from backend.models.run import with_motion

    values = with_motion(values)
    chosen, loop = split_values(settings, make, {**standing.parts, **values})
    parts = [f"{text} ({'set' if name in values else standing.origin})" for name, text in loop.parts_in_words().items()]
    return chosen, loop, f"tuning: {', '.join(parts)}"


def in_force(settings: Settings) -> Standing:
    """Return the tuning that the dashboard left in force for this plant; the defaults where none can be used."""
    from backend.banks import tuning_settings
    from backend.errors import OutOfRangeError
    from backend.models.document import UnreadableDocumentError
    from backend.models.settings import SettingError

    _figures().restore()
    with database_of(settings, reading=True) as database:
        parameters = parameters_in_force(settings, database)
        try:
            kept = tuning_settings.newest_tuning(database, parameters)
        except (SettingError, OutOfRangeError, UnreadableDocumentError) as error:
            errors.print(f"defaults: the tuning in force is refused, {error}", highlight=False, markup=False)
            return _defaults(parameters)
    if kept is None:
        return _defaults(parameters)
    if not kept.same_plant:
        errors.print("defaults: the tuning in force is for other parameters of the plant", highlight=False)
        return _defaults(parameters)
    return Standing(kept.choice.document(), "in force")


def _defaults(parameters: "PlantParameters") -> Standing:
    from backend.banks.tuning_settings import default_choice

    default = default_choice(parameters)
    if default.moved:
        errors.print(default.moved, highlight=False, markup=False, soft_wrap=True)
    return Standing(default.choice.document(), "default")


Together = Callable[[Sequence["Source"]], tuple[dict[str, Any], str]]
"""What runs say together: entries for the document of each, and a line for people."""


def run_headless(
    settings: Settings,
    order: "Order",
    tuning: str,
    folder: Path | None,
    *,
    as_json: bool,
    together: Together | None = None,
) -> None:
    """Play an order on the simulator, store it, and show what came of it; exit 1 when it did not complete."""
    with _bench(settings, order) as play:
        _say(tuning, as_json=as_json)
        played = play(order, folder, hidden=as_json)
        entries, line = together([played.source]) if together else ({}, "")
        if as_json:
            print_json(played.document() | entries)
        else:
            show_run(played.source, played.files)
            _say_line(line)
    _end_status(played.outcome)


def run_in_turn(
    settings: Settings,
    orders: "Sequence[Order]",
    tuning: str,
    folder: Path | None,
    *,
    as_json: bool,
    together: Together | None = None,
) -> None:
    """Play orders one after the other, files in a folder per run; one that does not complete ends the sequence."""
    documents, sources = [], []
    with _bench(settings, orders[0]) as play:
        _say(tuning, as_json=as_json)
        for order in orders:
            played = play(order, folder, hidden=as_json, own_folder=True)
            documents.append(played.document())
            sources.append(played.source)
            if not as_json:
                show_run(played.source, played.files)
            if played.outcome.run.end_state != "completed" or played.outcome.evaluation.problem:
                break
    entries, line = together(sources) if together else ({}, "")
    if as_json:
        print_json([document | entries for document in documents])
    else:
        _say_line(line)
    _end_status(played.outcome)


@contextmanager
def _bench(settings: Settings, first: "Order") -> "Iterator[_Play]":
    """Open database and simulator, both set for ``first``, and give what plays an order there."""
    from backend.data_folder import playing_in
    from backend.execution.runner import run_experiment
    from backend.execution.simulation import headless_station
    from backend.reports.model import load_source

    with (
        database_of(settings) as database,
        playing_in(settings.data),
        headless_station(
            database, parameters_in_force(settings, database), first.loop_settings, settings.plant_choice
        ) as station,
    ):

        def play(order: "Order", folder: Path | None, *, hidden: bool, own_folder: bool = False) -> _Played:
            with meter(order.plan.program().duration_s, hidden=hidden) as progress:
                outcome = asyncio.run(run_experiment(station, order, progress))
            into = folder / f"run-{outcome.run.id}" if folder and own_folder else folder
            written: tuple[Path, ...] = ()
            if into:
                from backend.reports.build import write_files  # draws, for which most runs need not wait

                written = write_files(database, outcome.run.id, into, angles())
            return _Played(outcome, load_source(database, outcome.run.id), written)

        yield play
    _figures().keep()


@cache
def _figures() -> "KeptFigures":
    """Return what commands before, and the service, have computed for a tuning."""
    from backend.operating.kept_figures import KeptFigures

    return KeptFigures()


def current_user() -> str:
    """Return who runs the command, for the record: the account's name, or its number where it has none."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # KeyError until Python 3.12
        return str(os.getuid())


def _say(tuning: str, *, as_json: bool) -> None:
    """Say what the gains come from, once it is accepted."""
    if not as_json:
        out.print(tuning, highlight=False, markup=False, soft_wrap=True)


def _say_line(line: str) -> None:
    if line:
        out.print(line, highlight=False, markup=False, soft_wrap=True)


def _end_status(outcome: "Outcome") -> None:
    from backend.storage.runs import EndState

    if outcome.run.end_state != EndState.COMPLETED:
        fail(f"run {outcome.run.id} {outcome.run.end_state}: {outcome.run.end_detail or 'no further reason known'}")
    if outcome.evaluation.problem:
        fail(f"run {outcome.run.id}: {outcome.evaluation.problem}", status=2)
