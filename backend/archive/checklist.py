"""How far the set-up has got, and what no longer holds, told from what is stored."""

from collections.abc import Callable

from backend.banks.tuning_settings import SAVED, saved_for
from backend.models.document import UnreadableDocumentError
from backend.schemas.run import ChecklistState, ChecklistStep
from backend.storage import banks, identifications, origins, results, runs, settings
from backend.storage.banks import Bank, name_of_entry
from backend.storage.database import Session
from backend.storage.identifications import Identification
from backend.storage.orm import Document
from backend.storage.runs import EndState, Run, RunKind

NEAR = 0.5
"""Two identifications closer than this in S [N·m/rad] are of the same point."""

Found = Identification | None


def steps(session: Session, parameters: Document, in_use: int | None) -> list[ChecklistStep]:
    """Return the steps in order, for the plant's present ``parameters`` and the number of the bank ``in_use``."""
    imported = origins.numbers_of(session, origins.IDENTIFICATION)
    estimates = [one for one in identifications.find(session) if one.id not in imported]

    def run_of(estimate: Identification) -> Run | None:
        return None if estimate.run_id is None else runs.get(session, estimate.run_id)

    motor, spring = _newest(estimates, "motor"), _newest(estimates, "spring")
    actuator = _newest(estimates, "actuator")
    bank = banks.get(session, in_use) if in_use is not None else next(iter(banks.find(session)), None)
    experiment = _newest_run(session, (RunKind.TRACKING, RunKind.COMPLIANCE))
    return [
        _pretension(next(iter(runs.find(session, limit=1)), None)),
        _identified("motor", motor, run_of, parameters, ()),
        _identified("spring", spring, run_of, parameters, ()),
        _identified("actuator", actuator, run_of, parameters, (motor, spring)),
        _bank(bank, in_use, estimates, run_of, parameters),
        _tuning(session, bank, in_use),
        _experiment(experiment, in_use),
        _report(session, experiment),
    ]


def _pretension(run: Run | None) -> ChecklistStep:
    if run is None:
        return _step("pretension", ChecklistState.MISSING, "no run yet: wind both tendons up")
    return _step("pretension", ChecklistState.DONE, f"last used in run {run.id}", run)


def _identified(
    name: str,
    estimate: Found,
    run_of: Callable[[Identification], Run | None],
    parameters: Document,
    before: tuple[Found, ...],
) -> ChecklistStep:
    if estimate is None:
        return _step(name, ChecklistState.MISSING, "not identified yet")
    run = run_of(estimate)
    if not estimate.usable:
        return _step(name, ChecklistState.UNUSABLE, estimate.verdict, run)
    if run is not None and _numbers(run.parameters, name) != _numbers(parameters, name):
        return _step(
            name, ChecklistState.OUTDATED, f"made with other parameters of the plant ({run.parameters_name})", run
        )
    for other in before:
        if other is not None and other.created_at > estimate.created_at:
            return _step(name, ChecklistState.OUTDATED, f"older than the identification of the {other.kind}", run)
    return _step(name, ChecklistState.DONE, estimate.verdict, run)


def _numbers(parameters: Document, name: str) -> Document:
    """Return what an identification rests on: motors and springs are measured whatever the controller knows of them."""
    if name == "actuator":
        return parameters
    return {section: entries for section, entries in parameters.items() if not section.startswith("identified")}


def _bank(
    bank: Bank | None,
    in_use: int | None,
    estimates: list[Identification],
    run_of: Callable[[Identification], Run | None],
    parameters: Document,
) -> ChecklistStep:
    if bank is None:
        return _step("bank", ChecklistState.MISSING, "none built: the gains follow from geometry")
    title = f"{bank.name} v{bank.version}"
    by_id = {estimate.id: estimate for estimate in estimates}
    sources = [by_id[entry.identification_id] for entry in bank.entries if entry.identification_id in by_id]
    for source in sources:
        run = run_of(source)
        if run is not None and run.parameters != parameters:
            entry = next(name_of_entry(one) for one in bank.entries if one.identification_id == source.id)
            detail = f"{title} is older than the plant's parameters: its {entry} entry, run {run.id}, is of others"
            return _step("bank", ChecklistState.OUTDATED, detail, at=bank)
        newer = next((one for one in estimates if replaces(one, source)), None)
        if newer is not None:
            detail = f"{title} is older than the identification of run {newer.run_id} at the same point"
            return _step("bank", ChecklistState.OUTDATED, detail, at=bank)
    if bank.id != in_use:
        return _step("bank", ChecklistState.MISSING, f"{title} is built but not in use: activate it", at=bank)
    return _step("bank", ChecklistState.DONE, f"{title} in use", at=bank)


def replaces(one: Identification, source: Identification) -> bool:
    """Return whether ``one`` is a newer usable identification at the point of ``source``."""
    if one.kind != source.kind or not one.usable or one.created_at <= source.created_at:
        return False
    try:
        a, b = one.early_model.S_nominal, source.early_model.S_nominal
    except UnreadableDocumentError:
        return False
    return a is not None and b is not None and abs(a - b) < NEAR


def _tuning(session: Session, bank: Bank | None, in_use: int | None) -> ChecklistStep:
    """Return whether somebody has saved λ for the bank in use."""
    if bank is None or bank.id != in_use:
        return _step("tuning", ChecklistState.MISSING, "needs a bank in use")
    title = f"{bank.name} v{bank.version}"
    stored = settings.newest(session, saved_for(bank.id))
    if stored is None:
        return _step("tuning", ChecklistState.MISSING, f"{title} has the default λ: choose them, and press Save")
    parts = SAVED.read(stored.value, f"setting “{stored.name}”").known()
    told = ", ".join(
        f"λ_{name} = {float(parts[key]):g} s" for name, key in (("q", "lam_q"), ("S", "lam_S")) if key in parts
    )
    detail = f"{told}, saved for {title} by {stored.who}"
    return ChecklistStep(name="tuning", state=ChecklistState.DONE, detail=detail, run=None, at=stored.at)


def _experiment(run: Run | None, in_use: int | None) -> ChecklistStep:
    if run is None:
        return _step("experiment", ChecklistState.MISSING, "none completed yet")
    if run.bank_id != in_use:
        return _step("experiment", ChecklistState.OUTDATED, f"run {run.id} was made with another bank", run)
    return _step("experiment", ChecklistState.DONE, f"{run.kind}, run {run.id}", run)


def _report(session: Session, run: Run | None) -> ChecklistStep:
    if run is None:
        return _step("report", ChecklistState.MISSING, "needs an experiment")
    kept = [one for form in ("html", "pdf") if (one := results.newest_report(session, run.id, form)) is not None]
    if not kept:
        return _step("report", ChecklistState.MISSING, f"run {run.id} has no report yet: open it", run)
    return _step("report", ChecklistState.DONE, f"made of run {run.id}", run)


def _newest(estimates: list[Identification], kind: str) -> Found:
    """Return the newest usable estimate of a kind, else the newest at all."""
    of_kind = [estimate for estimate in estimates if estimate.kind == kind]
    return next((estimate for estimate in of_kind if estimate.usable), next(iter(of_kind), None))


def _newest_run(session: Session, kinds: tuple[RunKind, ...]) -> Run | None:
    found = runs.find(session, kinds=kinds, ended=EndState.COMPLETED, limit=1)
    return found[0] if found else None


def _step(
    name: str, state: ChecklistState, detail: str, run: Run | None = None, *, at: Bank | None = None
) -> ChecklistStep:
    when = at.created_at if at is not None else None if run is None else run.started_at
    return ChecklistStep(name=name, state=state, detail=detail, run=None if run is None else run.id, at=when)
