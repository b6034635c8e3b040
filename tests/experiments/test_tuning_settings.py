"""Each setting of a tuning is compared, stored, shown and sent."""

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.banks import tuning_settings
from backend.banks.builder import build_tuning_command
from backend.banks.tuning_settings import TuningSettings, parse_changes
from backend.experiments.library import find_experiment
from backend.experiments.plans import LoopSettings, split_values
from backend.schemas.state import TrialView
from backend.schemas.tuning import ChosenTuning, Motion, SavedTuning, TuningParts, TuningRequest, TuningView
from backend.storage.database import open_database
from backend.tuning.gains import TuningParameters
from backend.tuning.preview import STEP_Q, TuningPreviewer
from plant.parameters import load_parameters

OTHER: dict[str, Any] = {
    "lam_q": 0.6,
    "lam_S": 0.5,
    "lam_motor": 0.09,
    "b": 1.0,
    "bank": 3,
    "interpolate": True,
    "motion": "time-optimal",
    "u_plan": 7.5,
    "k_ext": 0.7,
}
"""Each part of a tuning at another value than its default."""


def test_every_part_is_tried_here() -> None:
    assert list(OTHER) == [field.name for field in fields(TuningSettings)]
    assert all(value != getattr(TuningSettings(), name) for name, value in OTHER.items())
    assert {field.name for field in fields(TuningParameters)} <= set(OTHER)


def test_the_text_of_a_change_contains_all_of_it() -> None:
    before, after = TuningSettings(), TuningSettings(**OTHER)
    assert parse_changes(", ".join(after.list_differences(before))) == OTHER
    assert parse_changes(", ".join(before.list_differences(after))) == before.to_document()
    for text in ("the same tuning again", "trial kept", "λ_q 0.5 s", "by the program: λ_q 0.5 s, λ_S 0.4 s"):
        assert parse_changes(text) is None


@pytest.mark.parametrize("name", OTHER)
def test_tunings_that_differ_in_one_setting_are_not_equal(name: str, tmp_path: Path) -> None:
    before = TuningSettings()
    after = replace(before, **{name: OTHER[name]})
    assert after != before
    assert len(after.list_differences(before)) == 1
    assert before.list_differences(before) == []
    assert parse_changes(f"for the run: {after.list_differences(before)[0]}") == {name: OTHER[name]}
    assert TuningSettings.from_values(after.to_document()) == after
    assert LoopSettings(**after.to_document(), seed=4).tuning == after
    assert TuningSettings.from_values(asdict(LoopSettings(**after.to_document(), seed=4))) == after
    entry = find_experiment("tracking")
    _, ordered = split_values(entry.settings, entry.make_plan, {name: OTHER[name]})
    assert ordered.tuning == after
    parameters, database = load_parameters("ideal"), open_database(tmp_path)
    tuning_settings.store_tuning(database, after, parameters, "A. Operator")
    kept = tuning_settings.load_last_tuning(database, parameters)
    database.close()
    assert kept is not None
    assert (kept.tuning, kept.who, kept.same_plant) == (after, "A. Operator", True)


@pytest.mark.parametrize("schema", [TuningParts, TuningRequest, TuningView, ChosenTuning, SavedTuning, TrialView])
def test_every_body_of_the_interface_has_every_part(schema: type[TuningParts]) -> None:
    missing = set(OTHER) - set(schema.model_fields)
    assert missing <= {"bank"}  # a bank is activated, and what is saved is saved for one
    for name in set(OTHER) - {"bank"}:
        kind = Motion if name == "motion" else type(OTHER[name])
        assert schema.model_fields[name].annotation in (kind, kind | None)


def test_b_reaches_the_gains_of_the_loop() -> None:
    """Table 2 with a weighed reference: k_r = b k_p, all else as without."""
    ideal = load_parameters("ideal")
    plain, weighed = (build_tuning_command(ideal, TuningSettings(b=b), None).entries[0] for b in (0.0, 0.7))
    assert (plain.k_r_q, plain.k_r_S) == (0.0, 0.0)
    assert (weighed.k_r_q, weighed.k_r_S) == pytest.approx((0.7 * plain.k_p_q, 0.7 * plain.k_p_S), rel=1e-12)
    assert replace(weighed, k_r_q=0.0, k_r_S=0.0) == plain


@pytest.mark.parametrize("lam_motor", [0.05, 0.0854])
def test_the_offered_range_leaves_voltage_with_b_too(lam_motor: float) -> None:
    """A reference that is felt at once takes more voltage: the range that was found without it would clip."""
    lab = load_parameters("lab")
    previewer = TuningPreviewer(lab, lam_motor=lam_motor, b=1.0)
    lam_q, _ = previewer.safe_range()
    lambdas, point = TuningParameters(lam_q=lam_q, lam_motor=lam_motor, b=1.0), previewer.points[0]
    held = (point.S_nominal, point.S_nominal)
    peak_V = previewer._peak_voltage(lambdas, point, (-STEP_Q, STEP_Q), held, lam_q)
    assert peak_V < lab.motor.u_max
    assert peak_V > TuningPreviewer(lab, lam_motor=lam_motor).preview(replace(lambdas, b=0.0)).step_q.peak_voltage
    assert np.isfinite(peak_V)
