"""A model beside data that it was not fitted to: what was measured, what the model says, and how far apart they are.

Where the data begins in the middle of things, initial state, offset and ramp are no part of the model: they are
found by least squares on that data, as in every fit here.
"""

from dataclasses import dataclass, replace

import numpy as np

from backend.identification.errors import IdentificationError
from backend.identification.fit import Fit, refit
from backend.identification.linearisation import WHITE, Evaluation, Problem, least_squares
from backend.identification.record import Record, Signal
from backend.identification.result import Model
from backend.identification.structures import structure

TRAINING_PART = 2.0 / 3.0
"""Share of a record that a model is fitted to when the rest has to be data that it has not seen."""


@dataclass(frozen=True)
class Beside:
    """Measured and predicted output, shape (n,) each, from sample ``first`` of the record on."""

    first: int
    measured: Signal
    predicted: Signal

    @property
    def fit_percent(self) -> float:
        """100 (1 - |y - y_hat| / |y - mean y|)."""
        return fit_percent(self.measured - self.predicted, self.measured - np.mean(self.measured))

    @property
    def rms(self) -> float:
        """RMS of measured minus predicted, in the unit of the output."""
        return float(np.sqrt(np.mean((self.measured - self.predicted) ** 2)))


def fit_percent(error: Signal, motion: Signal) -> float:
    """Share of the motion that a model explains [%], from what it leaves over and the motion about its mean.

    Raises IdentificationError where nothing moved.
    """
    if np.ptp(motion) == 0.0:
        raise IdentificationError(
            "nothing moved in what the model is to be compared with: there is no motion to explain"
        )
    return 100.0 * (1.0 - float(np.linalg.norm(error)) / float(np.linalg.norm(motion)))


def seen_samples(record: Record) -> int:
    """Return how many samples of a record, from its first on, a model is fitted to when the rest is to be unseen."""
    return int(TRAINING_PART * record.u.size)


def last_part(record: Record) -> Record:
    """Return the part of a record that is left aside. Raises RecordError where it holds nothing."""
    return record.part(seen_samples(record), record.u.size)


def beside(problem: Problem, parameters: Signal) -> Beside:
    """Set a structure with these parameters beside the record of ``problem``. Raises UnstableModelError."""
    here = Evaluation(problem.unweighted, parameters)
    unknown = least_squares(here.nuisance, here.error)
    left_over = here.error - here.nuisance @ unknown
    y = problem.record.y[problem.first :]
    return Beside(problem.first, y, y - left_over[problem.first :])


def predict(model: Model, record: Record) -> Beside:
    """Set a model beside a record that it was not fitted to. Raises UnstableModelError."""
    return beside(Problem(record, structure(model.structure), WHITE), model.vector)


def held_out(found: Fit) -> Beside:
    """Set a model of the first two thirds of a record beside its last third, fitted as ``found`` was.

    Raises IdentificationError, LinAlgError where one of them holds nothing.
    """
    record = found.problem.record
    trained = refit(found, record.part(0, seen_samples(record))).parameters
    return beside(replace(found.problem, record=last_part(record)), trained)
