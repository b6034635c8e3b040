"""Identification of G_q and G_S from the columns of the closed-loop experiment.

Method section 4, figures 4 and 5.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import pi
from typing import Any

import numpy as np

from backend.identification import messages
from backend.identification.estimation import Candidates, estimate_model, rank
from backend.identification.fitting import Method
from backend.identification.models import Estimate, Verdict, worst_grade
from backend.identification.records import IdentificationError, Record, Signal

STRUCTURES = ("order:4", "lags4", "third", "first")
"""Candidate structures of G_q and G_S: the inner loop alone has four lags; third and first order are the paper's."""

ARX_STRUCTURES = ("first",)
"""Candidate structures of ARX: at third order and 1 ms, rounding of single precision already affects standard
errors."""

_REST_S = 0.5


@dataclass(frozen=True)
class ActuatorGeometry:
    """Known geometry: radii [m], k2 of the spring [N/m²], encoder counts per turn."""

    r_m: float
    r_j: float
    k2: float
    q_counts_per_turn: int = 4000
    theta_counts_per_turn: int = 8000

    @property
    def gain_q(self) -> float:
        """Static gain from theta_A to q at equilibrium, r_m / (2 r_j)."""
        return self.r_m / (2.0 * self.r_j)

    @property
    def gain_S(self) -> float:
        """Static gain from theta_A to S, 2 r_j² k2 r_m [N·m/rad per rad]."""
        return 2.0 * self.r_j**2 * self.k2 * self.r_m

    @property
    def q_resolution(self) -> float:
        """One count of the joint encoder [rad]."""
        return 2.0 * pi / self.q_counts_per_turn

    @property
    def S_resolution(self) -> float:
        """Change of the stiffness estimate per count of a motor encoder [N·m/rad]."""
        return self.gain_S * 2.0 * pi / self.theta_counts_per_turn


@dataclass(frozen=True)
class ActuatorIdentification:
    """G_q and G_S at one operating point, each the best of its candidates.

    ``S_nominal`` [N·m/rad] and ``q_nominal`` [rad] are the values at rest before the excitation; ``motion_counts`` is
    the peak-to-peak of q during the excitation in encoder counts. ``arx_q`` and ``arx_S`` are the results of the
    paper's method, ARX of first order, on the same record, or the reason why there are none; they serve for comparison,
    never for tuning.
    """

    G_q: Estimate
    G_S: Estimate
    candidates_q: Candidates
    candidates_S: Candidates
    S_nominal: float
    q_nominal: float
    motion_counts: float
    verdict: Verdict
    arx_q: Estimate | str
    arx_S: Estimate | str

    def to_json(self) -> dict[str, Any]:
        """Return plain dictionaries, lists and numbers."""
        return {
            "G_q": self.G_q.to_json(),
            "G_S": self.G_S.to_json(),
            "candidates_q": self.candidates_q.to_json(),
            "candidates_S": self.candidates_S.to_json(),
            "S_nominal": self.S_nominal,
            "q_nominal": self.q_nominal,
            "motion_counts": self.motion_counts,
            "verdict": {**asdict(self.verdict), "sentence": self.verdict.sentence},
        }


def identify_actuator(
    samples: Mapping[str, Signal],
    period_s: float,
    geometry: ActuatorGeometry,
    start: int,
    structures: Sequence[str] | None = None,
    method: Method = Method.DEFAULT,
) -> ActuatorIdentification:
    """Identify theta_A_ref -> q and theta_A_ref -> S from the samples of one run.

    ``samples`` holds the columns theta_A_ref, q and S, shape (n,) each; ``start`` is the index at which the excitation
    begins, the samples before it show the state at rest. The default ``structures`` depend on the method. Raises
    RecordError, StructureError and NotConvergedError.
    """
    structures = structures or (ARX_STRUCTURES if method is Method.ARX else STRUCTURES)
    u, q, S = (np.asarray(samples[name], dtype=np.float64) for name in ("theta_A_ref", "q", "S"))
    rest = slice(max(0, start - int(_REST_S / period_s)), max(start, 1))
    q_record, S_record = Record(period_s, u[start:], q[start:]), Record(period_s, u[start:], S[start:])
    q_candidates = rank(
        q_record,
        structures,
        method,
        gain_geometry=geometry.gain_q,
        y_resolution=geometry.q_resolution,
    )
    S_candidates = rank(
        S_record,
        structures,
        method,
        gain_geometry=geometry.gain_S,
        y_resolution=geometry.S_resolution,
    )
    return ActuatorIdentification(
        G_q=q_candidates.best,
        G_S=S_candidates.best,
        candidates_q=q_candidates,
        candidates_S=S_candidates,
        S_nominal=float(np.mean(S[rest])),
        q_nominal=float(np.mean(q[rest])),
        motion_counts=float(np.ptp(q[start:])) / geometry.q_resolution,
        verdict=_joint_verdict(q_candidates.best.verdict, S_candidates.best.verdict),
        arx_q=_by_arx(q_record),
        arx_S=_by_arx(S_record),
    )


def _by_arx(record: Record) -> Estimate | str:
    try:
        return estimate_model(record, "first", Method.ARX)
    except IdentificationError as error:
        return str(error)


def _joint_verdict(G_q: Verdict, G_S: Verdict) -> Verdict:
    """Return the worse grade, with the reasons of only the models that have it."""
    named = {"G_q": G_q, "G_S": G_S}
    grade = worst_grade(*(verdict.grade for verdict in named.values()))
    return Verdict(
        grade,
        tuple(
            messages.reason_of_channel(channel=name, reason=reason)
            for name, verdict in named.items()
            if verdict.grade is grade
            for reason in verdict.reasons
        ),
    )
