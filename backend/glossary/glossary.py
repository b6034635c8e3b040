"""Builds the glossary from requests, metrics, documents and the texts below."""

import dataclasses
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import get_args

from annotated_types import Ge, Le
from pydantic.fields import FieldInfo

from backend.analysis import SETTLING_BAND, disturbance_metrics, frequency_metrics, identification, step_metrics
from backend.commissioning import StepState
from backend.errors import QUANTITY_LABELS
from backend.faults import EXPLANATIONS, Fault, Limit
from backend.glossary import messages
from backend.identification import Grade, validation
from backend.models import Outcome
from backend.realtime import Cause, HomingEnd, Mode
from backend.schemas import (
    HUGE,
    ActuatorRequest,
    ChainLinkView,
    ChecklistState,
    PushRequest,
    References,
    Schema,
    TimingView,
    TouchOrder,
    TrialRequest,
    TriggerOrder,
    WallView,
)
from backend.storage import EndState
from plant import (
    Quantity,
    SinewError,
)

# Terms ---------------------------------------------------------------------------------------------


class TermKind(StrEnum):
    """Kind of a term, the first part of its key."""

    CONCEPT = "concept"
    SIGNAL = "signal"
    QUANTITY = "quantity"
    PARAMETER = "parameter"
    SETTING = "setting"
    FIGURE = "figure"
    OUTCOME = "outcome"
    CRITERION = "criterion"
    GRADE = "grade"
    END = "end"
    MODE = "mode"
    CAUSE = "cause"
    FAULT = "fault"
    LIMIT = "limit"
    CHAIN = "chain"
    STEP = "step"
    SETUP = "setup"
    TIMING = "timing"


@dataclass(frozen=True)
class GlossaryTerm:
    """One term of the glossary.

    ``name`` is its name in the code, unique within its kind; ``term`` is the displayed symbol or text. ``unit`` is SI.
    ``equation`` is plain text in the notation of docs/reference/notation.md, and ``source`` is where it comes from.
    ``unit``, ``equation`` and ``source`` may be empty. ``more`` has further headings and texts.
    """

    kind: TermKind
    name: str
    term: str
    meaning: str
    unit: str = ""
    equation: str = ""
    source: str = ""
    more: tuple[tuple[str, str], ...] = ()

    @property
    def key(self) -> str:
        """Key by which the page finds the term."""
        return f"{self.kind}:{self.name}"


# Fields of forms -----------------------------------------------------------------------------------
# Texts come from the requests of the forms. Settings of experiments and identifications have their
# own descriptions (``Setting``).


FORMS: dict[str, type[Schema]] = {
    "references": References,
    "push": PushRequest,
    "wall": WallView,
    "touch": TouchOrder,
    "trigger": TriggerOrder,
    "tuning": TrialRequest,
    "identification": ActuatorRequest,
}


_FIELD_LABELS = {
    "push.duration_s": "push duration",
    "touch.contact_N": "contact threshold",
    "touch.learn": "calibrate",
    "touch.forget": "discard the bias",
    "touch.sweep": "calibrate over S",
    "trigger.upper": "upper level",
    "trigger.before_s": "time before the trigger",
    "trigger.after_s": "time after the trigger",
    "tuning.interpolate": "gain interpolation",
    "tuning.duration_s": "trial duration",
    "identification.tensions_N": "tension list",
    "identification.amplitude_rad": "PRBS amplitude",
    "identification.chip_s": "chip duration",
    "identification.bits": "register bits",
    "identification.settle_s": "hold time",
}
"""Labels of fields whose names are abbreviations or contain a unit, by form and name."""


def build_field_terms() -> list[GlossaryTerm]:
    """Return a term for each field of each form that has a description."""
    return [
        _build_field_term(form, name, field)
        for form, request in FORMS.items()
        for name, field in request.model_fields.items()
        if field.description
    ]


def _build_field_term(form: str, name: str, field: FieldInfo) -> GlossaryTerm:
    extra = field.json_schema_extra
    unit = str(extra["unit"]) if isinstance(extra, dict) and "unit" in extra else ""
    meaning = str(field.description).removesuffix(f" [{unit}]")
    low, high = read_bounds(field)
    accepted = () if low is None or high is None else (("Accepted", f"{Quantity(low, unit, high):g}"),)
    label = _FIELD_LABELS.get(f"{form}.{name}") or QUANTITY_LABELS.get(name, name.replace("_", " "))
    return GlossaryTerm(TermKind.SETTING, f"{form}.{name}", label, meaning, "" if unit == "1" else unit, more=accepted)


def read_bounds(field: FieldInfo) -> tuple[float | None, float | None]:
    """Return the bounds that a field declares.

    A bound that depends on the plant is None.
    """
    low = next((float(str(one.ge)) for one in field.metadata if isinstance(one, Ge)), None)
    high = next((float(str(one.le)) for one in field.metadata if isinstance(one, Le)), None)
    return (None if low == -HUGE else low), (None if high == HUGE else high)


# Metrics -------------------------------------------------------------------------------------------
# Texts come from the declarations of the metrics in backend.analysis.


_RMS = "√(1/N Σ ({error})²)"
_DB = "20 log₁₀"

EQUATIONS: dict[str, str] = {
    "rise_q_s": "t(90 %) − t(10 %)",
    "rise_S_s": "t(90 %) − t(10 %)",
    "settling_q_s": "last t with |q − q_ref| > 0.02 |Δq_ref| + count/2, from the step",
    "settling_S_s": "last t with |S − S_ref| > 0.02 |ΔS_ref|, from the step",
    "reach_q_s": "t(90 %) − t(step), of the largest |Δq_ref| with ΔS_ref = 0",
    "reach_bound_q_s": "T_m θ'' + θ' = K_m u_max, until θ = 0.9 Δθ",
    "reach_ratio_q": "reach_q_s / reach_bound_q_s",
    "overshoot_q_percent": "100 max(q − q_ref)/Δq_ref, along the step",
    "overshoot_S_percent": "100 max(S − S_ref)/ΔS_ref, along the step",
    "deviation_S": "max |S − S_ref|",
    "deviation_q": "max |q − q_ref|",
    "rmse_q": _RMS.format(error="q − q_ref"),
    "rmse_S": _RMS.format(error="S − S_ref"),
    "min_tension_N": "min(F_A, F_B)",
    "max_tension_N": "max(F_A, F_B)",
    "peak_voltage_V": "max(|u_A|, |u_B|)",
    "u_rest_rms_V": _RMS.format(error="u − mean u"),
    "rmse_raw_N": _RMS.format(error="F_A − F_B + S_ref q/r_j"),
    "stiffness_felt": "−r_j d(F_A − F_B)/dq",
    "largest_push_N": "max |F_A − F_B|",
    "deviation_A_rad": "max |θ_A − θ_A,ref|",
    "deviation_B_rad": "max |θ_B − θ_B,ref|",
    "error_integral_A": "∫ (θ_A,ref − θ_A) dt",
    "error_integral_B": "∫ (θ_B,ref − θ_B) dt",
    "bandwidth_q_Hz": "f with |G(f)| = 1/√2, G = q/q_ref",
    "bandwidth_S_Hz": "f with |G(f)| = 1/√2, G = S/S_ref",
    "resonance_q_dB": f"{_DB} max(1, |G|), G = q/q_ref",
    "resonance_S_dB": f"{_DB} max(1, |G|), G = S/S_ref",
    "lag_q_deg": "−arg(q/q_ref) at the bandwidth",
    "lag_S_deg": "−arg(S/S_ref) at the bandwidth",
    "gain_off_q_dB": f"max |{_DB} |G| − {_DB} |G_predicted||",
    "gain_off_S_dB": f"max |{_DB} |G| − {_DB} |G_predicted||",
    "phase_off_q_deg": "max |arg G − arg G_predicted|",
    "phase_off_S_deg": "max |arg G − arg G_predicted|",
    "push_deviation_q": "max |q − q_ref|",
    "push_deviation_S": "max |S − S_ref|",
    "pushed_peak_q": "max |q − q(before)|",
    "pushed_peak_S": "max |S − S(before)|",
    "pushed_off_percent": "100 max |measured/predicted − 1|",
    "pushed_static_ratio": "max |q − q(before)|/(r_j F/S)",
    "held_q_swing_counts": "(max q − min q)/count",
    "held_q_swing": "max q − min q",
    "held_u_swing_V": "max u − min u",
    "held_S_swing": "max S − min S",
    "peak_force_N": "max |F_wall|",
    "impulse_Ns": "max ∫ |F_wall| dt",
    "K_m_A": "θ/U = K_m/(s (T_m s + 1))",
    "K_m_B": "θ/U = K_m/(s (T_m s + 1))",
    "T_m_A": "θ/U = K_m/(s (T_m s + 1))",
    "T_m_B": "θ/U = K_m/(s (T_m s + 1))",
    "rms_A_N": _RMS.format(error="F_A − F(x_A)"),
    "rms_B_N": _RMS.format(error="F_B − F(x_B)"),
    "q_deviation": "max |q|",
}
"""Equations of metrics; a metric whose definition is a sentence has none."""


def build_metric_terms() -> list[GlossaryTerm]:
    """Return a term for each metric, with all its definitions in results."""
    results_by_definition: dict[str, dict[str, list[str]]] = {}
    head: dict[str, tuple[str, str]] = {}
    for result, name, label, unit, definition in _list_declared_metrics():
        head.setdefault(name, (label, unit))
        results_by_definition.setdefault(name, {}).setdefault(definition, []).append(result)
    return [_build_metric_term(name, *head[name], results_by_definition[name]) for name in head]


def _build_metric_term(name: str, label: str, unit: str, meanings: dict[str, list[str]]) -> GlossaryTerm:
    """Return the term of a metric.

    ``meanings`` has the names of the results by definition.
    """
    # the definition that most results share comes first
    (first, _), *others = sorted(meanings.items(), key=lambda item: -len(item[1]))
    return GlossaryTerm(
        kind=TermKind.FIGURE,
        name=name,
        term=label,
        meaning=first,
        unit=_omit_one(unit),
        equation=EQUATIONS.get(name, ""),
        source="docs/how-to/experiments.md",
        more=tuple((", ".join(dict.fromkeys(results)), definition) for definition, results in others),
    )


RESULTS = {
    step_metrics.OverallMetrics: "Steps",
    step_metrics.WholeMetrics: "Whole run",
    frequency_metrics.ResponseMetrics: "Response",
    frequency_metrics.BodeMetrics: "Bode",
    disturbance_metrics.ComplianceMetrics: "Compliance",
    disturbance_metrics.DisturbanceMetrics: "Disturbance",
    disturbance_metrics.HoldMetrics: "Hold",
    disturbance_metrics.ImpactMetrics: "Impact",
    disturbance_metrics.PushMetrics: "Push",
    disturbance_metrics.RobustnessMetrics: "Robustness",
    identification.ActuatorMetrics: "Actuator identification",
    identification.MotorMetrics: "Motor identification",
    identification.SpringMetrics: "Spring identification",
}
"""Classes that declare metrics, with the names of their results."""


def _list_declared_metrics() -> list[tuple[str, str, str, str, str]]:
    """Return all declared metrics.

    Each is a tuple: name of the result; name, label, unit and definition of the metric.
    """
    return [
        (result, item.name, item.metadata["label"], item.metadata["unit"], item.metadata["definition"])
        for kind, result in RESULTS.items()
        for item in dataclasses.fields(kind)
        if "definition" in item.metadata
    ]


# Documents -----------------------------------------------------------------------------------------
# Texts of signals, parameters, quantities, faults and limits come from documents in docs/reference.


DOCS = Path(__file__).resolve().parents[2] / "docs"

_SECTIONS = (
    ("Signals", TermKind.SIGNAL),
    ("Parameters of the plant", TermKind.PARAMETER),
    ("Parameters of other mechanisms", TermKind.PARAMETER),
    ("Control", TermKind.QUANTITY),
    ("Identification", TermKind.QUANTITY),
)
_ONE_SOURCE = r"\(\d+\)|table \d|decision \d+|docs/[\w/-]+\.md"
_SOURCE = re.compile(rf"^((?:{_ONE_SOURCE})(?:, (?:{_ONE_SOURCE}))*)(?:: (.*))?$")
_PARTS = ("Cause", "Reaction", "Within", "Remedy")


class GlossaryError(SinewError, ValueError):
    """A document lacks what the glossary needs, or a term is defined twice."""


def parse_concepts(page: str | None = None) -> list[GlossaryTerm]:
    """Return the terms of docs/glossary.md, with the words that each of them replaces.

    Raises GlossaryError for a row without a term or a meaning.
    """
    text = _read_document("glossary.md") if page is None else page
    concepts = []
    for heading in re.findall(r"^## (.+)$", text, re.MULTILINE):
        for row in _parse_table(text, heading):
            if len(row) != 3 or not row[0] or not row[1]:
                raise GlossaryError(messages.term_or_meaning_missing(heading=heading))
            term, meaning, replaced = map(_strip_markup, row)
            more = (("Not used", replaced),) if replaced else ()
            concepts.append(GlossaryTerm(TermKind.CONCEPT, term, term, meaning, source="docs/glossary.md", more=more))
    return concepts


def parse_notation(page: str | None = None) -> list[GlossaryTerm]:
    """Return the terms of docs/reference/notation.md. Raises GlossaryError."""
    text = _read_document("reference/notation.md") if page is None else page
    return [
        entry for heading, kind in _SECTIONS for row in _parse_table(text, heading) for entry in _parse_row(kind, row)
    ]


def parse_faults(page: str | None = None) -> list[GlossaryTerm]:
    """Return the faults of docs/reference/faults.md. Raises GlossaryError.

    Each has cause, reaction, time and remedy.
    """
    text = _read_document("reference/faults.md") if page is None else page
    sections = dict(re.findall(r"^### `(\w+)`\n(.*?)(?=^##|\Z)", text, re.MULTILINE | re.DOTALL))
    return [_build_fault_term(fault, sections.get(fault.value, "")) for fault in Fault if fault is not Fault.NONE]


def parse_limits(page: str | None = None) -> list[GlossaryTerm]:
    """Return the limits of docs/reference/faults.md. Raises GlossaryError."""
    text = _read_document("reference/faults.md") if page is None else page
    meanings = {row[0].strip("`"): row[2] for row in _parse_table(text, "Limits")}
    missing = [str(limit.name) for limit in Limit if limit.name not in meanings]
    if missing:
        raise GlossaryError(messages.limits_not_explained(limits=", ".join(missing)))
    return [
        GlossaryTerm(TermKind.LIMIT, name, _format_words(name), meanings[name], source="docs/reference/faults.md")
        for name in (str(limit.name) for limit in Limit)
    ]


def _parse_row(kind: TermKind, row: list[str]) -> list[GlossaryTerm]:
    """Return a term for each code name in a row of the notation.

    The cells are symbol, code names, unit, meaning and equation.
    """
    symbol, code, unit, meaning, equation = row
    names = re.findall(r"`([\w.]+)`", code)
    if not names or not meaning:
        raise GlossaryError(messages.code_name_or_meaning_missing(symbol=symbol or code))
    symbols = symbol.split(", ") if len(names) > 1 else [symbol]
    units = unit.split(", ") if len(names) > 1 else [unit]
    found = _SOURCE.match(equation)
    source, equation = (_format_source(found[1]), found[2] or "") if found else ("docs/reference/notation.md", equation)
    return [
        GlossaryTerm(
            kind=kind,
            name=name,
            term=(symbols[at] if len(symbols) > at else "") or name,
            meaning=meaning,
            unit=_omit_one(units[min(at, len(units) - 1)]),
            equation=equation,
            source=source,
        )
        for at, name in enumerate(names)
    ]


def _format_source(reference: str) -> str:
    """Return the source of an equation.

    Numbers such as "(16)" and tables are those of the paper.
    """
    if reference.startswith("docs/"):
        return reference
    if reference.startswith("decision "):
        return f"docs/decisions, {reference}"
    word = "equations " if ", (" in reference else "equation "
    return f"paper, {word if reference.startswith('(') else ''}{reference}"


def _build_fault_term(fault: Fault, section: str) -> GlossaryTerm:
    joined = re.sub(r"\n {2}(?=\S)", " ", section)  # list items continue on indented lines
    parts = {part: re.search(rf"^- {part}: (.+)$", joined, re.MULTILINE) for part in _PARTS}
    more = tuple((part, _strip_markup(found[1])) for part, found in parts.items() if found)
    if len(more) != len(_PARTS):
        raise GlossaryError(messages.fault_not_explained(fault=fault.value, needed=", ".join(_PARTS)))
    name = fault.value
    return GlossaryTerm(
        TermKind.FAULT,
        name,
        _format_words(name),
        EXPLANATIONS[fault].message,
        source="docs/reference/faults.md",
        more=more,
    )


def _parse_table(page: str, heading: str) -> list[list[str]]:
    """Return the cells of the table below a heading, without its header."""
    if f"\n## {heading}" not in page:
        raise GlossaryError(messages.section_missing(heading=heading))
    part = page.split(f"\n## {heading}", 1)[1].split("\n## ", 1)[0]
    lines = re.findall(r"^\|(.*)\|$", part, re.MULTILINE)
    return [[cell.strip() for cell in line.split("|")] for line in lines[2:]]


def _strip_markup(text: str) -> str:
    """Return a text without Markdown; a link becomes its text."""
    return re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", text).replace("`", "")


def _format_words(name: str) -> str:
    """Return a name in the code as words, such as "voltage A"."""
    words = name.replace("_", " ").lower()
    return re.sub(r" ([ab])$", lambda side: f" {side[1].upper()}", words)


def _omit_one(unit: str) -> str:
    return "" if unit == "1" else unit


def _read_document(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


# Verdicts and states -------------------------------------------------------------------------------
# Each table has a text for every member of its enumeration. Numbers in the texts come from the code.


OUTCOMES: dict[Outcome, str] = {
    Outcome.PASSED: "Every criterion was measured on the whole run and passed.",
    Outcome.FAILED: "At least one criterion was measured and failed; a single failed criterion is sufficient.",
    Outcome.INCOMPLETE: "The run ended early, or a criterion could not be measured: a criterion passes "
    "only if it was measured completely.",
    Outcome.NEUTRAL: "No verdict: this kind of run has no criteria.",
}

CRITERIA: dict[str, tuple[str, str, str]] = {
    "pass": ("pass", "The metric was measured on the whole run and satisfies its bound.", ""),
    "fail": ("fail", "The metric violates its bound; the measured data suffice for this verdict.", ""),
    "not_measured": (
        "not measured",
        "The metric was not measured, or only in part, for the given reason. The criterion neither passes nor fails.",
        "a step must start from rest; its settling time and overshoot require that it settles within "
        f"±{100 * SETTLING_BAND:g} %",
    ),
}
"""Term, meaning and rule of each result of a criterion."""

GRADES: dict[Grade, tuple[str, str]] = {
    Grade.USABLE: (
        "The model may be used for tuning: it passed every test.",
        f"fit ≥ {validation.GOOD_FIT_PERCENT:g} % on validation data, standard errors of K and T within "
        f"±{validation.CAUTION_STD_PERCENT:g} %, "
        f"gain within {validation.CAUTION_GAIN_ERROR_PERCENT:g} % of the geometric value, no Coulomb friction found",
    ),
    Grade.CAUTION: (
        "The model may be used; the listed reasons describe its uncertainty.",
        f"fit ≥ {validation.MIN_FIT_PERCENT:g} %, standard errors of K and T within "
        f"±{validation.MAX_STD_PERCENT:g} %, gain within "
        f"{validation.MAX_GAIN_ERROR_PERCENT:g} % of the geometric value",
    ),
    Grade.UNUSABLE: (
        "Do not compute gains from this model, for the listed reasons.",
        f"less than {validation.MIN_COUNTS:g} counts of motion, fit < {validation.MIN_FIT_PERCENT:g} %, "
        f"a standard error of K or T beyond ±{validation.MAX_STD_PERCENT:g} %, "
        f"or gain more than {validation.MAX_GAIN_ERROR_PERCENT:g} % from the geometric value",
    ),
}
"""Meaning and rule of each grade; a number that could not be computed never improves a grade."""

ENDS: dict[EndState, str] = {
    EndState.RUNNING: "The run is in progress: samples are still recorded.",
    EndState.COMPLETED: "The program of the run was completed, or the session was ended normally.",
    EndState.STOPPED: "A person or the service stopped the run before its end.",
    EndState.TRIPPED: "A fault stopped the run; the flight record contains the samples around the trip.",
    EndState.LINK_LOST: "The page that held control was lost, or the control loop died or was restarted.",
    EndState.SERVICE_DIED: "The service failed or hung, and the control loop stopped automatically.",
}

MODES: dict[Mode, str] = {
    Mode.OFF: "Zero volts; the tendons are slack.",
    Mode.PRETENSION: "Both motors wind up the tendons to a tension of 10 N and hold it.",
    Mode.RUN: "The position and stiffness loops are closed and follow the references; all samples are recorded.",
    Mode.COMPLIANCE: "The position loop is open: q_ref acts through the geometry only, and a push moves the joint. "
    "Stiffness stays controlled.",
    Mode.IDENTIFY: "An excitation is applied to identify motors, springs or the actuator.",
    Mode.EXPERIMENT: "The control loop executes a program of references.",
    Mode.STOPPING: "The control loop brings the joint to rest under tension, then sets zero volts.",
    Mode.TRIPPED: "A fault is latched at zero volts; Reset returns to mode off after the cause is removed.",
}

CAUSES: dict[Cause | HomingEnd, str] = {
    Cause.ASKED_FOR: "A person or a script requested this mode.",
    Cause.PROGRAM: "An experiment or identification started its program.",
    Cause.PROGRAM_ENDED: "A program ended.",
    Cause.CONTACT: "A contact was detected; the joint is compliant until a mode is chosen.",
    Cause.STANDING: "A soft stop has brought the joint to rest.",
    Cause.RESET: "A latched fault was acknowledged.",
    Cause.MOTOR_TRIAL: "The bring-up tests the direction of a motor at low voltage.",
    Cause.MOTOR_TRIED: "The test of a motor's direction has ended.",
    Cause.HOMING: "The bring-up drives the joint to its end switch.",
    HomingEnd.HOMED: "The end switch closed at the expected position and set the zero of the joint.",
    HomingEnd.NOT_REACHED: "The joint reached the end of its travel without reaching the end switch; no zero was set.",
    HomingEnd.STUCK_CLOSED: "The end switch did not open as the joint left it; no zero was set.",
    HomingEnd.WRONG_WAY: "The joint moved away from the end switch; no zero was set.",
    HomingEnd.JOINT_HELD: "The joint did not follow the motors; no zero was set.",
    HomingEnd.MOTOR_OFF: "A motor did not reach its reference; no zero was set.",
    HomingEnd.TENSION: "The tension of a tendon exceeded the limit of homing; no zero was set.",
    HomingEnd.SLACK: "A tendon went slack during homing; no zero was set.",
    HomingEnd.TOO_LONG: "Homing exceeded its time limit; no zero was set.",
}

CHAIN: dict[str, tuple[str, str]] = {
    "page": ("Page in control", "The page that holds control sends heartbeats. After 2 s without one, the "
             "control loop holds its references; 2 s later it stops softly."),
    "service": ("Service", "The control loop receives the heartbeat of the service; after 0.34 s without one, it "
                "stops softly."),
    "loop": ("Control loop", "The control loop sends samples at 1 kHz; after 1 s without one, the service reports its "
             "failure."),
    "watchdog": ("Watchdog, drive-enable", "The card disables the drives if the control loop does not write in "
                 "time; a proof test verifies this at each start."),
    "safety_module": ("Safety module", "Independent of the control loop: it disables the motors at F_max or at the "
                      "end of the joint's range and stays tripped until a person acknowledges the trip at the rig."),
}  # fmt: skip
"""Term and meaning of each link of the safety chain."""

STEPS: dict[StepState, str] = {
    StepState.NEVER: "This step of the bring-up has not been done for this wiring.",
    StepState.CURRENT: "Done, and valid for this wiring; the period of validity has not ended.",
    StepState.OUT_OF_DATE: "Done, but out of date: the wiring has changed, a later wiring test has failed, "
    "the control loop has been restarted (Zero, Homing), or the period of validity has ended.",
    StepState.FAILED: "The last execution failed.",
}

SETUP: dict[ChecklistState, str] = {
    ChecklistState.MISSING: "No result of this step is stored yet.",
    ChecklistState.DONE: "The result exists and was created with the active settings.",
    ChecklistState.OUTDATED: "The result was created with other parameters or another bank, or an earlier "
    "step has been repeated since.",
    ChecklistState.UNUSABLE: "The result exists, but its verdict is “not usable”.",
}

TIMING: dict[str, str] = {
    "rate_Hz": "Loop",
    "lateness_p50_ms": "Late p50",
    "lateness_p99_ms": "Late p99",
    "overruns": "Overruns",
}
"""Terms of the header for fields of ``TimingView``, whose descriptions are the meanings."""

ROUND_TRIP_TIME = GlossaryTerm(
    TermKind.TIMING, "latency_ms", "Link", "round-trip time of a message between this page and the service", "ms"
)


def build_verdict_terms() -> list[GlossaryTerm]:
    """Return the terms of verdicts and states, in the order of their enumerations."""
    return [
        *(
            GlossaryTerm(TermKind.OUTCOME, one.value, one.value, text, source="docs/how-to/experiments.md")
            for one, text in OUTCOMES.items()
        ),
        *(
            GlossaryTerm(TermKind.CRITERION, name, term, text, more=_build_rule(rule))
            for name, (term, text, rule) in CRITERIA.items()
        ),
        *(
            GlossaryTerm(
                TermKind.GRADE,
                one.value,
                one.value,
                text,
                source="docs/explanation/identification.md",
                more=_build_rule(rule),
            )
            for one, (text, rule) in GRADES.items()
        ),
        *_build_plain_terms(TermKind.END, ENDS.items(), "docs/how-to/notebook.md"),
        *_build_plain_terms(TermKind.MODE, MODES.items(), ""),
        *_build_plain_terms(TermKind.CAUSE, CAUSES.items(), ""),
        *(
            GlossaryTerm(TermKind.CHAIN, name, *CHAIN[name], source="docs/reference/faults.md")
            for name in list_chain_links()
        ),
        *_build_plain_terms(TermKind.STEP, STEPS.items(), "docs/how-to/rig.md"),
        *_build_plain_terms(TermKind.SETUP, SETUP.items(), ""),
    ]


def build_timing_terms() -> list[GlossaryTerm]:
    """Return the terms of timing and round-trip time in the header."""
    terms = []
    for name, term in TIMING.items():
        field = TimingView.model_fields[name]
        unit = _find_unit(field.json_schema_extra)
        terms.append(GlossaryTerm(TermKind.TIMING, name, term, str(field.description).removesuffix(f" [{unit}]"), unit))
    return [*terms, ROUND_TRIP_TIME]


def list_chain_links() -> tuple[str, ...]:
    """Return the links of the safety chain in order."""
    return get_args(ChainLinkView.model_fields["name"].annotation)


def _build_plain_terms(kind: TermKind, texts: Iterable[tuple[StrEnum, str]], source: str) -> list[GlossaryTerm]:
    return [GlossaryTerm(kind, one.value, one.value.replace("_", " "), text, source=source) for one, text in texts]


def _build_rule(rule: str) -> tuple[tuple[str, str], ...]:
    return (("Rule", rule),) if rule else ()


def _find_unit(extra: object) -> str:
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


# Glossary ------------------------------------------------------------------------------------------


def build_glossary() -> dict[str, GlossaryTerm]:
    """Return all terms by key. Raises GlossaryError."""
    listed = [
        *parse_concepts(),
        *parse_notation(),
        *build_field_terms(),
        *build_metric_terms(),
        *build_verdict_terms(),
        *parse_faults(),
        *parse_limits(),
        *build_timing_terms(),
    ]
    found: dict[str, GlossaryTerm] = {}
    for entry in listed:
        if found.setdefault(entry.key, entry) is not entry:
            raise GlossaryError(messages.term_explained_twice(key=entry.key))
    return found


def render_glossary_typescript() -> str:
    """Return the glossary as a TypeScript module, without empty fields."""
    entries = {key: _drop_empty_fields(entry) for key, entry in build_glossary().items()}
    kinds = json.dumps([str(kind) for kind in TermKind])
    written = json.dumps(entries, indent=2, ensure_ascii=False)
    return "\n".join(
        (
            "// Generated by `python -m backend.api.export`. Do not edit.",
            "",
            f"export const KINDS = {kinds} as const;",
            "",
            "export interface Entry {",
            "  readonly kind: (typeof KINDS)[number];",
            "  readonly name: string;",
            "  readonly term: string;",
            "  readonly meaning: string;",
            "  readonly unit?: string;",
            "  readonly equation?: string;",
            "  readonly source?: string;",
            "  readonly more?: readonly (readonly [string, string])[];",
            "}",
            "",
            f"export const GLOSSARY: Readonly<Record<string, Entry>> = {written};",
            "",
        )
    )


def _drop_empty_fields(entry: GlossaryTerm) -> dict[str, object]:
    return {name: value for name, value in vars(entry).items() if value}
