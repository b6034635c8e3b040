"""Load-dependent friction from stored runs: selection of runs, result, and report of a series."""

from dataclasses import replace
from typing import Any

import numpy as np

from backend.analysis.identification import build_friction_document, estimate_run_friction
from backend.experiments.plans import ActuatorIdentificationPlan
from backend.recording.reader import Columns
from backend.reports.model import Paragraph
from backend.reports.run_data import RunData
from backend.reports.sections import identifications_section
from backend.storage.runs import EndState, Run
from tests.identification.test_load_friction import C0, C1, computed
from tests.reports.test_identification_report import identification
from tests.reports.tracking_run import PLAN, samples, source_of

SETTINGS = {"amplitude_rad": 1.0, "chip_s": 0.08, "bits": 5, "periods": 2, "settle_s": 8.0, "estimator": "default"}
BEFORE = 700


def played(number: int, tension_N: float, **changes: Any) -> tuple[Run, Columns]:
    """A run of that number: rest, and then a motor in closed form for as long as the excitation lasts."""
    tracked = source_of({name: column[:100] for name, column in samples(PLAN).items()}).run
    settings = {**tracked.settings, "plan": {**SETTINGS, "tension_N": tension_N}}
    run = replace(tracked, id=number, kind="actuator_identification", settings=settings, **changes)
    excited = round(ActuatorIdentificationPlan(bits=5).excitation().duration_s * 1000)
    columns = computed(number, tension_N, samples=excited).columns
    rested = {name: np.concatenate((np.full(BEFORE, values[0]), values)) for name, values in columns.items()}
    return run, {"t": np.arange(BEFORE + excited) * 1e-3, **rested}


def test_runs_at_two_tensions_give_the_friction_of_motor_A() -> None:
    found = estimate_run_friction([played(3, 12.0), played(4, 31.0)])
    assert found.estimate is not None
    assert found.estimate.runs == (3, 4)
    assert abs(found.estimate.c0 - C0) < 0.02 * C0
    assert abs(found.estimate.c1 - C1) < 0.02 * C1
    assert build_friction_document(found)["estimate"]["runs"] == (3, 4)


def test_runs_of_another_rig_and_runs_that_ended_early_are_left_out() -> None:
    other, early = played(2, 31.0, plant="rig"), played(3, 31.0, end_state=EndState.STOPPED.value)
    run, columns = played(4, 31.0)
    t = np.array(columns["t"])
    t[BEFORE + 100 :] += 0.005
    holes = run, {**columns, "t": t}
    found = estimate_run_friction([other, early, holes, played(5, 12.0)])
    assert found.estimate is None
    assert found.problem
    assert [reason.partition(":")[0] for reason in found.left_out] == ["run 2", "run 3", "run 4"]
    assert build_friction_document(found)["estimate"] is None


def test_the_report_of_a_series_has_the_friction_or_a_reason() -> None:
    made = [
        RunData(run, None, columns, None, replace(identification(), run_id=run.id))
        for run, columns in (played(3, 12.0), played(4, 31.0))
    ]
    assert _told(made) == [estimate_run_friction([(one.run, one.columns) for one in made]).sentence]
    assert "not measured" in _told(made[:1])[0]


def _told(made: list[RunData]) -> list[str]:
    (section,) = identifications_section(made)
    words = (block.text for block in section.blocks if isinstance(block, Paragraph))
    return [text.partition(". Motor B")[0] for text in words if "friction" in text and "Motor B" in text]
