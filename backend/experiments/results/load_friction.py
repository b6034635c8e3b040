"""Load-dependent Coulomb friction from stored actuator identifications at several tensions. Nothing is stored."""

from collections.abc import Sequence
from dataclasses import asdict

from backend.experiments.plans.plan import ActuatorIdentificationPlan
from backend.experiments.plans.stored_plan import stored_plan
from backend.experiments.results.actuator_identification import excitation_start
from backend.experiments.results.metrics import NoSamplesError
from backend.identification.friction import COLUMNS, LoadFrictionResult, TensionRun, estimate_load_friction
from backend.models.document import Document, UnreadableDocumentError
from backend.recording.reader import Columns, missing_between, recorded_columns
from backend.storage.database import Database
from backend.storage.runs import EndState, Run, RunKind
from plant.interface import T_s

MOTOR_B = "motor B is held still in this experiment, so its friction is not measured"


def load_friction_of(played: Sequence[tuple[Run, Columns]]) -> LoadFrictionResult:
    """Return c0 and c1 of motor A from runs with their samples; others than actuator identifications do not count.

    All have to be of the plant, station and parameters of the newest one: other motors have other friction.
    """
    made = [(run, columns) for run, columns in played if run.kind == RunKind.ACTUATOR_IDENTIFICATION]
    if not made:
        return estimate_load_friction((), 0.0)
    newest = max((run for run, _ in made), key=lambda run: run.id)
    usable: list[TensionRun] = []
    left_out: list[str] = []
    for run, columns in made:
        if _rig(run) != _rig(newest):
            left_out.append(f"run {run.id}: plant, station or parameters are not those of run {newest.id}")
            continue
        try:
            usable.append(_excited(run, columns))
        except (NoSamplesError, UnreadableDocumentError) as error:
            left_out.append(f"run {run.id}: {error}")
    found = estimate_load_friction(usable, newest.number("geometry", "r_m"))
    return LoadFrictionResult(found.estimate, found.problem, (*left_out, *found.left_out))


def load_friction_of_newest(database: Database, made: Sequence[Run]) -> LoadFrictionResult:
    """Return the same of stored runs: the newest completed one at each tension that was asked for."""
    newest: dict[object, Run] = {}
    for run in sorted(made, key=lambda run: run.id, reverse=True):
        if run.end_state == EndState.COMPLETED:
            newest.setdefault((run.set_to.plan or {}).get("tension_N"), run)
    chosen = sorted(newest.values(), key=lambda run: run.id)
    return load_friction_of([(run, recorded_columns(database, run.id)[0]) for run in chosen])


def document_of(found: LoadFrictionResult) -> Document:
    """Return the result as plain data, SI units, with the sentence that people read."""
    return {
        "estimate": None if found.estimate is None else asdict(found.estimate),
        "problem": found.problem,
        "sentence": found.sentence,
        "left_out": [*found.left_out],
    }


def _rig(run: Run) -> tuple[str, str, Document]:
    return run.plant, run.station, run.parameters


def _excited(run: Run, columns: Columns) -> TensionRun:
    plan = stored_plan(run.kind, run.set_to.plan or {})
    if not isinstance(plan, ActuatorIdentificationPlan):
        raise NoSamplesError("it has no excitation")
    if run.end_state != EndState.COMPLETED:
        raise NoSamplesError(f"it ended as {run.end_state}")
    start = excitation_start(columns, plan.excitation())
    if missing_between({"t": columns["t"][start:]}):
        raise NoSamplesError("samples of its excitation are missing")
    return TensionRun(run.id, T_s, {name: columns[name][start:] for name in COLUMNS if name in columns})
