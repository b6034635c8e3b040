"""Applied results of motor and spring identifications: their effect, their author, and how to revert them."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.analysis.identification import fit_spring_table
from backend.control.decoupler import build_decoupler, stiffness
from backend.identification.models import Grade
from backend.models.identification import (
    MOTOR_MODELS,
    MOTOR_QUALITIES,
    IdentifiedMotor,
    MotorConstants,
    MotorFit,
    MotorModels,
    MotorQualities,
    MotorQuality,
)
from backend.models.run import AppliedParameters
from backend.services import parameters
from backend.services.parameters import (
    NotApplicableError,
    build_proposal,
    find_changes,
    list_parameter_versions,
    load_active_parameters,
)
from backend.storage import identifications
from backend.storage.database import Database, open_database
from backend.storage.identifications import Identification, NewIdentification
from backend.tuning.gains import make_motor_loops
from backend.tuning.robustness import linearize_one_motor
from plant.parameters import ParameterError, load_parameters
from tests.reasons import TextWith
from tests.refusals import refused

LAB = load_parameters("lab")
K = (-2.7, 350.0, 9000.0)


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


def motors(A: tuple[float, float], B: tuple[float, float]) -> NewIdentification:
    """Return an identification of both motors with these K_m and T_m."""
    models, nothing = [], MotorConstants(0.01, 0.01)
    for K_m, T_m in (A, B):
        known = MotorFit(K_m, T_m, 0.07)
        models.append(
            IdentifiedMotor(known, MotorFit(0.001, 0.001, 0.001), True, (), MotorConstants(K_m, T_m), nothing, nothing)
        )
    quality = MotorQuality(rms_counts=1.0, grade=Grade.USABLE, verdict="usable", refused=(), steps=())
    return NewIdentification(
        kind="motor",
        run_id=None,
        data={},
        method="least squares on position",
        options={},
        model=MOTOR_MODELS.write(MotorModels(A=models[0], B=models[1])),
        quality=MOTOR_QUALITIES.write(MotorQualities(quality, quality)),
        usable=True,
        verdict="usable",
        who="Ana",
        software="0",
    )


def stored(database: Database, new: NewIdentification) -> Identification:
    with database.session() as session:
        return identifications.add(session, new)


def spring() -> NewIdentification:
    """Return an identification from a table of the spring K, with the noise of a load cell."""
    x, noise = np.linspace(0.01, 0.05, 200), np.random.default_rng(1).normal(0.0, 0.05, 200)
    F = K[0] + K[1] * x + K[2] * x**2 + noise
    rows = "\n".join(f"{at:.6f},{force:.6f}" for at, force in zip(x, F, strict=True))
    return fit_spring_table("bench.csv", f"x [m],F [N]\n{rows}\n", "Ana", "0")


def test_applied_motor_parameters_change_the_controller_and_not_the_simulated_plant(database: Database) -> None:
    found = stored(database, motors((2.3, 0.21), (2.4, 0.23)))
    then = LAB.with_identified(parameters.build_identified_sections(build_proposal(LAB, LAB, found)))
    assert [(one.name, one.side, one.before, one.after) for one in find_changes(LAB, then)] == [
        ("K_m", "A", 2.86, 2.3),
        ("T_m", "A", 0.22, 0.21),
        ("K_m", "B", 2.86, 2.4),
        ("T_m", "B", 0.22, 0.23),
    ]
    assert then.make_dynamics() == LAB.make_dynamics()
    assert (then.spring, then.motor, then.geometry, then.sensors) == (LAB.spring, LAB.motor, LAB.geometry, LAB.sensors)
    gains = make_motor_loops(
        then, 0.0854
    )  # the motor loops are designed for these motors, so they have the same four lags of λ
    assert linearize_one_motor(then, gains, 10.55).T_q == pytest.approx(4 * 0.0854 + LAB.geometry.B_j / 10.55, rel=2e-3)
    assert gains.A.k_i == pytest.approx(0.21**2 / (2.3 * 0.0854**3 * (4 * 0.21 - 0.0854)))


def test_an_applied_spring_changes_the_estimated_stiffness(database: Database) -> None:
    found = stored(database, spring())
    then = LAB.with_identified(parameters.build_identified_sections(build_proposal(LAB, LAB, found)))
    assert then.select_identified("A").k == pytest.approx(K, rel=0.03)
    g = LAB.geometry
    expected = 2.0 * g.r_j**2 * (K[1] + K[2] * g.r_m * 7.0)
    assert stiffness(build_decoupler(then), 4.0, 3.0) == pytest.approx(expected, rel=3e-3)
    assert stiffness(build_decoupler(LAB), 4.0, 3.0) != pytest.approx(expected, rel=1e-2)
    assert then.make_dynamics() == LAB.make_dynamics()


def test_parameter_versions_accumulate_and_undo_restores_the_previous_one(database: Database) -> None:
    first, second = stored(database, motors((2.3, 0.21), (2.4, 0.23))), stored(database, spring())
    for found, who in ((first, "Ana"), (second, "Ben")):
        with database.session() as session:
            parameters.store_parameters(session, build_proposal(LAB, load_active_parameters(database, LAB), found), who)
    both, one, file = list_parameter_versions(database, LAB)
    assert [(item.number, item.who) for item in (both, one, file)] == [(2, "Ben"), (1, "Ana"), (0, "")]
    assert file.parameters == LAB
    assert both.parameters.select_identified("B").K_m == 2.4  # the spring does not change the applied motors
    assert len({item.digest for item in (both, one, file)}) == 3

    undo(database, "Cy")
    newest = list_parameter_versions(database, LAB)[0]
    assert (newest.number, newest.who, newest.digest) == (3, "Cy", one.digest)
    assert newest.applied is not None
    assert newest.applied.undone
    undo(database, "Cy")  # undoing the undo restores the change
    assert list_parameter_versions(database, LAB)[0].digest == both.digest


def undo(database: Database, who: str) -> AppliedParameters:
    applied = parameters.build_undo(database, LAB)
    with database.session() as session:
        parameters.store_parameters(session, applied, who)
    return applied


def test_parameters_applied_to_one_file_are_not_active_on_another(database: Database) -> None:
    applied = build_proposal(LAB, LAB, stored(database, motors((2.3, 0.21), (2.4, 0.23))))
    with database.session() as session:
        parameters.store_parameters(session, applied, "Ana")
    ideal = load_parameters("ideal")
    assert load_active_parameters(database, LAB) != LAB
    assert load_active_parameters(database, ideal) == ideal


def test_inapplicable_parameters_are_rejected_with_a_reason(database: Database) -> None:
    with refused(NotApplicableError, "no_parameters_to_undo"):
        parameters.build_undo(database, LAB)
    same = stored(database, motors((2.86, 0.22), (2.86, 0.22)))
    with refused(NotApplicableError, "values_are_active_already"):
        build_proposal(LAB, LAB, same)
    bad = stored(database, replace(motors((2.3, 0.21), (2.4, 0.23)), usable=False, verdict="hardly moved"))
    with refused(NotApplicableError, "identification_not_usable", verdict="hardly moved"):
        build_proposal(LAB, LAB, bad)
    beyond = stored(database, motors((2.3, 0.21), (2400.0, 0.23)))
    out_of_range = {"label": TextWith(r"identified_B\.K_m"), "value": 2400.0, "minimum": 0.001, "maximum": 1000.0}
    with refused(ParameterError, "parameter_out_of_range", **out_of_range):
        build_proposal(LAB, LAB, beyond)
