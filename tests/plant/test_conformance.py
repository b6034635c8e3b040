"""The contract of a plant, and the conformance test."""

import gc
import math
import time
from collections.abc import Callable
from dataclasses import replace
from inspect import isfunction, signature
from pathlib import Path

import pytest

from plant.conformance import CHECKS, LONG_TICKS, WARM_UP_TICKS, Check, CheckOutcome, Subject, drive, run_contract
from plant.factory import ATTRIBUTES, METHODS, make_plant
from plant.interface import ZERO_VOLTS, Measurement, MotorCommand, Plant, PlantChoice, PlantKind, T_s
from plant.message import Message
from plant.parameters import PlantParameters
from plant.replay import Replay, load_replay
from plant.rig import Rig
from plant.simulator import Simulator
from tests.plant import example
from tests.plant.recorded import trip_recorded

# The contract of a plant holds for the simulator, the rig on a virtual card, a recording, and a package's plant.

NOT_FOR_A_RECORDING = {"a_voltage_acts", "a_write_counts_from_the_next_reading", "keeps_to_its_voltages"}
"""What is written to a recording has no effect."""


@pytest.fixture(scope="module")
def choices(lab: PlantParameters, tmp_path_factory: pytest.TempPathFactory) -> dict[str, PlantChoice]:
    recording = tmp_path_factory.mktemp("recording") / "run-7.csv"
    trip_recorded(lab, recording)
    return {
        "simulator": PlantChoice(),
        "virtual card": PlantChoice(PlantKind.VIRTUAL_CARD),
        "replay": PlantChoice(PlantKind.REPLAY, recording=str(recording)),
        example.NAME: PlantChoice(PlantKind.PACKAGE, package=example.NAME),
    }


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return example.installed_in(tmp_path_factory.mktemp("example"))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
@pytest.mark.parametrize("name", ["simulator", "virtual card", "replay", example.NAME])
def test_every_plant_fulfils_the_contract(
    choices: dict[str, PlantChoice],
    site: Path,
    lab: PlantParameters,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    check: Check,
) -> None:
    monkeypatch.syspath_prepend(str(site))
    subject = Subject(lambda: make_plant(choices[name], lab, 0), lab, voltage=0.5)
    if name == "replay":
        subject = replace(subject, answers=False, lasts=len(load_replay(choices[name].recording)))
    (finding,) = run_contract(subject, (check,))
    left_out = name == "replay" and check.name in NOT_FOR_A_RECORDING
    assert finding.outcome is (CheckOutcome.NOT_TRIED if left_out else CheckOutcome.HOLDS), finding.seen


@pytest.mark.parametrize("kind", [Simulator, Replay, Rig])
def test_every_plant_has_the_signatures_of_the_interface(kind: type[Plant]) -> None:
    promised = {name: signature(each) for name, each in vars(Plant).items() if isfunction(each) and name[0] != "_"}
    assert {name: signature(getattr(kind, name)) for name in promised} == promised


class Degrees(Simulator):
    def read(self) -> Measurement:
        m = super().read()
        return m._replace(q=m.q + 30.0)


class Swapped(Simulator):
    def write(self, command: MotorCommand) -> None:
        super().write(MotorCommand(command.u_B, command.u_A))


class Backwards(Simulator):
    def write(self, command: MotorCommand) -> None:
        super().write(MotorCommand(-command.u_A, -command.u_B))


class Driving(Simulator):
    def write(self, command: MotorCommand) -> None:
        super().write(MotorCommand(command.u_A + 1.0, command.u_B))


class Unbound(Simulator):
    def write(self, command: MotorCommand) -> None:
        super().write(MotorCommand(10.0 if command.u_A > 10.0 else 0.9 * command.u_A, 0.9 * command.u_B))


class Restless(Simulator):
    def read(self) -> Measurement:
        super().write(MotorCommand(10.0, 10.0))
        return super().read()


class Hoarding(Simulator):
    def __init__(self, parameters: PlantParameters) -> None:
        super().__init__(parameters)
        self.kept: list[Measurement] = []

    def read(self) -> Measurement:
        self.kept.append(super().read())
        return self.kept[-1]


class Odd(Simulator):
    def push(self, F_push: float) -> None:
        raise ValueError("no")


class OpenOnce(Simulator):
    done = False

    def close(self) -> None:
        assert not self.done
        self.done = True


class Hasty(Simulator):
    stepped, paces_loop = False, True


class Random(Simulator):
    made = 0

    def __init__(self, parameters: PlantParameters) -> None:
        Random.made += 1
        super().__init__(parameters, seed=Random.made)


class Mute(Simulator):
    description = ""


class Hurried(Simulator):
    unattended_max_s = 1e-3


class Less:
    open = read = close = Simulator.open

    def __init__(self, _parameters: PlantParameters) -> None:
        """Take what the others take."""


MISSING_METHODS = [f"{name}()" for name in METHODS if name not in ("open", "read", "close")]


@pytest.mark.parametrize(
    ("make", "requirement", "code", "values"),
    [
        (Less, "is_a_plant", "parts_missing", {"missing": ", ".join([*ATTRIBUTES, *MISSING_METHODS])}),
        (Hurried, "is_a_plant", "unattended_time_invalid", {"value": 1e-3}),
        (Mute, "describes_itself", "description_empty", {}),
        (Restless, "opens_at_rest", "moved_at_zero_volts", {}),
        (Degrees, "reads_in_si", "q_implausible", {"q_max": pytest.approx(math.pi / 2.0)}),
        (Driving, "rests_at_zero_volts", "moved_at_zero_volts", {}),
        (Backwards, "a_voltage_acts", "motor_not_turned", {"voltage": 0.5, "motor": "A"}),
        (Swapped, "a_voltage_acts", "motor_not_turned", {"voltage": 0.5, "motor": "A"}),
        (Restless, "a_write_counts_from_the_next_reading", "moved_without_write", {}),
        (Unbound, "keeps_to_its_voltages", "voltage_not_limited", {"voltage": 1000.0, "u_max": 10.0}),
        (Odd, "refuses_in_a_sentence", "other_error_raised", {"kind": "ValueError", "reason": "no"}),
        (OpenOnce, "closes_twice_and_opens_again", "other_error_raised", {"kind": "AssertionError"}),
        (Hasty, "keeps_the_time", "readings_before_due", {"readings": 1000}),
        (Hoarding, "keeps_nothing_of_a_tick", "memory_grows", {"ticks": LONG_TICKS}),
        (Random, "repeats", "readings_not_repeated", {}),
    ],
)
def test_violations_of_the_contract_are_detected(
    lab: PlantParameters,
    make: Callable[[PlantParameters], Simulator],
    requirement: str,
    code: str,
    values: dict[str, object],
) -> None:
    def made() -> Simulator:
        return make(lab)

    (check,) = (check for check in CHECKS if check.name == requirement)
    (finding,) = run_contract(Subject(made, lab, voltage=0.5), (check,))
    assert finding.outcome is CheckOutcome.BROKEN
    assert isinstance(finding.seen, Message)
    assert finding.seen.code == code, finding.seen
    assert {name: finding.seen.values.get(name) for name in values} == values, finding.seen


class Collecting(Hoarding):
    """Hoards, and runs a full garbage collection in one of its ticks."""

    def read(self) -> Measurement:
        if len(self.kept) == WARM_UP_TICKS + LONG_TICKS // 2:
            gc.collect()
        return super().read()


def test_memory_kept_per_tick_is_detected_despite_other_garbage(lab: PlantParameters) -> None:
    (check,) = (check for check in CHECKS if check.name == "keeps_nothing_of_a_tick")
    gc.disable()  # at which tick it is freed is no matter of luck
    try:
        for _ in range(200_000):
            itself: list[object] = []
            itself.append(itself)
        (finding,) = run_contract(Subject(lambda: Collecting(lab), lab), (check,))
    finally:
        gc.enable()
    assert finding.outcome is CheckOutcome.BROKEN, finding.seen


def test_conformance_without_voltage_never_drives_the_motors(lab: PlantParameters) -> None:
    written: list[MotorCommand] = []

    class Watched(Simulator):
        def write(self, command: MotorCommand) -> None:
            written.append(command)
            super().write(command)

    findings = list(run_contract(Subject(lambda: Watched(lab), lab)))
    assert {f.name for f in findings if f.outcome is CheckOutcome.NOT_TRIED} == NOT_FOR_A_RECORDING
    assert not [f for f in findings if f.outcome is CheckOutcome.BROKEN]
    assert all(not abs(u) > 0.0 or u == float("inf") for command in written for u in command)


# How the contract looks at a plant.


class WithTheClock(Simulator):
    stepped = False


class AtItsOwnPace(Simulator):
    stepped, paces_loop = False, True


@pytest.mark.parametrize(("plant", "waits"), [(Simulator, 0), (AtItsOwnPace, 0), (WithTheClock, 50)])
def test_only_plants_that_follow_the_clock_are_waited_for(
    lab: PlantParameters, plant: type[Simulator], waits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    slept_s: list[float] = []
    monkeypatch.setattr(time, "sleep", slept_s.append)
    drive(plant(lab), ZERO_VOLTS, 50)
    assert len(slept_s) == waits
    assert all(0.0 <= s <= T_s for s in slept_s)
