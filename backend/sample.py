"""The sample: one row per tick, defined once.

The shared-memory ring, the stored recording, the websocket frame, the exports and the TypeScript types all derive
from ``FIELDS``. A new signal is a new row here, and its value by name in ``backend.control.step.write_row``.
``COMBINED`` are signals that nobody stores: what is drawn of them follows from the columns.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Literal

from backend.documented import ANSWER, HIDDEN


@dataclass(frozen=True)
class Field:
    """One column of a sample.

    ``name`` is the spelling everywhere (Python, SQL, JSON, TypeScript, CSV); ``symbol`` is what a person reads;
    ``unit`` is SI, "1" for counts and codes. Columns that ``derived`` marks follow from the index of the row, so
    that recording and wire leave them out and rebuild them.
    """

    __pydantic_config__ = ANSWER

    name: str
    symbol: str
    unit: str
    meaning: str
    derived: bool = field(default=False, metadata=HIDDEN)


@dataclass(frozen=True)
class Term:
    """A column times ``sign``, and times a length of the joint's geometry where ``length`` names one."""

    column: str
    sign: Literal[1, -1]
    length: Literal["", "r_m", "r_j"] = ""


@dataclass(frozen=True)
class Combined:
    """A signal that is the sum of its terms, tick by tick; ``name`` and ``unit`` as of a column."""

    name: str
    unit: str
    meaning: str
    terms: tuple[Term, Term]


FIELDS: tuple[Field, ...] = (
    Field("tick", "k", "1", "index of the sample since the loop started", derived=True),
    Field("t", "t", "s", "tick times the sampling period", derived=True),
    Field(
        "mode",
        "mode",
        "1",
        "mode of the loop: 0 off, 1 pretension, 2 run, 3 compliance, 4 identify, 5 experiment, 6 stopping, 7 tripped",
    ),
    Field("run", "run", "1", "identifier of the stored run this sample belongs to, 0 for none"),
    Field("q", "q", "rad", "joint position, measured"),
    Field("q_ref", "q_ref", "rad", "joint position reference as commanded"),
    Field("q_ref_gov", "q_ref,gov", "rad", "joint position reference after the governor, or of the trajectory"),
    Field("q_dot", "dq/dt", "rad/s", "joint velocity, estimated from the encoder"),
    Field("S", "S", "N·m/rad", "joint stiffness, estimated from measured angles and the identified spring"),
    Field("S_ref", "S_ref", "N·m/rad", "joint stiffness reference as commanded"),
    Field("S_ref_gov", "S_ref,gov", "N·m/rad", "joint stiffness reference after the governor, or of the trajectory"),
    Field("S_true", "S_true", "N·m/rad", "joint stiffness of the simulator, NaN on the rig"),
    Field("theta_A", "θ_A", "rad", "motor A position at the gearbox outlet, measured"),
    Field("theta_A_ref", "θ_A,ref", "rad", "motor A position reference"),
    Field("theta_B", "θ_B", "rad", "motor B position at the gearbox outlet, measured"),
    Field("theta_B_ref", "θ_B,ref", "rad", "motor B position reference"),
    Field("F_A", "F_A", "N", "tension of tendon A, load cell"),
    Field("F_B", "F_B", "N", "tension of tendon B, load cell"),
    Field("u_A", "u_A", "V", "motor A voltage, after limits"),
    Field("u_B", "u_B", "V", "motor B voltage, after limits"),
    Field("F_push", "F_push", "N", "external push applied by the simulator, tangential at r_j"),
    Field("F_ext_hat", "F_ext", "N", "external force at r_j, estimated from encoders and springs, bias subtracted"),
    Field("F_wall", "F_wall", "N", "force of a simulated obstacle on the joint at r_j, NaN on the rig"),
    Field("V_A", "V_A", "V", "load cell A as read by the card, NaN without a card"),
    Field("V_B", "V_B", "V", "load cell B as read by the card, NaN without a card"),
    Field("n_q", "n_q", "1", "counts of the joint's encoder since the start, NaN without a card"),
    Field("n_A", "n_A", "1", "counts of motor A's encoder since the start, NaN without a card"),
    Field("n_B", "n_B", "1", "counts of motor B's encoder since the start, NaN without a card"),
    Field("lam_q", "λ_q", "s", "active tuning parameter of the position loop"),
    Field("lam_S", "λ_S", "s", "active tuning parameter of the stiffness loop"),
    Field("bank_entry", "entry", "1", "active entry of the controller bank, fractional while interpolating"),
    Field("limits", "limits", "1", "limits that acted in this tick, one bit each; docs/reference/faults.md lists them"),
    Field("fault", "fault", "1", "number of the latched fault in the list of docs/reference/faults.md, 0 for none"),
    Field("lateness_s", "late", "s", "delay of the start of the tick against its deadline"),
    Field("overruns", "overruns", "1", "deadlines missed since the loop started"),
)

NAMES: tuple[str, ...] = tuple(field.name for field in FIELDS)
INDEX: dict[str, int] = {name: position for position, name in enumerate(NAMES)}
STORED: tuple[Field, ...] = tuple(field for field in FIELDS if not field.derived)
STORED_NAMES: tuple[str, ...] = tuple(field.name for field in STORED)
ADDED_LATER: frozenset[str] = frozenset({"F_ext_hat", "F_wall"})
"""Signals that recordings and exports of earlier versions lack."""
STORED_COLUMNS: list[int] = [INDEX[name] for name in STORED_NAMES]
"""Where the stored fields stand in a row; a list, because numpy takes a tuple for one place in several dimensions."""


def _difference(of: str, taken: str, meaning: str) -> Combined:
    unit = FIELDS[INDEX[of]].unit
    return Combined(f"{of} - {taken}", unit, meaning, (Term(of, 1), Term(taken, -1)))


COMBINED: tuple[Combined, ...] = (
    _difference("q", "q_ref", "error of the joint position against its reference"),
    _difference("q", "q_ref_gov", "error of the joint position against the governed reference, or the trajectory"),
    _difference("S", "S_ref", "error of the joint stiffness against its reference"),
    _difference("S", "S_ref_gov", "error of the joint stiffness against the governed reference, or the trajectory"),
    _difference("S", "S_true", "error of the estimated joint stiffness against that of the simulator"),
    _difference("theta_A", "theta_A_ref", "error of the position of motor A against its reference"),
    _difference("theta_B", "theta_B_ref", "error of the position of motor B against its reference"),
    _difference("F_A", "F_B", "force that the tendons turn the joint with, at r_j"),
    Combined(
        "x_A", "m", "elongation of spring A, by the measured angles", (Term("theta_A", 1, "r_m"), Term("q", -1, "r_j"))
    ),
    Combined(
        "x_B", "m", "elongation of spring B, by the measured angles", (Term("theta_B", 1, "r_m"), Term("q", 1, "r_j"))
    ),
)
COMBINED_BY_NAME: dict[str, Combined] = {combined.name: combined for combined in COMBINED}
UNIT_OF: dict[str, str] = {field.name: field.unit for field in STORED} | {one.name: one.unit for one in COMBINED}
"""Unit of everything that can be drawn."""


def nearest(name: str, known: Iterable[str] = UNIT_OF) -> str:
    """Return the known name that is most like a wrong one."""
    names = list(known)
    alike = [one for one in names if one.lower() == name.lower()]
    return (alike or get_close_matches(name, names, 1, 0.0))[0]
