"""A tracking run in the form of a recording, computed from closed forms without plant, loop and database."""

from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from backend.analysis.evaluation import build_tracking_document
from backend.analysis.step_metrics import compute_tracking_metrics
from backend.experiments.library import build_ready_plan, list_stored_values
from backend.experiments.plans import ExperimentPlan
from backend.reports.run_data import RunData
from backend.sample import STORED_NAMES
from backend.storage.banks import Bank, BankEntry
from backend.storage.results import Result
from backend.storage.runs import Run
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.experiments.judging import tracking_criteria

Array = NDArray[np.float64]
BEGAN = datetime(2026, 3, 4, 10, 20, 30, 123456, tzinfo=UTC)
PLAN = build_ready_plan("tracking", q_duration_s=4.0, S_duration_s=3.0)


def samples(plan: ExperimentPlan, lam_q: float = 0.5, lam_S: float = 0.42) -> dict[str, Array]:
    program = plan.program()
    t = np.arange(round(program.duration_s / T_s)) * T_s
    columns = {name: np.zeros_like(t) for name in STORED_NAMES} | {"t": t}
    for name, lam, old in (("q", lam_q, 0.0), ("S", lam_S, 8.24)):
        start, y = 0.0, np.full_like(t, old)
        for segment in program.segments:
            new = getattr(segment, f"{name}_ref")
            since = np.maximum(t - start, 0.0)
            columns[f"{name}_ref"][t >= start - 1e-9] = new
            y += (new - old) * (1 - (1 + since / lam) * np.exp(-since / lam))
            start, old = start + segment.duration_s, new
        columns[name] = y
        columns[f"lam_{name}"] = np.full_like(t, lam)
    columns["S_true"] = np.full_like(t, np.nan)
    columns["F_A"] = columns["F_B"] = 20.0 + 4.0 * (columns["S"] - 10.0)
    columns["u_A"] = 2.0 * np.gradient(columns["q"], T_s) + 0.8
    columns["u_B"] = -2.0 * np.gradient(columns["q"], T_s) + 0.8
    return columns


def source_of(
    columns: dict[str, Array], *, end_state: str = "completed", note: str = "", bank: bool = False
) -> RunData:
    parameters = load_parameters("ideal")
    metrics = compute_tracking_metrics(columns, PLAN.program(), PLAN.phases())
    settings = {
        "plan": list_stored_values(PLAN),
        "loop": {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.0854, "seed": 7},
        "declared": [
            {
                "name": "q_amplitude",
                "meaning": "joint position steps between ±q_max",
                "symbol": "q_max",
                "unit": "rad",
                "value": PLAN.values["q_amplitude"],
            }
        ],
        "versions": {"Python": "3.11.2", "NumPy": "2.4.6"},
    }
    run = Run(
        id=12,
        kind="tracking",
        plant="simulator",
        parameters_name="ideal",
        parameters=parameters.to_document(),
        settings=settings,
        bank_id=3 if bank else None,
        who="A. Operator",
        software="0.1.0",
        started_at=BEGAN,
        ended_at=BEGAN,
        end_state=end_state,
        end_detail="",
        note=note,
    )
    result = Result(
        id=1,
        run_id=12,
        metrics=build_tracking_document(metrics, PLAN.phases()),
        criteria=tracking_criteria(metrics, "ideal"),
        software="0.1.0",
        created_at=BEGAN,
    )
    model = {"K_q": 0.0501, "T_q": 0.342, "K_S": 0.722, "T_S": 0.341}
    entries = (BankEntry(8.24, model, 4), BankEntry(10.55, model, 5), BankEntry(12.43, model, None))
    made = Bank(id=3, name="spring set 2", version=2, note="", who="A. Operator", created_at=BEGAN, entries=entries)
    return RunData(run, result, columns, made if bank else None, runs_of={4: 7, 5: 8})
