"""Commands ``sinew rig``: check a wiring file, commission a rig, test a plant."""

import asyncio
import os
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli import messages
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
    load_settings,
    open_configured_database,
)
from backend.cli.output import AsJson, angle_unit, console, error_console, fail, print_json, print_table
from backend.commissioning import ALTERNATIVES, FURTHER_WEIGHTS, STEP, STEPS, StepId
from backend.plain_text import escape_line
from backend.settings import Settings
from backend.units import append_unit, convert_to_display, get_display_unit
from plant import SinewError

if TYPE_CHECKING:
    from backend.commissioning import CommissioningSession, StepStatus
    from backend.storage import Database, StoredStepResult
    from plant import CheckFinding, Raw


# Terminal ------------------------------------------------------------------------------------------


QUIT_KEY = "q"


class AbandonedError(SinewError):
    """The operator gave up, or standard input has ended."""


class Terminal:
    """Questions on standard error, answered with lines of standard input.

    Belongs to one asyncio event loop. A thread reads the lines from the file descriptor. So the event loop can stop
    waiting for a line, and the thread holds no lock at the end of the program.
    """

    def __init__(self) -> None:
        self._lines: asyncio.Queue[str | None] = asyncio.Queue()  # None marks the end of standard input
        self._is_interactive = sys.stdin.isatty()
        self._ended = False
        threading.Thread(target=self._read_lines, args=(asyncio.get_running_loop(),), daemon=True).start()

    async def confirm(self, instruction: str) -> None:
        """Print an instruction and wait until the operator confirms it.

        Raises AbandonedError.
        """
        await self.ask(f"{instruction}.", messages.enter_when_done())

    async def ask(self, question: str, hint: str) -> str:
        """Print a question and return the next line that is typed. Raises AbandonedError."""
        while self._is_interactive and not self._lines.empty():  # an earlier Enter must not answer this question
            self._ended = self._lines.get_nowait() is None or self._ended
        print_message(f"  > {messages.prompt(question=question, hint=hint, quit_key=QUIT_KEY)}")
        line = None if self._ended else await self._lines.get()
        if line is None:
            self._ended = True
            raise AbandonedError(messages.input_ended())
        if line.lower() == QUIT_KEY:
            raise AbandonedError(messages.given_up())
        return line

    def show_phase(self, name: str) -> None:
        """Print the name of the current phase."""
        print_message(f"    {name} …", style="dim")

    def _read_lines(self, loop: asyncio.AbstractEventLoop) -> None:
        rest = b""
        with suppress(RuntimeError):  # the event loop has ended
            with suppress(OSError):  # the terminal is closed
                while part := os.read(sys.stdin.fileno(), 4096):
                    *lines, rest = (rest + part).split(b"\n")
                    for line in lines:
                        loop.call_soon_threadsafe(self._lines.put_nowait, line.decode(errors="replace").strip())
            loop.call_soon_threadsafe(self._lines.put_nowait, None)


def print_message(text: str, style: str = "") -> None:
    """Print a message with angles in the chosen unit on standard error."""
    error_console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)


# sinew rig check -----------------------------------------------------------------------------------


def check(
    wiring: WiringFile = None,
    open_card: Annotated[
        bool, typer.Option("--open", help="Also open the card with zero volts and disabled drives, and read it once.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check a wiring file; exit 1 with line and remedy of each error.

    This check cannot detect wrong signs or swapped wires; the wiring test and the direction step of the bring-up do.
    """
    from plant import WiringError, load_wiring

    try:
        checked = load_wiring(load_settings(wiring=wiring).wiring)
    except WiringError as error:
        if as_json:
            print_json({"problems": [problem._asdict() for problem in error.problems]})
        fail(*error.sentences)
    raw = _read_card(load_settings(wiring=wiring).wiring) if open_card else None
    if as_json:
        print_json({"wiring": checked.title, "problems": []} | ({} if raw is None else {"read": raw._asdict()}))
        return
    title = escape_line(checked.title)
    print(messages.wiring_valid(wiring=title))
    if raw is not None:
        counts = {"n_q": raw.n_q, "n_A": raw.n_A, "n_B": raw.n_B}
        print(messages.card_reading(wiring=title, V_A=raw.V_A, V_B=raw.V_B, **counts))
        print(messages.card_lines(tripped=raw.tripped, at_end=raw.at_end))
    else:
        print(messages.bring_up_detects_wires())


def _read_card(wiring: str) -> "Raw":
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


# Commissioning steps -------------------------------------------------------------------------------


@dataclass(frozen=True)
class StepRequest:
    """A step to run, with its inputs and the load cells concerned.

    Inputs of None are asked for at the terminal.
    """

    step: StepId
    values: dict[str, float] | None = None
    cells: str = "AB"


def require_rig(settings: Settings) -> None:
    """End the command unless the plant is a rig or a virtual card.

    Raises PlantError if its driver is missing.
    """
    from plant import PlantKind, require_available

    choice = settings.plant_choice
    if choice.kind not in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
        fail(messages.only_for_a_rig(plant=choice.name))
    require_available(choice)


def _derive_step_states(settings: Settings, database: "Database") -> "dict[StepId, StepStatus]":
    """Return the state of each step without a control loop, so without encoder zeros."""
    from backend.commissioning import status
    from plant import load_wiring_choice

    return status.determine_statuses(
        status.load_results(database), load_wiring_choice(settings.plant_choice), datetime.now(UTC)
    )


def list_pending_steps(settings: Settings) -> list[StepId]:
    """Return the steps to do, without homing.

    The zero of the joint is lost with each control loop; it is included only if it was never set or a pending step
    needs it.
    """
    from backend.commissioning import StepState

    with open_configured_database(settings, read_only=True) as database:
        states = _derive_step_states(settings, database)
    candidates = [step for step in STEPS if step.id in states and step.id is not StepId.HOME]
    pending = [step for step in candidates if states[step.id].state is not StepState.CURRENT]
    needed = {need for step in pending for need in step.needs}
    was_never_set = states[StepId.ZERO].state in (StepState.NEVER, StepState.FAILED)
    return [step.id for step in pending if step.id is not StepId.ZERO or was_never_set or StepId.ZERO in needed]


def print_status(settings: Settings, *, as_json: bool) -> None:
    """Print the state of each step without starting anything."""
    with open_configured_database(settings, read_only=True) as database:
        _print_steps(_build_commissioning(settings, _derive_step_states(settings, database), database), as_json=as_json)


def run_steps(settings: Settings, requests: Sequence[StepRequest], *, as_json: bool) -> None:
    """Run steps one after the other until one fails or is abandoned (exit 1)."""
    from backend.data_folder import AlreadyRunningError, lock_for_service, read_service_address

    if not settings.plant_choice.simulated and not sys.stdin.isatty():
        fail(messages.steps_require_terminal())
    try:
        with lock_for_service(settings.data), open_configured_database(settings, owns_folder=True) as database:
            _require_unblocked(settings, database, requests)
            done = asyncio.run(_run_session(settings, database, requests))
    except AlreadyRunningError as error:
        address = read_service_address(settings.data)
        fail(f"{error}" if not address else messages.page_instead(reason=str(error), address=address))
    _print_steps(done, as_json=as_json)
    if done.ended:
        fail(done.ended)


def _require_unblocked(settings: Settings, database: "Database", requests: Sequence[StepRequest]) -> None:
    """End the command, before the card is opened, if the first step is blocked."""
    from backend.commissioning import find_blocking_steps

    first = STEP[requests[0].step]
    blocked = find_blocking_steps(first, _derive_step_states(settings, database))
    if blocked:
        fail(messages.step_blocked(step=first.title, reason=blocked))


async def _run_session(settings: Settings, database: "Database", requests: Sequence[StepRequest]) -> "_Commissioning":
    """Start a control loop, run the steps, and return the state of all steps."""
    from backend.banks import build_tuning_command, compute_default_tuning
    from backend.commissioning import BlockedError, OperatorDialog, find_completed_commissioning, open_session
    from backend.realtime import Setup
    from plant import load_parameters

    choice, parameters = settings.plant_choice, load_parameters(settings.params)
    # Commissioning closes the motor loops only, so the defaults serve; the active tuning belongs to the service.
    tuning = build_tuning_command(parameters, compute_default_tuning(parameters).tuning, None)
    setup = Setup(choice, settings.params, 0, tuning, find_completed_commissioning(database, choice))
    terminal = Terminal()
    dialog = OperatorDialog(current_user(), terminal.confirm, terminal.show_phase)
    print_message(messages.session_begins(plant=choice.name, wiring=choice.wiring))
    if choice.simulated:
        print_message(messages.operator_simulated())
    try:
        await terminal.confirm(messages.keep_clear_of_start())
    except AbandonedError as error:
        fail(str(error))
    ended = ""
    async with open_session(database, setup, parameters, dialog) as session:
        for request in requests:
            try:
                result = await _run_step(session, terminal, request)
            except AbandonedError as error:
                ended = messages.result_not_stored(reason=str(error), step=STEP[request.step].title)
                break
            except BlockedError as error:
                ended = str(error)
                break
            if not result.passed:
                ended = messages.step_failed(step=STEP[request.step].title, result=result.text)
                break
        states, drives_locked, lockout_problem = (
            session.states(),
            session.supervisor.setup.drives_off,
            session.lockout_problem,
        )
    if lockout_problem:
        print_message(lockout_problem, style="red")
    elif drives_locked:
        print_message(messages.drives_stay_disabled())
    if any(request.step in ALTERNATIVES for request in requests):
        print_message(messages.zero_is_lost())
    return _build_commissioning(settings, states, database, ended)


async def _run_step(session: "CommissioningSession", terminal: Terminal, request: StepRequest) -> "StoredStepResult":
    step = request.step
    print_message(f"\n{STEP[step].title}", style="bold")
    print_message(f"  {STEP[step].instruction}")
    session.require_startable(step)
    result = await session.run(step, request.values or await _ask_values(terminal, step), request.cells)
    text = messages.result_of_step(passed=result.passed, result=result.text)
    print_message(f"  {text}", style="green" if result.passed else "red")
    for figure in result.figures:
        print_message(f"    {figure['words']}: {_format_value(figure['value'], figure['unit'])}")
    return result


async def _ask_values(terminal: Terminal, step: StepId) -> dict[str, float]:
    """Ask for the inputs of a step until they are valid, and return them by name."""
    from backend.commissioning import collect_values
    from backend.errors import InvalidValueError

    while True:
        try:
            answers = {
                value.name: await terminal.ask(
                    f"{value.words} [{value.unit}]", messages.enter_for_default(default=value.default)
                )
                for value in STEP[step].inputs
            }
            return collect_values(step, {name: float(answer) for name, answer in answers.items() if answer})
        except InvalidValueError as error:
            print_message(f"  {error.format_message(angle_unit())}", style="red")
        except ValueError as error:
            print_message(f"  {messages.not_a_number(reason=str(error))}", style="red")


@dataclass(frozen=True)
class _StepResult:
    """Result of a step, as in the JSON output."""

    passed: bool
    text: str
    figures: Sequence[dict[str, Any]]
    who: str
    at: datetime


@dataclass(frozen=True)
class _Step:
    """State of a step with the reason ``why``, and what it is ``blocked`` by."""

    id: StepId
    title: str
    state: str
    why: str
    blocked: str
    result: _StepResult | None


@dataclass(frozen=True)
class _Commissioning:
    """State of all steps.

    ``ended`` is the reason for an early end of the command, or empty.
    """

    plant: str
    wiring: str
    steps: tuple[_Step, ...]
    ended: str


def _build_commissioning(
    settings: Settings, states: "dict[StepId, StepStatus]", database: "Database", ended: str = ""
) -> _Commissioning:
    from backend.commissioning import status

    results = status.load_newest_results(database)
    steps = tuple(
        _Step(
            id=step.id,
            title=step.title,
            state=states[step.id].state,
            why=states[step.id].why,
            blocked=status.find_blocking_steps(step, states),
            result=_build_result(results.get(step.id)),
        )
        for step in STEPS
        if step.id in states
    )
    return _Commissioning(settings.plant_choice.name, settings.wiring, steps, ended)


def _build_result(result: "StoredStepResult | None") -> _StepResult | None:
    return None if result is None else _StepResult(result.passed, result.text, result.figures, result.who, result.at)


def _print_steps(commissioning: _Commissioning, *, as_json: bool) -> None:
    if as_json:
        print_json(asdict(commissioning))
        return
    rows = []
    for step in commissioning.steps:
        result = step.result
        who, at = (result.who, f"{result.at.astimezone():%Y-%m-%d %H:%M}") if result else ("", "")
        rows.append((step.id, messages.STEP_STATES[step.state], who, at, step.why))
    print_table(("step", "state", "by", "on", "reason"), rows)


def _format_value(value: float | None, unit: str) -> str:
    if value is None:
        return messages.not_measured()
    return append_unit(
        f"{convert_to_display(value, unit, angle_unit()):.4g}", get_display_unit(unit, angle_unit()).unit
    )


# sinew rig bring-up, tare and calibrate ------------------------------------------------------------


class LoadCellChoice(StrEnum):
    """Load cells to calibrate."""

    A = "A"
    B = "B"
    BOTH = "AB"


def bring_up(
    step: Annotated[
        list[StepId] | None,
        typer.Option(
            "--step", help="Step to run; repeatable. Steps run in their fixed order. [pending steps except homing]"
        ),
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="Only list the state of the steps.")] = False,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Commission a rig step by step at low voltage.

    Each step is stored with date and person. Exit 1 if one fails. Each step prints what to do at the rig and waits for
    Enter. Ctrl+C ends the command at zero volts. An unfinished step stores no result, but a direction test that has
    started a motor is stored as failed. With the virtual card, the simulator performs the actions of the operator, and
    answers may be piped in, one per line.
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
    chosen = [known.id for known in STEPS if known.id in step] if step else list_pending_steps(settings)
    if listed or not chosen:
        print_status(settings, as_json=as_json)
    else:
        run_steps(settings, [StepRequest(one) for one in chosen], as_json=as_json)


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
    """Set the zeros of both load cells from their mean over 1 s without load.

    Requires a passed wiring test of this wiring.
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
    run_steps(settings, [StepRequest(StepId.TARE)], as_json=as_json)


def calibrate(
    weight: Annotated[list[float], typer.Option("--weight", help="Known weight [N]; two or more, at least 5 N apart.")],
    load_cell: Annotated[
        LoadCellChoice, typer.Option("--load-cell", help="Load cell to calibrate, or both one after the other.")
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
    """Calibrate load cells by a line fitted to known weights.

    Requires a passed wiring test of this wiring. The step is complete when both load cells are calibrated.
    """
    from backend.commissioning import collect_values

    most = 2 + len(FURTHER_WEIGHTS)
    if not 2 <= len(weight) <= most:
        fail(messages.wrong_number_of_weights(maximum=most, given=len(weight)), status=2)
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
    run_steps(settings, [StepRequest(StepId.CALIBRATE, values, load_cell)], as_json=as_json)


# sinew rig -----------------------------------------------------------------------------------------


app = typer.Typer(help="The rig: check, commission, calibrate, test.", no_args_is_help=True, rich_markup_mode=None)
app.command()(check)
app.command()(bring_up)
app.command()(tare)
app.command()(calibrate)

SIMULATED_VOLTAGE = 0.5
"""Default motor voltage for the checks of motion on a simulated plant [V]."""


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
            help="Motor voltage [V] for the checks of motion, applied for 0.3 s. [0; 0.5 on a simulated plant]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check that a plant meets the requirements of the plant interface; else exit 1."""
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
    tested = make_plant(choice, parameters, 0)
    if choice.kind is PlantKind.RIG:
        _confirm_drives()
    max_voltage = voltage if voltage is not None else SIMULATED_VOLTAGE if tested.stepped else 0.0
    subject = Subject(lambda: make_plant(choice, parameters, 0), parameters, max_voltage)
    if isinstance(tested, Replay):
        subject = replace(subject, answers=False, lasts=tested.samples)
    findings = []
    for finding in run_contract(subject):
        findings.append(finding)
        if not as_json:
            _print_finding(finding)
    broken = [finding for finding in findings if finding.outcome is CheckOutcome.BROKEN]
    if as_json:
        print_json({"plant": choice.name, "findings": [asdict(finding) for finding in findings]})
    if broken:
        fail(messages.requirements_not_met(plant=choice.name, broken=len(broken), checked=len(findings)))
    error_console.print(messages.requirements_met(plant=choice.name), highlight=False, markup=False)


def _confirm_drives() -> None:
    """Ask for confirmation that the drives may come on.

    They do even if a drive lockout of the service is active.
    """
    if not sys.stdin.isatty():
        fail(messages.drives_require_terminal())
    typer.confirm(messages.confirm_drives(), abort=True, err=True)


def _print_finding(finding: "CheckFinding") -> None:
    seen = f"\n           {finding.seen}" if finding.seen else ""
    console.print(f"{finding.outcome:9}  {finding.sentence}{seen}", highlight=False, markup=False, soft_wrap=True)
