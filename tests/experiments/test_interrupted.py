"""An interrupted experiment stores its samples, passes no criterion, and its report names what is missing."""

import asyncio
from collections import Counter
from dataclasses import dataclass
from itertools import cycle

import pytest

from backend.execution.progress import RunPhase
from backend.execution.runner import ExperimentRig, RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments import library
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import LoopSettings
from backend.faults import Fault
from backend.realtime.commands import Command, Inject, Stop
from backend.reports.build import build_report
from backend.reports.model import to_html
from backend.reports.run_data import RunData, load_source
from backend.reports.verification import Verified, verify_report
from backend.storage.database import open_database
from plant.interface import InjectedFault, InjectedFaultKind
from plant.parameters import load_parameters

ENDINGS: dict[str, tuple[Command, str]] = {
    "a stop": (Stop(), "stopped"),
    "a soft stop as the operator is lost": (Stop(Fault.OPERATOR_LOST, hard=False), "link_lost"),
    "a trip": (Inject(InjectedFault(InjectedFaultKind.SAFETY_TRIP)), "tripped"),
}
AFTER_S = {
    "tracking": 20.0,
    "compliance": 34.0,
    "step_battery": 40.0,
    "stiffness_sweep": 30.0,
    "lambda_sweep": 30.0,
    "motion_comparison": 20.0,
    "bank_comparison": 35.0,
    "disturbance_battery": 30.0,
    "frequency_response": 60.0,
    "hold_at_rest": 45.0,
    "impact": 20.0,
}
"""Some time in the program of each that is ready-made [s], after the first figure can be had."""

TOO_EARLY = {
    "robustness": (9.0, "both motors had been loaded and let go"),
    "disturbance_battery": (8.0, "the pushes were over"),
}
"""Some time [s] before it, and what was not over by then."""


@dataclass
class Interruption:
    """Sends a command once so much of the program has been played; counts as told of the run's progress."""

    station: ExperimentRig
    command: Command
    after_s: float
    sent: "asyncio.Task[object] | None" = None

    def __call__(self, doing: RunPhase, elapsed_s: float) -> None:
        if doing is RunPhase.PROGRAM and elapsed_s > self.after_s and self.sent is None:
            self.sent = asyncio.get_running_loop().create_task(self.station.loop.send(self.command))


def interrupted(tmp_path_factory: pytest.TempPathFactory, name: str, command: Command, after_s: float) -> RunData:
    database = open_database(tmp_path_factory.mktemp("interrupted"))
    with open_headless_rig(database, load_parameters("ideal"), LoopSettings()) as station:
        order = RunRequest(build_ready_plan(name), LoopSettings(), "A. Operator")
        outcome = asyncio.run(run_experiment(station, order, Interruption(station, command, after_s)))
    source = load_source(database, outcome.run.id)
    database.close()
    return source


PAIRS = [("tracking", ending) for ending in ENDINGS] + list(zip(list(AFTER_S)[1:], cycle(ENDINGS), strict=False))
"""One kind with each ending, the others with one each, in turn: how a run ends and what it plays know nothing of each
other."""


def test_all_that_is_ready_made_is_cut_short_here_and_by_every_ending() -> None:
    assert {*AFTER_S, *TOO_EARLY} == set(library.READY_NAMES)
    assert {name for name, _ in PAIRS} == set(AFTER_S)
    assert min(Counter(ending for _, ending in PAIRS).values()) > 2


@pytest.mark.parametrize(("name", "ending"), PAIRS)
def test_an_interrupted_run_has_its_samples_and_names_what_is_missing(
    tmp_path_factory: pytest.TempPathFactory, name: str, ending: str
) -> None:
    command, end_state = ENDINGS[ending]
    source = interrupted(tmp_path_factory, name, command, AFTER_S[name])
    assert source.run.end_state == end_state
    played = source.columns["t"].size
    assert 1000 * AFTER_S[name] <= played < 1000 * build_ready_plan(name).program().duration_s
    result = source.result
    assert result is not None
    assert not result.metrics.complete
    assert [item.title for item in result.criteria if item.passed] == []
    assert all(item.reason for item in result.metrics.figures if item.value is None)
    report = build_report(source)
    assert report.outcome == "incomplete"
    assert f"s of {build_ready_plan(name).program().duration_s:.6g} s were played" in report.verdict
    assert verify_report(to_html(report), source.columns) == Verified((), ())


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("name", TOO_EARLY)
def test_a_run_without_measurements_has_a_reason(
    tmp_path_factory: pytest.TempPathFactory, name: str, ending: str
) -> None:
    (after_s, awaited), (command, end_state) = TOO_EARLY[name], ENDINGS[ending]
    source = interrupted(tmp_path_factory, name, command, after_s)
    assert source.run.end_state == end_state
    assert source.columns["t"].size >= 1000 * after_s
    assert source.result is None
    report = build_report(source)
    assert report.outcome == "incomplete"
    assert report.verdict == f"No result: the run ended before {awaited}."
    assert verify_report(to_html(report), source.columns) == Verified((), ())
