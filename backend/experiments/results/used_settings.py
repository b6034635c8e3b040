"""What a stored run was set to, as far as its control law uses it: for page, report and command line. Pure."""

import json
from collections.abc import Sequence

from backend.banks.tuning_settings import DECLARED, NAMES
from backend.models.run import DeclaredValue
from backend.realtime.program import IDENTIFYING, Law
from backend.storage.runs import Run, RunKind

_OF_KIND = {
    RunKind.COMPLIANCE: Law.COMPLIANCE,
    RunKind.ACTUATOR_IDENTIFICATION: Law.FORCE_HOLD,
    RunKind.MOTOR_IDENTIFICATION: Law.MOTOR_STEPS,
    RunKind.SPRING_IDENTIFICATION: Law.TENSION_SWEEP,
}
_WITHOUT_CASCADE = ("lam_q", "lam_S")
USED: dict[Law, tuple[str, ...]] = {
    Law.CASCADE: NAMES,
    Law.COMPLIANCE: tuple(name for name in NAMES if name not in ("lam_q", "k_ext")),
    Law.SINGLE_LOOP: _WITHOUT_CASCADE,
    Law.FEEDBACK_LINEARIZATION: _WITHOUT_CASCADE,
    **dict.fromkeys(IDENTIFYING, ("lam_motor",)),
}
"""Parts of the tuning that each law uses; an open position loop rejects no push and has no λ_q."""


def law_of(run: Run) -> Law:
    """Return the control law that a run was played under; the cascade for a session."""
    plan = run.set_to.plan or {}
    if "experiment" in plan:
        named = json.loads(str(plan["experiment"])).get("law", Law.CASCADE)
        return Law(str(plan.get(named, named)))
    return _OF_KIND.get(RunKind(run.kind)) or Law(run.set_to.law)


def used_settings(run: Run) -> Sequence[DeclaredValue]:
    """Return the settings of a run in order, without the parts of the tuning that its law does not use.

    Programs store them declared; a session has a tuning only.
    """
    stored = run.set_to
    if stored.declared is None:
        tuning = stored.loop.known()
        return [
            DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, tuning[setting.name])
            for setting in DECLARED
            if setting.name in tuning
        ]
    unused = set(NAMES) - set(USED[law_of(run)])
    if stored.loop.budget == 0.0:
        unused.add("u_plan")
    return [item for item in stored.declared if item.name not in unused]
