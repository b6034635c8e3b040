"""The experiments that can be ordered by name, from the browser and from the command line alike."""

from dataclasses import dataclass

from backend.experiments.plans import TrackingPlan
from backend.experiments.settings import SettingError


@dataclass(frozen=True)
class Entry:
    """An experiment with the words that present it."""

    plan: type[TrackingPlan]
    title: str
    description: str


EXPERIMENTS: dict[str, Entry] = {
    TrackingPlan.kind: Entry(
        TrackingPlan,
        "Tracking of position and stiffness",
        "Experiment 1 of the paper (figure 7): position steps at constant stiffness, stiffness pulses at constant "
        "position, then both at once.",
    )
}


def experiment(name: str) -> Entry:
    """Return the experiment of this name. Raises SettingError with those there are."""
    if name not in EXPERIMENTS:
        known = tuple(EXPERIMENTS)
        raise SettingError("name", name, f"there is no such experiment; known: {', '.join(known)}", legal=known)
    return EXPERIMENTS[name]
