"""``sinew rig``: check, bring-up, tare and calibration at a terminal."""

import asyncio
import os
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli.experiments import current_user
from backend.cli.options import (
    CardAddress,
    DataFolder,
    ParameterSet,
    PlantName,
    Recording,
    StationName,
    VirtualCard,
    WiringFile,
    database_of,
    load_settings,
)
from backend.cli.output import AsJson, angle_unit, errors, fail, out, print_json, print_table
from backend.commissioning import ALTERNATIVES, FURTHER_WEIGHTS, STEP, STEPS, StepId
from backend.plain_text import as_line
from backend.settings import Settings
from backend.units import format_angles, read, reading_of, with_unit
from plant import SinewError

if TYPE_CHECKING:
    from backend.commissioning import CommissioningSession, StepStatus
    from backend.storage import Database, StoredStepResult
    from plant import CheckFinding, Raw


# Asking --------------------------------------------------------------------------------------------
#
# A person at the terminal: asked in words on standard error, answering with a line.


GIVE_UP = "q"


class GivenUpError(SinewError):
    """The person does not go on, or there are no answers left."""


class Terminal:
    """Lines from standard input. Belongs to one asyncio event loop.

    They are read by a thread of their own, straight from the descriptor: the wait for a line can be given up then, and
    the thread holds no lock when the program ends.
    """

    def __init__(self) -> None:
        self._answers: asyncio.Queue[str | None] = asyncio.Queue()
        self._typed = sys.stdin.isatty()
        self._ended = False
        threading.Thread(target=self._read, args=(asyncio.get_running_loop(),), daemon=True).start()

    async def confirmed(self, words: str) -> None:
        """Ask for something to be done, and wait until it is confirmed. Raises GivenUpError."""
        await self.answer(f"{words}.", "Enter when done")

    async def answer(self, words: str, how: str) -> str:
        """Ask, and return the line that is typed from now on. Raises GivenUpError."""
        while self._typed and not self._answers.empty():  # an Enter of before confirms nothing, an end stays one
            self._ended = self._answers.get_nowait() is None or self._ended
        say(f"  > {words} [{how}, {GIVE_UP} to give up]")
        answer = None if self._ended else await self._answers.get()
        if answer is None:
            self._ended = True
            raise GivenUpError("no answer: standard input has come to its end")
        if answer.lower() == GIVE_UP:
            raise GivenUpError("given up")
        return answer

    def phase(self, name: str) -> None:
        """Tell what goes on."""
        say(f"    {name} …", style="dim")

    def _read(self, loop: asyncio.AbstractEventLoop) -> None:
        rest = b""
        with suppress(RuntimeError):  # of an event loop that has ended
            with suppress(OSError):  # of a terminal that is gone
                while part := os.read(sys.stdin.fileno(), 4096):
                    *lines, rest = (rest + part).split(b"\n")
                    for line in lines:
                        loop.call_soon_threadsafe(self._answers.put_nowait, line.decode(errors="replace").strip())
            loop.call_soon_threadsafe(self._answers.put_nowait, None)


def say(words: str, style: str = "") -> None:
    """Print on standard error, angles as they are read."""
    errors.print(format_angles(words, angle_unit()), style=style, highlight=False, markup=False, soft_wrap=True)


# Rig check -----------------------------------------------------------------------------------------
#
# ``sinew rig check``: whether a wiring file can be used, all that is wrong with it at once.


def check(
    wiring: WiringFile = None,
    open_card: Annotated[
        bool, typer.Option("--open", help="Open the card too, at zero volts with the drives off, and read it once.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check a wiring file: channels, calibrations, units, each mistake with its line and remedy; exit 1 for one.

    Signs and swapped wires cannot be told from a file: the bring-up's wiring test and direction step find them.
    """
    from plant import WiringError, load_wiring

    try:
        found = load_wiring(load_settings(wiring=wiring).wiring)
    except WiringError as error:
        if as_json:
            print_json({"problems": [problem._asdict() for problem in error.problems]})
        fail(*error.sentences)
    read = _read_once(load_settings(wiring=wiring).wiring) if open_card else None
    if as_json:
        print_json({"wiring": found.title, "problems": []} | ({} if read is None else {"read": read._asdict()}))
        return
    title = as_line(found.title)
    print(f"{title}: channels, units and calibrations are in order")
    if read is not None:
        counts = f"{read.n_q:g}, {read.n_A:g}, {read.n_B:g}"
        print(f"{title}: {read.V_A:.4f} V, {read.V_B:.4f} V; counts {counts}")
        tripped, held = "tripped" if read.tripped else "not tripped", "held" if read.at_end else "free"
        print(f"safety module {tripped}, end switch {held}")
    else:
        print("Signs and swapped wires show in the bring-up: its wiring test and direction step name the entry")


def _read_once(wiring: str) -> "Raw":
    from plant import PlantChoice, PlantKind, load_wiring_choice, require_available

    choice = PlantChoice(PlantKind.RIG, wiring=wiring)
    require_available(choice)
    from plant import Daq

    daq = Daq(load_wiring_choice(choice))
    try:
        daq.open()
        return daq.read()
    finally:
        daq.close()


# Rig steps -----------------------------------------------------------------------------------------
#
# Playing steps of the bring-up at a terminal, and telling how they stand.


_STANDS = {"never": "to do", "current": "done", "out_of_date": "out of date", "failed": "failed"}
"""The page's words."""


@dataclass(frozen=True)
class StepRequest:
    """A step to be played: its numbers, None where the terminal asks for them, and the load cells it is about."""

    step: StepId
    values: dict[str, float] | None = None
    cells: str = "AB"


def require_rig(settings: Settings) -> None:
    """End the command where there is nothing to bring up. Raises PlantError where what a card needs is missing."""
    from plant import PlantKind, require_available

    choice = settings.plant_choice
    if choice.kind not in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
        fail(
            f"a rig is brought up; what is driven here is the {choice.name}: say --plant rig, "
            "and --virtual-card to practise without one"
        )
    require_available(choice)


def _states_at_rest(settings: Settings, database: "Database") -> "dict[StepId, StepStatus]":
    """How the steps stand while no loop runs: whatever a loop before has counted from is lost."""
    from datetime import UTC, datetime

    from backend.commissioning import status as standing
    from plant import load_wiring_choice

    return standing.determine_statuses(
        standing.load_results(database), load_wiring_choice(settings.plant_choice), datetime.now(UTC)
    )


def not_done(settings: Settings) -> list[StepId]:
    """Return what is to be done; the zero, which no loop leaves to the next, by hand and only where it is needed."""
    from backend.commissioning import StepState

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
        _show_steps(_standing_of(settings, _states_at_rest(settings, database), database), as_json=as_json)


def play(settings: Settings, orders: Sequence[StepRequest], *, as_json: bool) -> None:
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
    _show_steps(stands, as_json=as_json)
    if stands.ended:
        fail(stands.ended)


def _require_free(settings: Settings, database: "Database", orders: Sequence[StepRequest]) -> None:
    """Refuse before any card is opened."""
    from backend.commissioning import find_blocking_steps

    first = STEP[orders[0].step]
    blocked = find_blocking_steps(first, _states_at_rest(settings, database))
    if blocked:
        fail(f"{first.title}: {blocked}; sinew rig bring-up plays all that is to be done")


async def _played(settings: Settings, database: "Database", orders: Sequence[StepRequest]) -> "_BringUp":
    from backend.banks import build_tuning_command, default_tuning_choice
    from backend.commissioning import BlockedError, OperatorDialog, find_completed_commissioning, open_session
    from backend.realtime import Setup
    from plant import load_parameters

    choice, parameters = settings.plant_choice, load_parameters(settings.params)
    # No law above the motor loops plays here; the tuning in force is the service's matter.
    tuning = build_tuning_command(parameters, default_tuning_choice(parameters).choice, None)
    setup = Setup(choice, settings.params, 0, tuning, find_completed_commissioning(database, choice))
    terminal = Terminal()
    person = OperatorDialog(current_user(), terminal.confirmed, terminal.phase)
    say(f"{choice.name}, {choice.wiring}. Ctrl-C at any time: zero volts; what has not ended is not kept.")
    if choice.simulated:
        say("Nothing real moves: at each Enter the program's own hand does what is asked for.")
    try:
        await terminal.confirmed("Take your hands off the rig: the loop starts, and the drives come on at zero volts")
    except GivenUpError as why:
        fail(str(why))
    ended = ""
    async with open_session(database, setup, parameters, person) as at_rig:
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
        states, locked, lockout_problem = at_rig.states(), at_rig.supervisor.setup.drives_off, at_rig.lockout_problem
    if lockout_problem:
        say(lockout_problem, style="red")
    elif locked:
        say("The drives stay off where the rig is driven next, until somebody there switches them on.")
    if any(order.step in ALTERNATIVES for order in orders):
        say("The zero ends with this command's loop: set it again where the rig is driven next.")
    return _standing_of(settings, states, database, ended)


async def _one(at_rig: "CommissioningSession", terminal: Terminal, order: StepRequest) -> "StoredStepResult":
    step = order.step
    say(f"\n{STEP[step].title}", style="bold")
    say(f"  {STEP[step].instruction}")
    at_rig.require_startable(step)
    result = await at_rig.run(step, order.values or await _numbers(terminal, step), order.cells)
    say(f"  {'passed' if result.passed else 'FAILED'}: {result.text}", style="green" if result.passed else "red")
    for figure in result.figures:
        say(f"    {figure['words']}: {_read(figure['value'], figure['unit'])}")
    return result


async def _numbers(terminal: Terminal, step: StepId) -> dict[str, float]:
    """Ask for the numbers of a step until they are good."""
    from backend.commissioning import collect_values
    from backend.errors import InvalidValueError

    while True:
        try:
            typed = {
                wanted.name: await terminal.answer(f"{wanted.words} [{wanted.unit}]", f"Enter for {wanted.default:g}")
                for wanted in STEP[step].inputs
            }
            return collect_values(step, {name: float(word) for name, word in typed.items() if word})
        except InvalidValueError as refused:
            say(f"  {refused.sentence(angle_unit())}", style="red")
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
    settings: Settings, states: "dict[StepId, StepStatus]", database: "Database", ended: str = ""
) -> _BringUp:
    from backend.commissioning import status as standing

    results = standing.load_newest_results(database)
    steps = tuple(
        _Step(
            id=step.id,
            title=step.title,
            state=states[step.id].state,
            why=states[step.id].why,
            blocked=standing.find_blocking_steps(step, states),
            result=_result(results.get(step.id)),
        )
        for step in STEPS
        if step.id in states
    )
    return _BringUp(settings.plant_choice.name, settings.wiring, steps, ended)


def _result(result: "StoredStepResult | None") -> _Result | None:
    return None if result is None else _Result(result.passed, result.text, result.figures, result.who, result.at)


def _show_steps(bring_up: _BringUp, *, as_json: bool) -> None:
    if as_json:
        print_json(asdict(bring_up))
        return
    rows = []
    for step in bring_up.steps:
        done = step.result
        who, at = (done.who, f"{done.at.astimezone():%Y-%m-%d %H:%M}") if done else ("", "")
        rows.append((step.id, _STANDS[step.state], who, at, format_angles(step.why, angle_unit())))
    print_table(("step", "stands", "by", "on", "because"), rows)


def _read(value: float | None, unit: str) -> str:
    if value is None:
        return "not measured"
    return with_unit(f"{read(value, unit, angle_unit()):.4g}", reading_of(unit, angle_unit()).unit)


# Rig bring up --------------------------------------------------------------------------------------
#
# ``sinew rig bring-up``, ``tare`` and ``calibrate``: the steps of the page Bring-up, at a terminal.


class LoadCellChoice(StrEnum):
    """Which load cells are calibrated."""

    A = "A"
    B = "B"
    BOTH = "AB"


def bring_up(
    step: Annotated[
        list[StepId] | None,
        typer.Option(
            "--step", help="Play this step; repeatable, in their order. [all that are not done or out of date]"
        ),
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="Only tell how the steps stand; nothing is started.")] = False,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Bring a rig up, guided: small steps at low voltage, each kept with date and person; exit 1 where one fails.

    Each step says what to do at the rig and waits for Enter; Ctrl-C ends it at zero volts, and nothing is kept of a
    step that has not ended; but directions whose trial is given up are not proven any more.
    On the virtual card the program's own hand does what is asked for, and answers may come from a pipe, a line each.
    """
    settings = load_settings(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        params=params,
        data=data,
        station=station,
    )
    require_rig(settings)
    wanted = [found.id for found in STEPS if found.id in step] if step else not_done(settings)
    if listed or not wanted:
        show(settings, as_json=as_json)
    else:
        play(settings, [StepRequest(found) for found in wanted], as_json=as_json)


def tare(
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Take 1 s of both load cells without load as their zeros; needs a wiring test of this wiring."""
    settings = load_settings(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        params=params,
        data=data,
        station=station,
    )
    require_rig(settings)
    play(settings, [StepRequest(StepId.TARE)], as_json=as_json)


def calibrate(
    weight: Annotated[list[float], typer.Option("--weight", help="Known weight [N]; two or more, 5 N apart at least.")],
    load_cell: Annotated[
        LoadCellChoice, typer.Option("--load-cell", help="Which load cell, or both in turn.")
    ] = LoadCellChoice.BOTH,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate load cells with known weights, the best line through them; needs a wiring test of this wiring.

    Calibration counts as done once both load cells have been calibrated with this wiring.
    """
    from backend.commissioning import collect_values

    most = 2 + len(FURTHER_WEIGHTS)
    if not 2 <= len(weight) <= most:
        fail(f"--weight: two known weights at least, and {most} at most; {len(weight)} given", status=2)
    lightest, *between, heaviest = sorted(weight)
    names = ["weight_1_N", "weight_2_N", *(more.name for more in FURTHER_WEIGHTS)]
    values = collect_values(StepId.CALIBRATE, dict(zip(names, (lightest, heaviest, *between), strict=False)))
    settings = load_settings(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        params=params,
        data=data,
        station=station,
    )
    require_rig(settings)
    play(settings, [StepRequest(StepId.CALIBRATE, values, load_cell)], as_json=as_json)


# Rig -----------------------------------------------------------------------------------------------
#
# ``sinew rig``.


app = typer.Typer(help="Look at what is driven, and bring it up.", no_args_is_help=True, rich_markup_mode=None)
app.command()(check)
app.command()(bring_up)
app.command()(tare)
app.command()(calibrate)

STEPPED_VOLTAGE = 0.5
"""What is put on the outputs where nothing real moves [V]."""


@app.command()
def conformance(
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    recording: Recording = None,
    params: ParameterSet = None,
    voltage: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=2.0,
            help="Largest voltage [V] a check may put on a motor, for 0.3 s. [0; 0.5 where nothing real moves]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check a plant against the contract that the loop relies on; exit 1 when it does not keep it."""
    from plant import CheckOutcome, PlantKind, Replay, Subject, load_parameters, make_plant, run_contract

    settings = load_settings(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        recording=recording,
        params=params,
    )
    choice, parameters = settings.plant_choice, load_parameters(settings.params)
    first = make_plant(choice, parameters, 0)
    if choice.kind is PlantKind.RIG:
        _require_hands_off()
    allowed = voltage if voltage is not None else STEPPED_VOLTAGE if first.stepped else 0.0
    subject = Subject(lambda: make_plant(choice, parameters, 0), parameters, allowed)
    if isinstance(first, Replay):
        subject = replace(subject, answers=False, lasts=first.samples)
    findings = []
    for finding in run_contract(subject):
        findings.append(finding)
        if not as_json:
            _show(finding)
    broken = [finding for finding in findings if finding.outcome is CheckOutcome.BROKEN]
    if as_json:
        print_json({"plant": choice.name, "findings": [asdict(finding) for finding in findings]})
    if broken:
        fail(f"{choice.name}: {len(broken)} of {len(findings)} promises are not kept")
    errors.print(f"{choice.name}: keeps what a plant promises", highlight=False, markup=False)


def _require_hands_off() -> None:
    """End the command but for a person at the rig: the drives come on, also where a service keeps them off."""
    if not sys.stdin.isatty():
        fail("standard input is no terminal: a person at the rig has to say that no hand is in it; the drives come on")
    typer.confirm("Its drives come on. Has everybody taken their hands off the rig?", abort=True, err=True)


def _show(finding: "CheckFinding") -> None:
    seen = f"\n           {finding.seen}" if finding.seen else ""
    out.print(f"{finding.outcome:9}  {finding.sentence}{seen}", highlight=False, markup=False, soft_wrap=True)
