"""Words for what is judged and how something stands: outcomes, grades, ends, modes, causes, links, steps.

Each table has an entry for every member of its enumeration; numbers in the words come from the rules themselves.
"""

from collections.abc import Iterable
from enum import StrEnum
from typing import get_args

from backend.analysis.step_metrics import SETTLING_BAND
from backend.commissioning.steps import StepState
from backend.glossary.entry import Entry, Kind
from backend.identification import validation as rule
from backend.identification.models import Grade
from backend.messages.history import ChecklistState
from backend.messages.state import ChainLinkView, TimingView
from backend.models.run import Outcome
from backend.realtime.program import Cause, HomingEnd, Mode
from backend.storage.runs import EndState

OUTCOMES: dict[Outcome, str] = {
    Outcome.PASSED: "Every criterion was measured on the whole run and held.",
    Outcome.FAILED: "At least one criterion was measured and did not hold; one that failed decides.",
    Outcome.INCOMPLETE: "The run ended early, or a criterion could not be measured: nothing passes unseen.",
    Outcome.NEUTRAL: "Nothing to judge by: this kind of run has no criteria.",
}

CRITERIA: dict[str, tuple[str, str, str]] = {
    "pass": ("pass", "The figure was measured on all of the run and lies on the right side of its bound.", ""),
    "fail": ("fail", "The figure lies on the wrong side of its bound; what was seen is enough to say so.", ""),
    "not_measured": (
        "not measured",
        "There is no figure, or not all of it was seen; the reason stands beside it. It is neither passed nor failed.",
        f"a step is measured from rest, and has settled within ±{100 * SETTLING_BAND:g} %",
    ),
}
"""What a criterion may come to: term, meaning, rule."""

GRADES: dict[Grade, tuple[str, str]] = {
    Grade.USABLE: (
        "The model may be used for tuning: no test speaks against it.",
        f"fit ≥ {rule.GOOD_FIT_PERCENT:g} % on unseen data, K and T known to ±{rule.CAUTION_STD_PERCENT:g} %, gain "
        f"within {rule.CAUTION_GAIN_ERROR_PERCENT:g} % of geometry, no dry friction found",
    ),
    Grade.CAUTION: (
        "The model may be used; the reasons beside it say what is doubtful.",
        f"fit ≥ {rule.MIN_FIT_PERCENT:g} %, K and T known to ±{rule.MAX_STD_PERCENT:g} %, gain within "
        f"{rule.MAX_GAIN_ERROR_PERCENT:g} % of geometry",
    ),
    Grade.UNUSABLE: (
        "No gains should be computed from this model; the reasons beside it say why.",
        f"less than {rule.MIN_COUNTS:g} counts of motion, fit < {rule.MIN_FIT_PERCENT:g} %, K or T not known to "
        f"±{rule.MAX_STD_PERCENT:g} %, or gain more than {rule.MAX_GAIN_ERROR_PERCENT:g} % off geometry",
    ),
}
"""Meaning and rule of each grade; figures that could not be had never count in favour."""

ENDS: dict[EndState, str] = {
    EndState.RUNNING: "The run is under way: samples are still recorded.",
    EndState.COMPLETED: "The run came to the end of its program, or a session was ended in the usual way.",
    EndState.STOPPED: "Somebody pressed STOP or ended the service before the run was over.",
    EndState.TRIPPED: "A fault stopped the run; the timing of it is in the flight record.",
    EndState.LINK_LOST: "The page that held control was lost, and the loop stopped softly.",
    EndState.SERVICE_DIED: "The service died or hung, and the loop stopped by itself.",
}

MODES: dict[Mode, str] = {
    Mode.OFF: "Zero volts; the tendons are slack.",
    Mode.PRETENSION: "Both motors wind up from slack until the tendons hold 10 N, and hold them there.",
    Mode.RUN: "The loops of position and stiffness are closed and follow the references; everything is recorded.",
    Mode.COMPLIANCE: "The joint loop is open: q_ref acts through geometry alone and a push moves the joint. "
    "Stiffness stays controlled.",
    Mode.IDENTIFY: "An excitation is played to identify motors, springs or the actuator.",
    Mode.EXPERIMENT: "A program of references is played by the loop itself.",
    Mode.STOPPING: "The joint is brought to rest under tension, then to zero volts.",
    Mode.TRIPPED: "A fault is latched at zero volts; reset leads to off once its cause is gone.",
}

CAUSES: dict[Cause | HomingEnd, str] = {
    Cause.ASKED_FOR: "A person or a script asked for this mode.",
    Cause.PROGRAM: "An experiment or identification began its program.",
    Cause.PROGRAM_ENDED: "A program came to its end.",
    Cause.CONTACT: "A contact was felt, and the joint gives way until a mode is chosen.",
    Cause.STANDING: "A soft stop has brought the joint to rest.",
    Cause.RESET: "A latched fault was acknowledged.",
    Cause.MOTOR_TRIAL: "The bring-up tries the direction of a motor at low voltage.",
    Cause.MOTOR_TRIED: "The trial of a motor's direction is over.",
    Cause.HOMING: "The bring-up drives the joint to its end switch.",
    HomingEnd.HOMED: "The end switch closed where it should: the joint has its zero.",
    HomingEnd.NOT_REACHED: "The joint came to the end of its way without the end switch; no zero was set.",
    HomingEnd.STUCK_CLOSED: "The end switch did not open as the joint left it; no zero was set.",
    HomingEnd.WRONG_WAY: "The joint moved away from the end switch; no zero was set.",
    HomingEnd.JOINT_HELD: "The joint did not follow the motors; no zero was set.",
    HomingEnd.MOTOR_OFF: "A motor did not come to where it was sent; no zero was set.",
    HomingEnd.TENSION: "A tendon pulled harder than homing allows; no zero was set.",
    HomingEnd.SLACK: "A tendon went slack on the way; no zero was set.",
    HomingEnd.TOO_LONG: "Homing took longer than it may; no zero was set.",
}

CHAIN: dict[str, tuple[str, str]] = {
    "page": ("Page in control", "The page that holds control is heard. Lost for 2 s its references are held; "
             "2 s later the loop stops softly."),
    "service": ("Service", "The loop hears the service's beat; without it for 0.34 s the loop stops softly by itself."),
    "loop": ("Loop process", "Samples arrive from the 1 kHz loop; without one for 1 s the loop is not well."),
    "watchdog": ("Watchdog, drive-enable", "The card cuts the drives when the loop does not write in time; it has to "
                 "show that it does before each start."),
    "safety_module": ("Safety module", "Independent of the controller: it cuts the motors at F_max or at the end of "
                      "the joint's range and stays tripped until it is acknowledged at the rig."),
}  # fmt: skip
"""Term and meaning of each link of the safety chain; each watches the one before it."""

STEPS: dict[StepState, str] = {
    StepState.NEVER: "This step of the bring-up has not been done for this wiring.",
    StepState.CURRENT: "Done, and it still holds for this wiring and for the time it is good for.",
    StepState.OUT_OF_DATE: "Done once; wiring, start of the loop or age have made it doubtful since.",
    StepState.FAILED: "Done last without success.",
}

SETUP: dict[ChecklistState, str] = {
    ChecklistState.MISSING: "Nothing of this step is stored yet.",
    ChecklistState.DONE: "There is one, and it was made from what is in force now.",
    ChecklistState.OUTDATED: "There is one, made with other parameters or before what it builds on was made anew.",
    ChecklistState.UNUSABLE: "There is one, and its verdict says not to use it.",
}

TIMING: dict[str, str] = {
    "rate_Hz": "Loop",
    "lateness_p50_ms": "Late p50",
    "lateness_p99_ms": "Late p99",
    "overruns": "Overruns",
}
"""How the header calls what the message of the loop's timing explains."""

LINK = Entry(Kind.TIMING, "latency_ms", "Link", "time from this page to the service and back", "ms")


def verdicts() -> list[Entry]:
    """Return what is said of verdicts and states, in the order of their enumerations."""
    return [
        *(
            Entry(Kind.OUTCOME, one.value, one.value, words, source="docs/experiments.md")
            for one, words in OUTCOMES.items()
        ),
        *(Entry(Kind.CRITERION, name, term, words, more=_rule(held)) for name, (term, words, held) in CRITERIA.items()),
        *(
            Entry(Kind.GRADE, one.value, one.value, words, source="docs/identification.md", more=_rule(held))
            for one, (words, held) in GRADES.items()
        ),
        *_plain(Kind.END, ENDS.items(), "docs/notebook.md"),
        *_plain(Kind.MODE, MODES.items(), ""),
        *_plain(Kind.CAUSE, CAUSES.items(), ""),
        *(Entry(Kind.CHAIN, name, *CHAIN[name], source="docs/faults.md") for name in links()),
        *_plain(Kind.STEP, STEPS.items(), "docs/rig.md"),
        *_plain(Kind.SETUP, SETUP.items(), ""),
    ]


def timing() -> list[Entry]:
    """Return what the header tells of the loop and the link, in the words of the message that carries it."""
    told = []
    for name, term in TIMING.items():
        known = TimingView.model_fields[name]
        unit = _unit(known.json_schema_extra)
        told.append(Entry(Kind.TIMING, name, term, str(known.description).removesuffix(f" [{unit}]"), unit))
    return [*told, LINK]


def links() -> tuple[str, ...]:
    """Return the links of the safety chain in order."""
    return get_args(ChainLinkView.model_fields["name"].annotation)


def _plain(kind: Kind, words: Iterable[tuple[StrEnum, str]], source: str) -> list[Entry]:
    return [Entry(kind, one.value, one.value.replace("_", " "), said, source=source) for one, said in words]


def _rule(held: str) -> tuple[tuple[str, str], ...]:
    return (("Rule", held),) if held else ()


def _unit(extra: object) -> str:
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""
