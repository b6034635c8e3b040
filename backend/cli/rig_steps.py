"""Playing steps of the bring-up at a terminal, and telling how they stand."""

import asyncio
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

from backend.cli.asking import GivenUpError, Terminal, say
from backend.cli.ordering import current_user
from backend.cli.output import angles, fail, print_json, print_table
from backend.cli.place import database_of
from backend.commissioning.steps import INSTEAD, STEP, STEPS, StepId
from backend.settings import Settings
from backend.units import in_words, read, reading_of, with_unit

if TYPE_CHECKING:
    from backend.commissioning.session import Session
    from backend.commissioning.steps import Standing
    from backend.storage.commissioning import StepResult
    from backend.storage.database import Database

_STANDS = {"never": "to do", "current": "done", "out_of_date": "out of date", "failed": "failed"}
"""The page's words."""


@dataclass(frozen=True)
class Order:
    """A step to be played: its numbers, None where the terminal asks for them, and the load cells it is about."""

    step: StepId
    values: dict[str, float] | None = None
    cells: str = "AB"


def require_rig(settings: Settings) -> None:
    """End the command where there is nothing to bring up. Raises PlantError where what a card needs is missing."""
    from plant.factory import require_available
    from plant.interface import PlantKind

    choice = settings.plant_choice
    if choice.kind not in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
        fail(
            f"a rig is brought up; what is driven here is the {choice.name}: say --plant rig, "
            "and --virtual-card to practise without one"
        )
    require_available(choice)


def _states_at_rest(settings: Settings, database: "Database") -> "dict[StepId, Standing]":
    """How the steps stand while no loop runs: whatever a loop before has counted from is lost."""
    from datetime import UTC, datetime

    from backend.commissioning import steps as standing
    from plant.factory import wiring_of_choice

    return standing.states(standing.kept(database), wiring_of_choice(settings.plant_choice), datetime.now(UTC))


def not_done(settings: Settings) -> list[StepId]:
    """Return what is to be done; the zero, which no loop leaves to the next, by hand and only where it is needed."""
    from backend.commissioning.steps import StepState

    with database_of(settings, reading=True) as database:
        states = _states_at_rest(settings, database)
    by_hand = [step for step in STEPS if step.id in states and step.id is not StepId.HOME]
    missing = [step for step in by_hand if states[step.id].state is not StepState.CURRENT]
    needed = {need for step in missing for need in step.needs}
    never = states[StepId.ZERO].state in (StepState.NEVER, StepState.FAILED)
    return [step.id for step in missing if step.id is not StepId.ZERO or never or StepId.ZERO in needed]


def show(settings: Settings, *, as_json: bool) -> None:
    """Tell how the steps stand; nothing is started."""
    with database_of(settings, reading=True) as database:
        _show(_standing_of(settings, _states_at_rest(settings, database), database), as_json=as_json)


def play(settings: Settings, orders: Sequence[Order], *, as_json: bool) -> None:
    """Play steps in turn, up to the first that fails or is given up: exit 1 then."""
    from backend.data_folder import AlreadyRunningError, address_of_service, only_service_on

    if not settings.plant_choice.simulated and not sys.stdin.isatty():
        fail("standard input is no terminal: a rig is brought up by a person who stands at it and confirms each step")
    try:
        with only_service_on(settings.data), database_of(settings, held=True) as database:
            _require_free(settings, database, orders)
            stands = asyncio.run(_played(settings, database, orders))
    except AlreadyRunningError as error:
        address = address_of_service(settings.data)
        fail(f"{error}" if not address else f"{error}. Or bring the rig up on its page Bring-up at {address}")
    _show(stands, as_json=as_json)
    if stands.ended:
        fail(stands.ended)


def _require_free(settings: Settings, database: "Database", orders: Sequence[Order]) -> None:
    """Refuse before any card is opened."""
    from backend.commissioning.steps import blocked_by

    first = STEP[orders[0].step]
    blocked = blocked_by(first, _states_at_rest(settings, database))
    if blocked:
        fail(f"{first.title}: {blocked}; sinew rig bring-up plays all that is to be done")


async def _played(settings: Settings, database: "Database", orders: Sequence[Order]) -> "_BringUp":
    from backend.banks.builder import tuning_command
    from backend.banks.tuning_settings import default_choice
    from backend.commissioning.session import BlockedError, Person, session
    from backend.commissioning.steps import brought_up_of
    from backend.realtime.ipc import Setup
    from plant.parameters import load_parameters

    choice, parameters = settings.plant_choice, load_parameters(settings.params)
    # No law above the motor loops plays here; the tuning in force is the service's matter.
    tuning = tuning_command(parameters, default_choice(parameters).choice, None)
    setup = Setup(choice, settings.params, 0, tuning, brought_up_of(database, choice))
    terminal = Terminal()
    person = Person(current_user(), terminal.confirmed, terminal.phase)
    say(f"{choice.name}, {choice.wiring}. Ctrl-C at any time: zero volts; what has not ended is not kept.")
    if choice.simulated:
        say("Nothing real moves: at each Enter the program's own hand does what is asked for.")
    try:
        await terminal.confirmed("Take your hands off the rig: the loop starts, and the drives come on at zero volts")
    except GivenUpError as why:
        fail(str(why))
    ended = ""
    async with session(database, setup, parameters, person) as at_rig:
        for order in orders:
            try:
                result = await _one(at_rig, terminal, order)
            except GivenUpError as why:
                ended = f"{why}: nothing of {STEP[order.step].title} was kept"
                break
            except BlockedError as why:
                ended = str(why)
                break
            if not result.passed:
                ended = f"{STEP[order.step].title}: {result.text}"
                break
        states, locked, unkept = at_rig.states(), at_rig.supervisor.setup.drives_off, at_rig.unkept
    if unkept:
        say(unkept, style="red")
    elif locked:
        say("The drives stay off where the rig is driven next, until somebody there switches them on.")
    if any(order.step in INSTEAD for order in orders):
        say("The zero ends with this command's loop: set it again where the rig is driven next.")
    return _standing_of(settings, states, database, ended)


async def _one(at_rig: "Session", terminal: Terminal, order: Order) -> "StepResult":
    step = order.step
    say(f"\n{STEP[step].title}", style="bold")
    say(f"  {STEP[step].instruction}")
    at_rig.require_free(step)
    result = await at_rig.play(step, order.values or await _numbers(terminal, step), order.cells)
    say(f"  {'passed' if result.passed else 'FAILED'}: {result.text}", style="green" if result.passed else "red")
    for figure in result.figures:
        say(f"    {figure['words']}: {_read(figure['value'], figure['unit'])}")
    return result


async def _numbers(terminal: Terminal, step: StepId) -> dict[str, float]:
    """Ask for the numbers of a step until they are good."""
    from backend.commissioning.session import values_of
    from backend.errors import RefusedValueError

    while True:
        try:
            typed = {
                wanted.name: await terminal.answer(f"{wanted.words} [{wanted.unit}]", f"Enter for {wanted.default:g}")
                for wanted in STEP[step].inputs
            }
            return values_of(step, {name: float(word) for name, word in typed.items() if word})
        except RefusedValueError as refused:
            say(f"  {refused.sentence(angles())}", style="red")
        except ValueError as wrong:
            say(f"  {wrong}: type a number", style="red")


@dataclass(frozen=True)
class _Result:
    """What a step came to, as it is printed for programs."""

    passed: bool
    text: str
    figures: Sequence[dict[str, Any]]
    who: str
    at: datetime


@dataclass(frozen=True)
class _Step:
    """How a step stands, and ``why``; what it is ``blocked`` by."""

    id: StepId
    title: str
    state: str
    why: str
    blocked: str
    result: _Result | None


@dataclass(frozen=True)
class _BringUp:
    """How all steps stand; ``ended`` says what ended the command before its end, empty where nothing did."""

    plant: str
    wiring: str
    steps: tuple[_Step, ...]
    ended: str


def _standing_of(
    settings: Settings, states: "dict[StepId, Standing]", database: "Database", ended: str = ""
) -> _BringUp:
    from backend.commissioning import steps as standing

    results = standing.newest(database)
    steps = tuple(
        _Step(
            step.id,
            step.title,
            states[step.id].state,
            states[step.id].why,
            standing.blocked_by(step, states),
            _result(results.get(step.id)),
        )
        for step in STEPS
        if step.id in states
    )
    return _BringUp(settings.plant_choice.name, settings.wiring, steps, ended)


def _result(result: "StepResult | None") -> _Result | None:
    return None if result is None else _Result(result.passed, result.text, result.figures, result.who, result.at)


def _show(bring_up: _BringUp, *, as_json: bool) -> None:
    if as_json:
        print_json(asdict(bring_up))
        return
    rows = []
    for step in bring_up.steps:
        done = step.result
        who, at = (done.who, f"{done.at.astimezone():%Y-%m-%d %H:%M}") if done else ("", "")
        rows.append((step.id, _STANDS[step.state], who, at, in_words(step.why, angles())))
    print_table(("step", "stands", "by", "on", "because"), rows)


def _read(value: float | None, unit: str) -> str:
    if value is None:
        return "not measured"
    return with_unit(f"{read(value, unit, angles()):.4g}", reading_of(unit, angles()).unit)
