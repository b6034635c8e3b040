"""Columns of the sample: one row of values per control step.

Ring buffer, recordings, live stream, exports and TypeScript types derive from ``FIELDS``. A new signal is a new row
here, and its value by name in ``backend.control.step.write_row``. ``COMBINED_SIGNALS`` are not stored: charts and
exports compute them from the columns.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Literal

from backend.response_docs import HIDDEN_FIELD, RESPONSE_CONFIG


@dataclass(frozen=True)
class Field:
    """One column of a sample.

    ``name`` is the identifier everywhere (Python, SQL, JSON, TypeScript, CSV); ``symbol`` is shown to people; ``unit``
    is SI, "1" for counts and codes. ``derived`` columns follow from the index of the row: recordings and live stream
    omit them.
    """

    __pydantic_config__ = RESPONSE_CONFIG

    name: str
    symbol: str
    unit: str
    meaning: str
    derived: bool = field(default=False, metadata=HIDDEN_FIELD)


@dataclass(frozen=True)
class Term:
    """A column times ``sign`` and, if ``length`` is set, times that joint dimension."""

    column: str
    sign: Literal[1, -1]
    length: Literal["", "r_m", "r_j"] = ""


@dataclass(frozen=True)
class CombinedSignal:
    """A signal that is the sum of its terms in each tick."""

    name: str
    unit: str
    meaning: str
    terms: tuple[Term, Term]


FIELDS: tuple[Field, ...] = (
    Field("tick", "k", "1", "index of the control step since the control loop started", derived=True),
    Field("t", "t", "s", "tick times the sampling period", derived=True),
    Field(
        "mode",
        "mode",
        "1",
        "mode of the control loop: 0 off, 1 pretension, 2 run, 3 compliance, 4 identify, 5 experiment, 6 stopping, "
        "7 tripped",
    ),
    Field("run", "run", "1", "number of the stored run of the sample, 0 for none"),
    Field("q", "q", "rad", "measured joint position"),
    Field("q_ref", "q_ref", "rad", "commanded joint position reference"),
    Field("q_ref_gov", "q_ref,gov", "rad", "joint position reference from the reference governor or the trajectory"),
    Field("q_dot", "dq/dt", "rad/s", "joint velocity, estimated from the encoder"),
    Field("S", "S", "N·m/rad", "joint stiffness, estimated from measured angles and the identified spring"),
    Field("S_ref", "S_ref", "N·m/rad", "commanded joint stiffness reference"),
    Field(
        "S_ref_gov", "S_ref,gov", "N·m/rad", "joint stiffness reference from the reference governor or the trajectory"
    ),
    Field("S_true", "S_true", "N·m/rad", "joint stiffness of the simulator, NaN on the rig"),
    Field("theta_A", "θ_A", "rad", "measured position of motor A at the gearbox output"),
    Field("theta_A_ref", "θ_A,ref", "rad", "position reference of motor A"),
    Field("theta_B", "θ_B", "rad", "measured position of motor B at the gearbox output"),
    Field("theta_B_ref", "θ_B,ref", "rad", "position reference of motor B"),
    Field("F_A", "F_A", "N", "tension of tendon A, measured by its load cell"),
    Field("F_B", "F_B", "N", "tension of tendon B, measured by its load cell"),
    Field("u_A", "u_A", "V", "voltage of motor A after limiting"),
    Field("u_B", "u_B", "V", "voltage of motor B after limiting"),
    Field("F_push", "F_push", "N", "push applied by the simulator, tangential at r_j"),
    Field("F_ext_hat", "F_ext", "N", "external force at r_j, estimated from encoders and springs, bias subtracted"),
    Field("F_wall", "F_wall", "N", "force of a simulated obstacle on the joint at r_j, NaN on the rig"),
    Field("V_A", "V_A", "V", "voltage of load cell A as read by the card, NaN without a card"),
    Field("V_B", "V_B", "V", "voltage of load cell B as read by the card, NaN without a card"),
    Field("n_q", "n_q", "1", "counts of the joint encoder since the control loop started, NaN without a card"),
    Field("n_A", "n_A", "1", "counts of the encoder of motor A since the control loop started, NaN without a card"),
    Field("n_B", "n_B", "1", "counts of the encoder of motor B since the control loop started, NaN without a card"),
    Field("lam_q", "λ_q", "s", "active tuning parameter of the position loop"),
    Field("lam_S", "λ_S", "s", "active tuning parameter of the stiffness loop"),
    Field("bank_entry", "entry", "1", "active operating point of the bank, fractional during interpolation"),
    Field(
        "limits",
        "limits",
        "1",
        "limits that were active in this control step, one bit each; docs/reference/faults.md lists them",
    ),
    Field("fault", "fault", "1", "code of the latched fault as listed in docs/reference/faults.md, 0 for none"),
    Field("lateness_s", "late", "s", "delay of the start of the control step relative to its deadline"),
    Field("overruns", "overruns", "1", "deadlines missed since the control loop started"),
)

NAMES: tuple[str, ...] = tuple(field.name for field in FIELDS)
INDEX: dict[str, int] = {name: position for position, name in enumerate(NAMES)}
STORED: tuple[Field, ...] = tuple(field for field in FIELDS if not field.derived)
STORED_NAMES: tuple[str, ...] = tuple(field.name for field in STORED)
ADDED_LATER: frozenset[str] = frozenset({"F_ext_hat", "F_wall"})
"""Signals that recordings and exports of earlier versions lack."""
STORED_COLUMNS: list[int] = [INDEX[name] for name in STORED_NAMES]
"""Positions of the stored fields in a row.

A list: numpy would take a tuple for one index in several dimensions.
"""


def _make_difference(minuend: str, subtrahend: str, meaning: str) -> CombinedSignal:
    unit = FIELDS[INDEX[minuend]].unit
    return CombinedSignal(f"{minuend} - {subtrahend}", unit, meaning, (Term(minuend, 1), Term(subtrahend, -1)))


COMBINED_SIGNALS: tuple[CombinedSignal, ...] = (
    _make_difference("q", "q_ref", "deviation of the joint position from its reference"),
    _make_difference("q", "q_ref_gov", "deviation of the joint position from the reference of governor or trajectory"),
    _make_difference("S", "S_ref", "deviation of the joint stiffness from its reference"),
    _make_difference("S", "S_ref_gov", "deviation of the joint stiffness from the reference of governor or trajectory"),
    _make_difference("S", "S_true", "deviation of the estimated joint stiffness from that of the simulator"),
    _make_difference("theta_A", "theta_A_ref", "deviation of the position of motor A from its reference"),
    _make_difference("theta_B", "theta_B_ref", "deviation of the position of motor B from its reference"),
    _make_difference("F_A", "F_B", "net force of the tendons on the joint at r_j"),
    CombinedSignal(
        "x_A", "m", "elongation of spring A from the measured angles", (Term("theta_A", 1, "r_m"), Term("q", -1, "r_j"))
    ),
    CombinedSignal(
        "x_B", "m", "elongation of spring B from the measured angles", (Term("theta_B", 1, "r_m"), Term("q", 1, "r_j"))
    ),
)
COMBINED_SIGNAL_BY_NAME: dict[str, CombinedSignal] = {combined.name: combined for combined in COMBINED_SIGNALS}
UNIT_BY_SIGNAL: dict[str, str] = {field.name: field.unit for field in STORED} | {
    one.name: one.unit for one in COMBINED_SIGNALS
}
"""Unit of each signal that can be drawn."""


def find_nearest_name(name: str, known: Iterable[str] = UNIT_BY_SIGNAL) -> str:
    """Return the known name that is most similar to a misspelled one."""
    names = list(known)
    same_letters = [known_name for known_name in names if known_name.lower() == name.lower()]
    return (same_letters or get_close_matches(name, names, 1, 0.0))[0]
