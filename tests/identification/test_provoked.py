"""Two hundred provoked records: no "usable" that is wrong, and no good record refused without need.

A "usable" is wrong where gain or sum of lags is off by more than 5 % and by more than four of the standard errors that
are stated, or where no model is true at all.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from backend.identification.estimation import estimate_model
from backend.identification.models import Grade
from backend.identification.motor import identify_motor_record
from backend.identification.records import IdentificationError, Record
from tests.identification.record_generator import FAULTY, GOOD, Provoked, each, provoked, without_lag

KINDS = {**GOOD, **FAULTY}
SEEDS = range(10)
AT_LEAST_CAUTION = 0.97
"""Share of the good records that must be usable or usable with caution."""
FIRST_OF_EACH = [*each(KINDS, range(1))]


@dataclass(frozen=True)
class Outcome:
    """Grade, and errors of gain and lag in shares of the truth and in standard errors; ``refusal`` in place of them."""

    grade: Grade | None
    off: tuple[float, ...] = ()
    in_std: tuple[float, ...] = ()
    words: str = ""

    @property
    def wrong(self) -> bool:
        """Whether it is a "usable" that should not be."""
        far = any(off > 0.05 and std > 4.0 for off, std in zip(self.off, self.in_std, strict=True))
        return self.grade is Grade.USABLE and (not self.off or far)


def outcome(case: Provoked) -> Outcome:
    try:
        record = Record(case.period_s, case.u, case.y, **case.more)
        if case.structure == "motor":
            motor = identify_motor_record(record)
            verdict, found, std = motor.verdict, (motor.K_m, motor.T_m), motor.std_errors[:2]
        else:
            linear = estimate_model(record, case.structure)
            reduced = linear.first_order
            verdict, found, std = linear.verdict, (reduced.K, reduced.T), reduced.deviations
    except IdentificationError as refusal:
        return Outcome(None, words=str(refusal))
    if case.truth is None:
        return Outcome(verdict.grade, words=verdict.sentence)
    errors = [abs(value - truth) for value, truth in zip(found, case.truth, strict=True)]
    return Outcome(
        verdict.grade,
        tuple(error / abs(truth) for error, truth in zip(errors, case.truth, strict=True)),
        tuple(error / one if one > 0.0 else np.inf for error, one in zip(errors, std, strict=True)),
        verdict.sentence,
    )


@pytest.mark.parametrize(("kind", "seed"), FIRST_OF_EACH)
def test_the_first_record_of_each_kind(kind: str, seed: int) -> None:
    found = outcome(provoked(kind, seed))
    assert not found.wrong, found
    if kind in GOOD:
        assert found.grade in (Grade.USABLE, Grade.CAUTION), found
    else:
        assert found.grade is not Grade.USABLE, found


def test_none_of_all_provoked_records_is_usable_and_wrong() -> None:
    outcomes = {(kind, seed): outcome(provoked(kind, seed)) for kind, seed in each(KINDS, SEEDS)}
    assert len(outcomes) >= 200
    assert [(at, found) for at, found in outcomes.items() if found.wrong] == []
    good = [found.grade in (Grade.USABLE, Grade.CAUTION) for (kind, _), found in outcomes.items() if kind in GOOD]
    assert np.mean(good) >= AT_LEAST_CAUTION


@pytest.mark.parametrize("case", without_lag())
@pytest.mark.parametrize("structure", ["first", "first+delay", "order:2", "order:3+delay", "third", "lags3", "motor"])
def test_an_output_without_lag_ends_in_a_verdict_that_is_not_wrong(case: str, structure: str) -> None:
    u, y = without_lag()[case]
    found = outcome(Provoked(u, y, structure, None, 1e-3))
    assert found.words
    assert "nan" not in found.words
    if case not in ("one sample late", "square"):
        assert found.grade is not Grade.USABLE, found


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("saturated_output", "saturated"),
        ("wrong_period", "sample time"),
        ("dead_time_left_out", "a dead time would help"),
        ("wrapped_angle", "unwrap"),
        ("unnamed_loop", "--setpoint or --controller"),
        ("dry_friction", "dry (Coulomb) friction"),
        ("order_too_low", "would help"),
        ("step_from_rest", "takes one step only"),
    ],
)
def test_what_is_wrong_is_named(kind: str, said: str) -> None:
    assert said in outcome(provoked(kind, 0)).words
