"""``sinew rig``: wiring files, commissioning, tare and calibration."""

import asyncio
import json
import os
import pty
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from backend.banks.builder import build_tuning_command
from backend.cli import main, messages
from backend.cli.experiments import current_user
from backend.cli.rig import AbandonedError, Terminal
from backend.commissioning import messages as step_messages
from backend.commissioning import status as commissioning_status
from backend.commissioning.procedure import StepFinding
from backend.commissioning.procedures import START_N
from backend.commissioning.session import OperatorDialog, open_session
from backend.commissioning.steps import STEPS, StepId
from backend.experiments.plans import LoopSettings
from backend.realtime.commissioning_motions import HOMING_MAX_V
from backend.realtime.ipc import Setup
from backend.realtime.supervisor import Supervisor
from backend.sample import INDEX
from backend.storage.commissioning import StoredStepResult
from backend.storage.database import open_database
from plant.calibration import CellCalibration
from plant.interface import PlantChoice, PlantKind
from plant.parameters import load_parameters
from plant.wiring import Wiring, load_wiring
from tests.api.conftest import client_with
from tests.e2e.service import running_service
from tests.refusals import refused

# ``sinew rig check``: an invalid wiring file is rejected with line and remedy, a valid one is accepted.

SHIPPED = Path(__file__).parents[2] / "plant/wirings/pcie-6323.toml"


def test_the_shipped_wiring_is_valid(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", "check"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert messages.wiring_valid(wiring="pcie-6323") in capsys.readouterr().out


def test_each_mistake_in_a_wiring_file_is_reported_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "mine.toml"
    wrong.write_text(SHIPPED.read_text().replace('channel = "ai1"', 'channel = "ai99"').replace('"ctr2"', '"ctr1"'))
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", "check", "--wiring", str(wrong)])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr().err
    lines = wrong.read_text().splitlines()
    unknown = next(number for number, line in enumerate(lines, 1) if "ai99" in line)
    twice = [number for number, line in enumerate(lines, 1) if '"ctr1"' in line][1]
    assert ended.value.code == 1
    assert f"mine.toml:{unknown}: load_cell_B.channel: 'ai99' is not known" in printed
    assert f"mine.toml:{twice}: encoder_B.counter: " in printed
    assert [line.split(":")[:3] for line in printed.splitlines()] == [
        ["sinew", " mine.toml", str(number)] for number in sorted([unknown, twice])
    ]
    monkeypatch.setattr(sys, "argv", ["sinew", "serve", "--plant", "rig", "--virtual-card", "--wiring", str(wrong)])
    with pytest.raises(SystemExit):
        main()
    assert capsys.readouterr().err == printed


def test_mistakes_in_a_wiring_file_are_printed_as_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "mine.toml"
    wrong.write_text(SHIPPED.read_text().replace('channel = "ai1"', 'channel = "ai99"'))
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", "check", "--wiring", str(wrong), "--json"])
    with pytest.raises(SystemExit):
        main()
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert problem["entry"] == "load_cell_B.channel"
    assert "ai99" in wrong.read_text().splitlines()[problem["line"] - 1]


@pytest.mark.parametrize("words", [["--open"], ["--open", "--json"]])
def test_a_card_that_cannot_be_opened_is_reported_as_text_and_json(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", "check", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code == 1
    assert "install NI-DAQmx" in printed.err
    assert printed.out == ""


# ``sinew rig bring-up``, ``tare`` and ``calibrate`` on the virtual card, with and without a terminal.

CARD = ["--plant", "rig", "--virtual-card"]
ROOT = Path(__file__).parents[2]
BEFORE_HOMING = (StepId.WIRING_TEST, StepId.TARE, StepId.CALIBRATE, StepId.DIRECTION)
START = messages.keep_clear_of_start()
WIRING = load_wiring("pcie-6323")


def done(data: Path, *steps: StepId, wiring: Wiring = WIRING) -> None:
    """Store passed steps with a wiring and the load cells of the wiring."""
    cells = (wiring.load_cell_A.slope, wiring.load_cell_A.offset), (wiring.load_cell_B.slope, wiring.load_cell_B.offset)
    as_said = tuple(CellCalibration(tendon, *cell, "well") for tendon, cell in zip("AB", cells, strict=True))
    with closing(open_database(data)) as database:
        for step in steps:
            found = as_said if step in (StepId.TARE, StepId.CALIBRATE) else ()
            commissioning_status.store_result(database, step, wiring, StepFinding(True, "well", (), found), "Ada")


def stored_results(data: Path) -> dict[str, StoredStepResult]:
    with closing(open_database(data)) as database:
        return commissioning_status.load_newest_results(database)


def sinew(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str, data: Path
) -> tuple[int, str, str]:
    """Return exit status, output and complaint, each in one line."""
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", *words, "--data", str(data)])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    return int(ended.value.code or 0), printed.out, " ".join(printed.err.split())


def _restore_sigint() -> None:
    """Restore the default of SIGINT, which a shell ignores for background processes such as these tests."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def at_a_terminal(*words: str, data: Path) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A command whose standard input is a terminal: the process, and the end to write to."""
    typing, theirs = pty.openpty()
    command = [sys.executable, "-m", "backend", "rig", *words, "--data", str(data)]
    running = subprocess.Popen(
        command,
        stdin=theirs,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_restore_sigint,
    )
    os.close(theirs)
    too_long = threading.Timer(120.0, running.kill)
    too_long.start()
    try:
        yield running, typing
    finally:
        too_long.cancel()
        os.close(typing)
        running.kill()
        running.wait()


def wait_for_text(running: subprocess.Popen[str], words: str) -> None:
    """Wait until the command prints the text on standard error."""
    assert running.stderr is not None
    lines = []
    for line in running.stderr:
        lines.append(line)
        if words in line:
            return
    pytest.fail(f"it ended without saying {words!r}: {''.join(lines)}")


def wait_for_question(running: subprocess.Popen[str], words: str) -> None:
    """Wait for a question; the description of its step may contain the same words."""
    wait_for_text(running, f"  > {words}")


@pytest.mark.live
def test_the_service_shows_a_tare_of_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done(tmp_path, StepId.WIRING_TEST)
    with at_a_terminal("tare", *CARD, "--json", data=tmp_path) as (running, typing):
        for question in (START, step_messages.unload_load_cells(), step_messages.remove_load()):
            wait_for_question(running, question)
            # After the first, while the loop starts without a question: no answer.
            os.write(typing, b"\nq\n" if question == START else b"\n")
        printed, errors = running.communicate()
    assert running.returncode == 0, errors
    told_of = {step["id"]: step for step in json.loads(printed)["steps"]}
    assert told_of["tare"]["state"] == "current"
    with running_service(tmp_path, plant=("rig", "--virtual-card")) as service, client_with(service, "token") as client:
        shown = {step["id"]: step for step in client.get("/api/bring-up").json()["steps"]}
        status, _, complaint = sinew(monkeypatch, capsys, "tare", *CARD, data=tmp_path)
    assert shown["tare"]["state"] == "current"
    assert shown["tare"]["result"]["who"] == current_user()
    assert shown["tare"]["result"]["figures"] == told_of["tare"]["result"]["figures"]
    assert status == 1
    assert messages.page_instead(reason="", address=service.url) in complaint


@pytest.mark.live
def test_ctrl_c_in_a_step_stores_no_result(tmp_path: Path) -> None:
    done(tmp_path, StepId.WIRING_TEST)
    with at_a_terminal("bring-up", "--step", "zero", "--step", "direction", *CARD, data=tmp_path) as (running, typing):
        by_hand = step_messages.hold_joint_at_mark(), step_messages.turn_motors_to_tension(F=START_N)
        for question in (START, *by_hand):
            wait_for_question(running, question)
            os.write(typing, b"\n")
        wait_for_text(running, step_messages.testing_motor(motor="A"))
        running.send_signal(signal.SIGINT)
        running.communicate()
    assert running.returncode == 130
    assert set(stored_results(tmp_path)) == {StepId.WIRING_TEST, StepId.ZERO}


@pytest.mark.live
def test_the_joint_is_homed_from_the_terminal(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    shipped = (ROOT / "plant/wirings/pcie-6323.toml").read_text(encoding="utf-8")
    at = 'line = "port0/line1"\nposition = { value = 0.3, unit = "rad", source = "a protractor" }'
    mine.write_text(shipped.replace('line = "port0/line1"', at), encoding="utf-8")
    done(tmp_path, *BEFORE_HOMING, wiring=load_wiring(str(mine)))
    command = ("bring-up", "--step", "home", "--wiring", str(mine), "--json", *CARD)
    with at_a_terminal(*command, data=tmp_path) as (running, typing):
        by_hand = step_messages.turn_joint_to_middle(voltage=HOMING_MAX_V, position=0.3, travel=0.0)
        for question in (START, by_hand.partition(":")[0]):
            wait_for_question(running, question)
            os.write(typing, b"\n")
        printed, errors = running.communicate()
    assert running.returncode == 0, errors
    steps = {step["id"]: step for step in json.loads(printed)["steps"]}
    assert (steps["home"]["state"], steps["zero"]["state"]) == ("current", "current")
    assert "17.19°" in errors  # 0.3 rad


@pytest.mark.live
def test_a_step_cancelled_with_a_driven_motor_ends_at_zero_volts_without_result(tmp_path: Path) -> None:
    """Ctrl-C cancels the task of the step in the process."""
    done(tmp_path, StepId.WIRING_TEST)
    parameters = load_parameters("lab")
    choice = PlantChoice(PlantKind.VIRTUAL_CARD)
    setup = Setup(choice, "lab", 0, build_tuning_command(parameters, LoopSettings(), None))

    async def confirmed(_words: str) -> None:
        """Confirm each request immediately."""

    async def given_up() -> tuple[Supervisor, float, float]:
        with closing(open_database(tmp_path)) as database:
            person = OperatorDialog("Ada", confirmed, lambda _phase: None)
            async with open_session(database, setup, parameters, person) as at_rig:
                supervisor = at_rig.supervisor
                await at_rig.run(StepId.ZERO, {})
                playing = asyncio.create_task(at_rig.run(StepId.DIRECTION, {}))
                await supervisor.advance_until(lambda: playing.done() or volts(supervisor) > 0.1, 30.0)
                assert not playing.done(), playing.result()
                driven = volts(supervisor)
                playing.cancel()
                result = await playing
                assert (result.passed, result.text) == (
                    False,
                    step_messages.abandoned_after_motor_test(),
                )
                await supervisor.advance(0.05)
                return supervisor, driven, volts(supervisor)

    supervisor, driven, after = asyncio.run(given_up())
    assert driven > 0.1
    assert after == 0.0
    card = supervisor.card.state()
    assert (card.u_A, card.u_B, card.drive_enabled) == (0.0, 0.0, False)
    assert {step: result.passed for step, result in stored_results(tmp_path).items()} == {
        StepId.WIRING_TEST: True,
        StepId.ZERO: True,
        StepId.DIRECTION: False,
    }


def volts(supervisor: Supervisor) -> float:
    newest = supervisor.ring.newest()
    return 0.0 if newest is None else float(max(abs(newest[INDEX["u_A"]]), abs(newest[INDEX["u_B"]])))


def test_the_end_of_a_pipe_ends_its_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    os.write(writing, b"\n 12.5 \nq\n")
    os.close(writing)

    async def read_answers() -> str:
        terminal = Terminal()
        await terminal.confirm("Turn the joint")
        typed = await terminal.ask("weight", "number")
        for code in ("given_up", "input_ended"):
            with refused(AbandonedError, code):
                await terminal.confirm("Go on")
        return typed

    with os.fdopen(reading) as piped:
        monkeypatch.setattr(sys, "stdin", piped)
        assert asyncio.run(read_answers()) == "12.5"


def blocked(step: str, first: str) -> str:
    return messages.step_blocked(step=step, reason=step_messages.other_steps_first(steps=first))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["bring-up"], messages.only_for_a_rig(plant="simulator")),
        (["bring-up", "--plant", "rig"], messages.steps_require_terminal()),
        (["bring-up", *CARD, "--step", "direction"], blocked("Motor directions", "Wiring test, Zero")),
        (["tare", *CARD], blocked("Tare", "Wiring test")),
        (
            ["bring-up", *CARD, "--step", "home"],
            messages.step_blocked(step="Homing", reason=step_messages.no_end_switch_position()),
        ),
        (["calibrate", *CARD, "--weight", "5"], messages.wrong_number_of_weights(maximum=9, given=1)),
        (["calibrate", *CARD, "--weight", "7", "--weight", "5"], step_messages.weights_too_close(minimum_N=5.0)),
        (["calibrate", *CARD, "--weight", "5", "--weight", "60"], "45 N"),
    ],
)
def test_invalid_commissioning_commands_are_rejected_before_the_card_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], expected: str
) -> None:
    status, printed, complaint = sinew(monkeypatch, capsys, *words, data=tmp_path)
    assert status in (1, 2)
    assert expected in complaint
    assert printed == ""


def test_the_steps_are_listed_with_person_and_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done(tmp_path, StepId.WIRING_TEST, StepId.ZERO)
    _, printed, _ = sinew(monkeypatch, capsys, "bring-up", "--list", *CARD, "--json", data=tmp_path)
    steps = {step["id"]: step for step in json.loads(printed)["steps"]}
    assert list(steps) == [step.id for step in STEPS if step.id is not StepId.HOME]  # it has no position
    stand = [steps[step]["state"] for step in ("wiring_test", "zero", "tare")]
    assert stand == ["current", "out_of_date", "never"]
    assert steps["wiring_test"]["result"]["who"] == "Ada"
    assert "lost their zero" in steps["zero"]["why"]
