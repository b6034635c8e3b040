"""The tuning of an experiment: its text form and its default."""

from contextlib import closing
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.analysis.context import load_initial_tuning
from backend.banks import tuning_settings
from backend.banks.builder import NamedEntry, build_tuning_command, require_consistent
from backend.banks.tuning_settings import TuningSettings, compute_default_tuning, parse_changes
from backend.errors import OutOfRangeError
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import find_experiment
from backend.experiments.plans import LoopSettings, split_values
from backend.models.run import SETTINGS, StoredLoopSettings
from backend.models.upgrades import upgrade_run_settings
from backend.schemas.state import TrialView
from backend.schemas.tuning import ChosenTuning, Motion, SavedTuning, TuningParts, TuningRequest, TuningView
from backend.storage.banks import BankEntry
from backend.storage.database import open_database
from backend.tuning.gains import PointModel, TuningParameters
from backend.tuning.preview import STEP_Q, TuningPreviewer
from backend.tuning.robustness import LAM_MOTOR_MIN
from plant.parameters import PlantParameters, load_parameters
from tests.experiments.parameter_files import quick_motors, weak_motors

# Each setting of a tuning is compared, stored, shown and sent.

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


def test_the_test_values_cover_every_setting_of_the_tuning() -> None:
    assert list(OTHER) == [field.name for field in fields(TuningSettings)]
    assert all(value != getattr(TuningSettings(), name) for name, value in OTHER.items())
    assert {field.name for field in fields(TuningParameters)} <= set(OTHER)


def test_the_text_of_a_tuning_change_contains_every_setting() -> None:
    before, after = TuningSettings(), TuningSettings(**OTHER)
    assert parse_changes(", ".join(after.list_differences(before))) == OTHER
    assert parse_changes(", ".join(before.list_differences(after))) == before.to_document()
    for text in ("no change of the tuning", "trial kept", "λ_q 0.5 s", "by the program: λ_q 0.5 s, λ_S 0.4 s"):
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
def test_every_request_body_of_the_interface_has_every_setting(schema: type[TuningParts]) -> None:
    missing = set(OTHER) - set(schema.model_fields)
    assert missing <= {"bank"}  # a bank is activated separately, and a saved tuning belongs to one bank
    for name in set(OTHER) - {"bank"}:
        kind = Motion if name == "motion" else type(OTHER[name])
        assert schema.model_fields[name].annotation in (kind, kind | None)


def test_the_setpoint_weight_changes_the_gains_of_the_loop() -> None:
    """Table 2 with a weighted reference: k_r = b k_p; the other gains are unchanged."""
    ideal = load_parameters("ideal")
    plain, weighed = (build_tuning_command(ideal, TuningSettings(b=b), None).entries[0] for b in (0.0, 0.7))
    assert (plain.k_r_q, plain.k_r_S) == (0.0, 0.0)
    assert (weighed.k_r_q, weighed.k_r_S) == pytest.approx((0.7 * plain.k_p_q, 0.7 * plain.k_p_S), rel=1e-12)
    assert replace(weighed, k_r_q=0.0, k_r_S=0.0) == plain


@pytest.mark.parametrize("lam_motor", [0.05, 0.0854])
def test_the_offered_range_respects_the_voltage_limit_with_a_setpoint_weight(lam_motor: float) -> None:
    """A proportional response to the reference needs more voltage, so the range for b = 0 would saturate."""
    lab = load_parameters("lab")
    previewer = TuningPreviewer(lab, lam_motor=lam_motor, b=1.0)
    lam_q, _ = previewer.safe_range()
    lambdas, point = TuningParameters(lam_q=lam_q, lam_motor=lam_motor, b=1.0), previewer.points[0]
    held = (point.S_nominal, point.S_nominal)
    peak_V = previewer._peak_voltage(lambdas, point, (-STEP_Q, STEP_Q), held, lam_q)
    assert peak_V < lab.motor.u_max
    assert peak_V > TuningPreviewer(lab, lam_motor=lam_motor).preview(replace(lambdas, b=0.0)).step_q.peak_voltage
    assert np.isfinite(peak_V)


# The default tuning: the method's values if they are safe, else the nearest safe ones.

METHOD = TuningSettings()
"""The method's λ and motion; what a stored document without them means."""
POINT = PointModel(10.55, 0.05, 0.342, 0.7209, 0.342)


@pytest.fixture(scope="module")
def weak(tmp_path_factory: pytest.TempPathFactory) -> PlantParameters:
    return load_parameters(str(weak_motors(tmp_path_factory.mktemp("weak"))))


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> PlantParameters:
    return load_parameters(str(quick_motors(tmp_path_factory.mktemp("quick"))))


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_the_default_tuning_uses_the_lambdas_of_the_method_if_they_are_offered(name: str) -> None:
    default = compute_default_tuning(load_parameters(name))
    assert (default.tuning, default.moved) == (METHOD, "")
    assert METHOD.motion == "lambda"


@pytest.mark.parametrize(
    ("stored", "motion", "budget"),
    [
        ({}, "lambda", 0.0),
        ({"u_plan": 0.0}, "lambda", 0.0),
        ({"u_plan": 7.5}, "time-optimal", 7.5),
        ({"motion": "lambda", "u_plan": 7.5}, "lambda", 0.0),
        ({"motion": "time-optimal"}, "time-optimal", 8.5),
        ({"motion": "time-optimal", "u_plan": 3.0}, "time-optimal", 3.0),
    ],
)
def test_a_stored_tuning_has_the_motion_of_its_run(stored: dict[str, Any], motion: str, budget: float) -> None:
    for choice in (
        TuningSettings.from_values(stored),
        load_initial_tuning(SETTINGS.read(upgrade_run_settings({"loop": stored}), "run 7").loop),
        TuningSettings().replace_values(stored),
    ):
        assert (choice.motion, choice.budget) == (motion, budget)


def test_stored_loop_settings_have_the_voltage_limit_of_their_run() -> None:
    assert StoredLoopSettings(motion="time-optimal", u_plan=3.0).budget == 3.0
    assert StoredLoopSettings(motion="lambda", u_plan=3.0).budget == StoredLoopSettings().budget == 0.0


def test_the_default_voltage_limit_is_within_the_range_of_the_plant(weak: PlantParameters) -> None:
    for parameters in (weak, replace(weak, motor=replace(weak.motor, u_max=5.0))):
        u_max = parameters.motor.u_max
        assert 0.5 * u_max < compute_default_tuning(parameters).tuning.u_plan < u_max


def test_a_position_loop_that_needs_all_of_the_voltage_is_slower_by_default(
    tmp_path: Path, weak: PlantParameters
) -> None:
    default = compute_default_tuning(weak)
    assert replace(default.tuning, lam_q=METHOD.lam_q, u_plan=METHOD.u_plan) == METHOD
    assert default.moved.endswith(f"λ_q 0.5 → {default.tuning.lam_q:g} s")
    settings = LoopSettings(**default.tuning.to_document())
    with closing(open_database(tmp_path)) as database:
        with open_headless_rig(database, weak, settings):
            pass
        for refused in (settings.lam_q - 2e-3, METHOD.lam_q):
            with (
                pytest.raises(OutOfRangeError, match="λ_q"),
                open_headless_rig(database, weak, replace(settings, lam_q=refused)),
            ):
                pass


def test_a_fast_motor_has_the_largest_default_motor_lambda_with_a_damped_loop(quick: PlantParameters) -> None:
    default = compute_default_tuning(quick)
    assert default.tuning.lam_motor == pytest.approx(3.8 * quick.identified.T_m)
    assert LAM_MOTOR_MIN < default.tuning.lam_motor < METHOD.lam_motor
    assert default.moved.endswith("λ_motor 0.0854 → 0.076 s")


def test_the_default_lambda_depends_on_the_models_of_the_bank() -> None:
    """With the T of a joint with friction (0.8 s and more in table 1), λ_q is out of range on any plant."""
    ideal, points = load_parameters("ideal"), (replace(POINT, T_q=0.9),)
    default = compute_default_tuning(ideal, points)
    with pytest.raises(OutOfRangeError, match="λ_q"):
        TuningPreviewer(ideal, points).require_safe(METHOD.lambdas)
    TuningPreviewer(ideal, points).require_safe(default.tuning.lambdas)
    assert default.tuning.lam_q > 0.8


def test_a_bank_is_checked_at_an_offered_motor_lambda(quick: PlantParameters) -> None:
    entry = BankEntry(10.55, {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342})
    assert require_consistent(quick, [NamedEntry("the entry", entry)]) == (entry,)
