"""The experiments that can be ordered by name, from the browser and from the command line alike."""

from dataclasses import dataclass

from backend.experiments.plans.compliance_plan import CompliancePlan
from backend.experiments.plans.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.plans.plan import ActuatorIdentificationPlan, IdentificationPlan, TrackingPlan
from backend.experiments.plans.robustness_plan import RobustnessPlan
from backend.experiments.plans.sequence_plan import SequencePlan
from backend.experiments.settings import SettingError


@dataclass(frozen=True)
class Entry:
    """An experiment with the words that present it."""

    plan: type[TrackingPlan] | type[CompliancePlan] | type[RobustnessPlan] | type[SequencePlan]
    title: str
    description: str


EXPERIMENTS: dict[str, Entry] = {
    TrackingPlan.kind: Entry(
        TrackingPlan,
        "Tracking of position and stiffness",
        "Experiment 1 of the paper (figure 7): position steps at constant stiffness, stiffness pulses at constant "
        "position, then both at once.",
    ),
    CompliancePlan.kind: Entry(
        CompliancePlan,
        "Compliance under pushes",
        "Experiment 2 of the paper (figure 8): pushes on the joint with the position loop open; the measured force "
        "against the one that stiffness and geometry expect.",
    ),
    RobustnessPlan.kind: Entry(
        RobustnessPlan,
        "Robustness under a load",
        "The paper's disturbance: 0.375 N·m at the gearbox shaft, 50 N more on the reel, on and off at one motor after "
        "the other. On the simulator; a rig that cannot load its shafts to order refuses it.",
    ),
    SequencePlan.kind: Entry(
        SequencePlan,
        "Own sequence",
        "Steps, ramps and sines of both references, one after the other, as a JSON list of segments.",
    ),
}


@dataclass(frozen=True)
class IdentificationEntry:
    """Something that can be identified, with the words that present it."""

    plan: type[IdentificationPlan]
    title: str
    description: str


IDENTIFICATIONS: dict[str, IdentificationEntry] = {
    "actuator": IdentificationEntry(
        ActuatorIdentificationPlan,
        "Actuator",
        "How joint position and stiffness follow motor A, in closed loop: a binary sequence around a held tension.",
    ),
    "motor": IdentificationEntry(
        MotorIdentificationPlan,
        "Motors",
        "Gain, time constant and dry friction of both motors: voltage steps up and down with slack tendons.",
    ),
    "spring": IdentificationEntry(
        SpringIdentificationPlan,
        "Springs",
        "Force over elongation of both springs: a slow sweep of both tensions up and down.",
    ),
}


def experiment(name: str) -> Entry:
    """Return the experiment of this name. Raises SettingError with those there are."""
    if name not in EXPERIMENTS:
        known = tuple(EXPERIMENTS)
        raise SettingError("name", name, f"there is no such experiment; known: {', '.join(known)}", legal=known)
    return EXPERIMENTS[name]
