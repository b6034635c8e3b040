"""The default tuning: the method's values if they are safe, else the nearest safe ones."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backend.analysis.context import load_initial_tuning
from backend.banks.builder import NamedEntry, require_consistent
from backend.banks.tuning_settings import TuningSettings, compute_default_tuning
from backend.errors import OutOfRangeError
from backend.execution.simulation import open_headless_rig
from backend.experiments.plans import LoopSettings
from backend.models.run import SETTINGS, StoredLoopSettings
from backend.models.upgrades import upgrade_run_settings
from backend.storage.banks import BankEntry
from backend.storage.database import open_database
from backend.tuning.gains import PointModel
from backend.tuning.preview import TuningPreviewer
from backend.tuning.robustness import LAM_MOTOR_MIN
from plant.parameters import PlantParameters, load_parameters
from tests.experiments.parameter_files import quick_motors, weak_motors

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
def test_the_method_decides_where_its_lambdas_are_offered(name: str) -> None:
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
def test_a_stored_tuning_has_the_motion_that_it_ran_with(stored: dict[str, Any], motion: str, budget: float) -> None:
    for choice in (
        TuningSettings.from_values(stored),
        load_initial_tuning(SETTINGS.read(upgrade_run_settings({"loop": stored}), "run 7").loop),
        TuningSettings().replace_values(stored),
    ):
        assert (choice.motion, choice.budget) == (motion, budget)


def test_a_stored_loop_knows_the_limit_that_it_ran_with() -> None:
    assert StoredLoopSettings(motion="time-optimal", u_plan=3.0).budget == 3.0
    assert StoredLoopSettings(motion="lambda", u_plan=3.0).budget == StoredLoopSettings().budget == 0.0


def test_the_budget_is_one_that_this_plant_offers(weak: PlantParameters) -> None:
    for parameters in (weak, replace(weak, motor=replace(weak.motor, u_max=5.0))):
        u_max = parameters.motor.u_max
        assert 0.5 * u_max < compute_default_tuning(parameters).tuning.u_plan < u_max


def test_a_position_loop_that_takes_all_of_the_voltage_is_slower_by_default(
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


def test_a_quick_motor_gets_the_largest_motor_lambda_that_leaves_its_loop_a_damping(quick: PlantParameters) -> None:
    default = compute_default_tuning(quick)
    assert default.tuning.lam_motor == pytest.approx(3.8 * quick.identified.T_m)
    assert LAM_MOTOR_MIN < default.tuning.lam_motor < METHOD.lam_motor
    assert default.moved.endswith("λ_motor 0.0854 → 0.076 s")


def test_the_models_of_a_bank_decide_too() -> None:
    """With the T of a joint with friction (table 1 has 0.8 s and more) λ_q is out of range on any plant."""
    ideal, points = load_parameters("ideal"), (replace(POINT, T_q=0.9),)
    default = compute_default_tuning(ideal, points)
    with pytest.raises(OutOfRangeError, match="λ_q"):
        TuningPreviewer(ideal, points).require_safe(METHOD.lambdas)
    TuningPreviewer(ideal, points).require_safe(default.tuning.lambdas)
    assert default.tuning.lam_q > 0.8


def test_a_bank_is_judged_at_a_motor_lambda_that_is_offered(quick: PlantParameters) -> None:
    entry = BankEntry(10.55, {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342})
    assert require_consistent(quick, [NamedEntry("the entry", entry)]) == (entry,)
