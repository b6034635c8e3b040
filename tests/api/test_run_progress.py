"""What the state says of a run that goes: an experiment that is data by its title, the paper's by their kind."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from backend.execution.progress import RunPhase
from backend.experiments.forecast import ExpectedDuration
from backend.experiments.library import find_experiment
from backend.services.jobs import ScheduledRun, make_progress_callback


@pytest.mark.parametrize(
    ("name", "kind", "title"), [("hold_at_rest", "experiment", "Hold at rest"), ("tracking", "tracking", "")]
)
def test_an_experiment_that_is_data_is_named_by_its_title(name: str, kind: str, title: str) -> None:
    plan = find_experiment(name).default_plan
    live_state: Any = SimpleNamespace(task=None)
    order = ScheduledRun(plan, run=14, expected=ExpectedDuration(before_s=2.0, program_s=30.0))
    make_progress_callback(live_state, order, cast(Any, SimpleNamespace(remaining_runs=0, is_requested=False)))(
        RunPhase.PRETENSION, 1.5
    )
    task = live_state.task
    assert (task.kind, task.title, task.run, task.elapsed_s, task.duration_s) == (kind, title, 14, 1.5, 32.0)
