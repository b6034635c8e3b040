"""Lineage and events of runs, and the checklist of the setup."""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Any

from backend.banks import saved_tuning_key
from backend.models import SAVED_TUNING, UnreadableDocumentError, document_digest
from backend.recording import CodecError, compute_recording_digest
from backend.schemas import (
    Checklist,
    ChecklistState,
    ChecklistStep,
    Lineage,
    LineageBank,
    LineageEntry,
    LineageKind,
    LineageNode,
    RunMark,
    RunMarks,
)
from backend.services import record_messages
from backend.storage import (
    Bank,
    Database,
    Document,
    EndState,
    Event,
    EventKind,
    Identification,
    Origin,
    Run,
    RunKind,
    Session,
    UnknownRecordError,
    banks,
    commissioning,
    events,
    identifications,
    iterate_parameters,
    origins,
    recordings,
    results,
    run_title,
    runs,
    session_station,
    settings,
    stored_entry_name,
)
from plant import PlantChoice, PlantKind, PlantParameters

# Checklist -----------------------------------------------------------------------------------------


SAME_POINT_S = 0.5
"""Identifications closer than this in S [N·m/rad] have the same operating point."""

OptionalIdentification = Identification | None


def build_checklist(session: Session, parameters: Document, in_use: int | None) -> list[ChecklistStep]:
    """Return the steps of the setup in order, with the state of each.

    ``parameters`` are the present parameters of the plant, ``in_use`` is the number of the active bank.
    """
    imported = origins.load_imported_numbers(session, origins.IDENTIFICATION)
    estimates = [one for one in identifications.find(session) if one.id not in imported]

    def run_of(estimate: Identification) -> Run | None:
        return None if estimate.run_id is None else runs.get(session, estimate.run_id)

    motor, spring = _find_newest(estimates, "motor"), _find_newest(estimates, "spring")
    actuator = _find_newest(estimates, "actuator")
    bank = banks.get(session, in_use) if in_use is not None else next(iter(banks.find(session)), None)
    experiment = _find_newest_run(session, (RunKind.TRACKING, RunKind.COMPLIANCE))
    return [
        _check_pretension(next(iter(runs.find(session, limit=1)), None)),
        _check_identification("motor", motor, run_of, parameters, ()),
        _check_identification("spring", spring, run_of, parameters, ()),
        _check_identification("actuator", actuator, run_of, parameters, (motor, spring)),
        _check_bank(bank, in_use, estimates, run_of, parameters),
        _check_tuning(session, bank, in_use),
        _check_experiment(experiment, in_use),
        _check_report(session, experiment),
    ]


def _check_pretension(run: Run | None) -> ChecklistStep:
    if run is None:
        return _build_step("pretension", ChecklistState.MISSING, record_messages.no_run_yet())
    return _build_step("pretension", ChecklistState.DONE, record_messages.last_used_in_run(run=run.id), run)


def _check_identification(
    name: str,
    estimate: OptionalIdentification,
    run_of: Callable[[Identification], Run | None],
    parameters: Document,
    before: tuple[OptionalIdentification, ...],
) -> ChecklistStep:
    if estimate is None:
        return _build_step(name, ChecklistState.MISSING, record_messages.not_identified_yet())
    run = run_of(estimate)
    if not estimate.usable:
        return _build_step(name, ChecklistState.UNUSABLE, estimate.verdict, run)
    if run is not None and _select_relevant_parameters(run.parameters, name) != _select_relevant_parameters(
        parameters, name
    ):
        return _build_step(
            name, ChecklistState.OUTDATED, record_messages.made_with_other_parameters(name=run.parameters_name), run
        )
    for other in before:
        if other is not None and other.created_at > estimate.created_at:
            return _build_step(
                name, ChecklistState.OUTDATED, record_messages.older_than_identification(kind=other.kind), run
            )
    return _build_step(name, ChecklistState.DONE, estimate.verdict, run)


def _select_relevant_parameters(parameters: Document, name: str) -> Document:
    """Return the parameters on which an identification depends.

    Identifications of motors and springs do not depend on the identified values.
    """
    if name == "actuator":
        return parameters
    return {section: entries for section, entries in parameters.items() if not section.startswith("identified")}


def _check_bank(
    bank: Bank | None,
    in_use: int | None,
    estimates: list[Identification],
    run_of: Callable[[Identification], Run | None],
    parameters: Document,
) -> ChecklistStep:
    if bank is None:
        return _build_step("bank", ChecklistState.MISSING, record_messages.no_bank_built())
    title = f"{bank.name} v{bank.version}"
    by_id = {estimate.id: estimate for estimate in estimates}
    sources = [by_id[entry.identification_id] for entry in bank.entries if entry.identification_id in by_id]
    for source in sources:
        run = run_of(source)
        if run is not None and run.parameters != parameters:
            entry = next(stored_entry_name(one) for one in bank.entries if one.identification_id == source.id)
            detail = record_messages.bank_unlike_parameters(bank=title, entry=entry, run=run.id)
            return _build_step("bank", ChecklistState.OUTDATED, detail, at=bank)
        newer = next((one for one in estimates if is_newer_at_same_point(one, source)), None)
        if newer is not None:
            detail = record_messages.bank_older_than_identification(bank=title, run=newer.run_id)
            return _build_step("bank", ChecklistState.OUTDATED, detail, at=bank)
    if bank.id != in_use:
        return _build_step("bank", ChecklistState.MISSING, record_messages.bank_not_active(bank=title), at=bank)
    return _build_step("bank", ChecklistState.DONE, record_messages.bank_is_active(bank=title), at=bank)


def is_newer_at_same_point(one: Identification, source: Identification) -> bool:
    """Return whether ``one`` is a newer usable estimate at the point of ``source``."""
    if one.kind != source.kind or not one.usable or one.created_at <= source.created_at:
        return False
    try:
        return abs(one.actuator.model.S_nominal - source.actuator.model.S_nominal) < SAME_POINT_S
    except UnreadableDocumentError:
        return False


def _check_tuning(session: Session, bank: Bank | None, in_use: int | None) -> ChecklistStep:
    """Return whether λ was saved for the active bank."""
    if bank is None or bank.id != in_use:
        return _build_step("tuning", ChecklistState.MISSING, record_messages.active_bank_needed())
    title = f"{bank.name} v{bank.version}"
    stored = settings.newest(session, saved_tuning_key(bank.id))
    if stored is None:
        return _build_step("tuning", ChecklistState.MISSING, record_messages.default_lambda(bank=title))
    parts = SAVED_TUNING.read(stored.value, f"setting “{stored.name}”").get_known_values()
    lambdas = {name: float(parts[key]) for name, key in (("q", "lam_q"), ("S", "lam_S")) if key in parts}
    detail = record_messages.saved_tuning(lambdas=lambdas, bank=title, who=stored.who)
    return ChecklistStep(name="tuning", state=ChecklistState.DONE, detail=detail, run=None, at=stored.at)


def _check_experiment(run: Run | None, in_use: int | None) -> ChecklistStep:
    if run is None:
        return _build_step("experiment", ChecklistState.MISSING, record_messages.no_experiment_yet())
    if run.bank_id != in_use:
        return _build_step("experiment", ChecklistState.OUTDATED, record_messages.run_used_other_bank(run=run.id), run)
    return _build_step(
        "experiment", ChecklistState.DONE, record_messages.newest_experiment(kind=run.kind, run=run.id), run
    )


def _check_report(session: Session, run: Run | None) -> ChecklistStep:
    if run is None:
        return _build_step("report", ChecklistState.MISSING, record_messages.completed_experiment_needed())
    stored_items = [
        one for form in ("html", "pdf") if (one := results.newest_report(session, run.id, form)) is not None
    ]
    if not stored_items:
        return _build_step("report", ChecklistState.MISSING, record_messages.run_without_report(run=run.id), run)
    return _build_step("report", ChecklistState.DONE, record_messages.report_created(run=run.id), run)


def _find_newest(estimates: list[Identification], kind: str) -> OptionalIdentification:
    """Return the newest usable estimate of a kind, or the newest one."""
    of_kind = [estimate for estimate in estimates if estimate.kind == kind]
    return next((estimate for estimate in of_kind if estimate.usable), next(iter(of_kind), None))


def _find_newest_run(session: Session, kinds: tuple[RunKind, ...]) -> Run | None:
    found = runs.find(session, kinds=kinds, ended=EndState.COMPLETED, limit=1)
    return found[0] if found else None


def _build_step(
    name: str, state: ChecklistState, detail: str, run: Run | None = None, *, at: Bank | None = None
) -> ChecklistStep:
    when = at.created_at if at is not None else None if run is None else run.started_at
    return ChecklistStep(name=name, state=state, detail=detail, run=None if run is None else run.id, at=when)


# Lineage -------------------------------------------------------------------------------------------
# The lineage of a run is a graph of gains, banks, identifications, samples, parameters and
# calibrations. The digest of a node depends on its content only (``document_digest``,
# ``compute_recording_digest``): equal digests mean equal content in any database.


MAX_DIGEST_BYTES = 30_000_000
"""Largest recording whose digest a request computes: 20 minutes, in half a second."""
_MAX_CACHED = 500
_MAX_NAMED = 3
"""Number of differing parameters that a message names."""
_CALIBRATED = {PlantChoice(kind).name for kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD)}

Digest = tuple[str | None, str]
"""In hex, or None with the reason."""


class SampleDigests:
    """Computes and caches digests of recordings, which do not change after the run."""

    def __init__(self, largest_bytes: int) -> None:
        self._largest_bytes = largest_bytes
        self._known: OrderedDict[tuple[int, int], str] = OrderedDict()

    def compute_digest(self, session: Session, run: Run) -> Digest:
        """Return the digest of a run's samples."""
        if run.end_state == EndState.RUNNING:
            return None, record_messages.run_still_in_progress()
        try:
            recording = recordings.get(session, run.id)
            key = run.id, recording.size_bytes
            if key not in self._known:
                if recording.size_bytes > self._largest_bytes:
                    return None, record_messages.recording_too_long_for_digest(run=run.id)
                self._known[key] = compute_recording_digest(session, run.id)
                if len(self._known) > _MAX_CACHED:
                    self._known.popitem(last=False)
            return self._known[key], ""
        except (UnknownRecordError, CodecError) as error:
            return None, str(error)


_SYMBOLS = {"lam_q": "λ_q", "lam_S": "λ_S", "lam_motor": "λ_motor"}


class LineageGraph:
    """Builds the nodes of one run; ``parameters`` are the present plant parameters."""

    def __init__(self, session: Session, parameters: Document, samples: SampleDigests) -> None:
        self._session = session
        self._now = parameters
        self._samples = samples
        self._nodes: dict[str, LineageNode] = {}
        self._station = ""

    def build_nodes(self, run: Run, built: Sequence[Bank]) -> list[LineageNode]:
        """Return the nodes of a run, its own first, and of the banks built from it."""
        self._station = run.station
        origins = [self._add_gains(run), self._add_parameters(run), *self._add_calibration(run)]
        found = identifications.find(self._session, run_id=run.id)
        own_digest = self._samples.compute_digest(self._session, run)
        own = self._add_node(
            kind=LineageKind.RUN,
            node=f"run-{run.id}",
            title=f"Run {run.id}",
            detail=run_title(run),
            digest=own_digest,
            origins=origins,
            run=run.id,
        )
        for estimate in found:
            self._add_identification(estimate, "", [own])
        for bank in built:
            made_of = [f"identification-{one.id}" for one in found if one.id in _list_sources(bank)]
            self._add_bank(bank, made_of)
        return [self._nodes.pop(own), *self._nodes.values()]

    def _add_node(
        self,
        kind: LineageKind,
        node: str,
        title: str,
        detail: str,
        digest: Digest,
        origins: Sequence[str],
        out_of_date: str = "",
        **pages: int | None,
    ) -> str:
        sha256, reason = digest
        page = {"run": None, "bank": None, "identification": None} | pages
        self._nodes[node] = LineageNode(
            id=node,
            kind=kind,
            title=title,
            detail=detail,
            sha256=sha256,
            no_sha256=reason,
            out_of_date=out_of_date,
            origins=list(dict.fromkeys(origins)),
            **page,
        )
        return node

    def _add_gains(self, run: Run) -> str:
        try:
            loop = run.set_to.loop.get_known_values()
        except UnreadableDocumentError as error:
            return self._add_node(
                kind=LineageKind.GAINS,
                node="gains",
                title="Gains",
                detail="",
                digest=(None, str(error)),
                origins=[self._add_parameters(run)],
            )
        banks_during_run = origins.load_banks_during_run(self._session, run)
        used = [banks.get(self._session, number) for number in sorted(banks_during_run.numbers - {run.bank_id})]
        if run.bank_id is None:
            made_of, content = [self._add_parameters(run)], document_digest(run.parameters)
        else:
            bank = banks.get(self._session, run.bank_id)
            made_of, content = [self._add_bank_with_sources(bank)], document_digest(_extract_content(bank))
        made_of += [self._add_bank_with_sources(one) for one in used]
        detail = record_messages.loop_values(values=[(_SYMBOLS.get(name, name), value) for name, value in loop.items()])
        # The number of a bank differs between databases, so the digest has its content instead.
        choice = {name: value for name, value in loop.items() if name != "bank"}
        later = {"on_the_way": sorted(document_digest(_extract_content(one)) for one in used)} if used else {}
        digest: Digest = document_digest({"loop": choice, "from": content, **later}), ""
        if origins.BANKS in self._read_embedded(run):
            digest = None, record_messages.bank_not_imported()
        elif banks_during_run.computed:
            digest = None, record_messages.bank_numbers_computed(expressions=banks_during_run.computed)
        return self._add_node(
            kind=LineageKind.GAINS, node="gains", title="Gains", detail=detail, digest=digest, origins=made_of
        )

    def _read_embedded(self, run: Run) -> Document:
        origin = origins.of_runs(self._session, [run.id]).get(run.id)
        return {} if origin is None else origin.carried

    def _add_bank_with_sources(self, bank: Bank) -> str:
        """Add a bank with its identifications and their sources; return its node."""
        made_of = []
        for entry in bank.entries:
            if entry.identification_id is not None:
                estimate = identifications.get(self._session, entry.identification_id)
                made_of.append(self._add_identification(estimate, stored_entry_name(entry)))
        return self._add_bank(bank, made_of)

    def _add_bank(self, bank: Bank, made_of: Sequence[str]) -> str:
        node = f"bank-{bank.id}"
        if node in self._nodes:
            return node
        newest = banks.newest_version(self._session, bank)
        marks: list[str] = [record_messages.newer_version_of_bank(version=newest)] if newest > bank.version else []
        if any(self._nodes[one].out_of_date for one in made_of):
            marks.append(record_messages.point_identified_again())
        title = f"{bank.name} v{bank.version}"
        detail = record_messages.entries_of_bank(count=len(bank.entries), imported=not _list_sources(bank))
        digest = document_digest(_extract_content(bank)), ""
        return self._add_node(
            kind=LineageKind.BANK,
            node=node,
            title=title,
            detail=detail,
            digest=digest,
            origins=made_of,
            out_of_date="; ".join(marks),
            bank=bank.id,
        )

    def _add_identification(self, estimate: Identification, name: str, origins: Sequence[str] | None = None) -> str:
        node = f"identification-{estimate.id}"
        if node in self._nodes:
            return node
        newer = next(
            (
                one
                for one in identifications.of_kind_after(self._session, estimate)
                if is_newer_at_same_point(one, estimate)
            ),
            None,
        )
        mark: str = "" if newer is None else record_messages.identified_again(run=newer.run_id)
        if not estimate.usable:
            mark = "; ".join(filter(None, (mark, record_messages.not_usable())))
        made_of = self._add_data(estimate) if origins is None else list(origins)
        content = {
            "data": estimate.data,
            "method": estimate.method,
            "options": estimate.options,
            "model": estimate.model,
        }
        title = record_messages.title_of_identification(name=name)
        detail = f"{estimate.kind}, {estimate.method}"
        digest = document_digest(content), ""
        return self._add_node(
            kind=LineageKind.IDENTIFICATION,
            node=node,
            title=title,
            detail=detail,
            digest=digest,
            origins=made_of,
            out_of_date=mark,
            identification=estimate.run_id,
        )

    def _add_data(self, estimate: Identification) -> list[str]:
        if estimate.run_id is None:
            name, sha256 = estimate.data.get("file"), estimate.data.get("sha256")
            stored_items: Digest = (
                (sha256, "") if isinstance(sha256, str) else (None, record_messages.imported_file_not_stored())
            )
            node = f"file-{estimate.id}"
            return [
                self._add_node(
                    kind=LineageKind.DATA,
                    node=node,
                    title=record_messages.title_of_imported_data(),
                    detail=str(name or record_messages.not_from_a_run()),
                    digest=stored_items,
                    origins=[],
                )
            ]
        run = runs.get(self._session, estimate.run_id)
        node = f"data-{run.id}"
        if node not in self._nodes:
            made_of = [self._add_parameters(run), *self._add_calibration(run)]
            digest, started = self._samples.compute_digest(self._session, run), f"{run.started_at:%Y-%m-%d %H:%M} UTC"
            mark = self._describe_missing_samples(run)
            self._add_node(
                kind=LineageKind.DATA,
                node=node,
                title=record_messages.title_of_samples(run=run.id),
                detail=started,
                digest=digest,
                origins=made_of,
                out_of_date=mark,
                run=run.id,
            )
        return [node]

    def _describe_missing_samples(self, run: Run) -> str:
        try:
            recording = recordings.get(self._session, run.id)
        except UnknownRecordError as error:
            return str(error)
        return "" if recording.removed_at is None else record_messages.samples_deleted()

    def _add_parameters(self, run: Run) -> str:
        digest = document_digest(run.parameters)
        node = f"parameters-{digest[:16]}"
        if node not in self._nodes:
            elsewhere = self._station != session_station(self._session)
            mark = "" if elsewhere else _describe_difference(run.parameters, self._now)
            self._add_node(
                kind=LineageKind.PARAMETERS,
                node=node,
                title=record_messages.title_of_parameters(name=run.parameters_name),
                detail="",
                digest=(digest, ""),
                origins=[],
                out_of_date=mark,
            )
        return node

    def _add_calibration(self, run: Run) -> list[str]:
        """Add the calibration at the start of a run on a rig; return its node."""
        if run.plant not in _CALIBRATED:
            return []
        origin = origins.of_runs(self._session, [run.id]).get(run.id)
        if origin is not None:
            return self._add_embedded_calibration(origin)
        stored_items = commissioning.calibrations(self._session, run.station)
        then = {one.step: one for one in stored_items if one.at <= run.started_at}
        later = sorted({one.step for one in stored_items if one.at > run.started_at})
        if not then:
            none = None, record_messages.no_calibration_before_run()
            return [
                self._add_node(
                    kind=LineageKind.CALIBRATION,
                    node="calibration-none",
                    title="Calibration",
                    detail=record_messages.calibration_from_wiring_file(),
                    digest=none,
                    origins=[],
                )
            ]
        content = [commissioning.describe_calibration(one) for one in then.values()]
        detail = ", ".join(f"{one.step} {one.at:%Y-%m-%d}" for one in then.values())
        mark = record_messages.calibration_repeated(steps=later) if later else ""
        digest = document_digest(content)
        node = f"calibration-{digest[:16]}"
        return [
            self._add_node(
                kind=LineageKind.CALIBRATION,
                node=node,
                title="Calibration",
                detail=detail,
                digest=(digest, ""),
                origins=[],
                out_of_date=mark,
            )
        ]

    def _add_embedded_calibration(self, origin: Origin) -> list[str]:
        """Add the calibration that was imported with a run; return its node."""
        content = origin.carried.get(origins.CALIBRATIONS)
        digest: Digest = (
            (document_digest(content), "") if content else (None, record_messages.no_calibration_imported())
        )
        node = f"calibration-{(digest[0] or 'none')[:16]}"
        return [
            self._add_node(
                kind=LineageKind.CALIBRATION,
                node=node,
                title="Calibration",
                detail=record_messages.calibration_of_recording_rig(),
                digest=digest,
                origins=[],
            )
        ]


def _list_sources(bank: Bank) -> set[int]:
    return {entry.identification_id for entry in bank.entries if entry.identification_id is not None}


def _extract_content(bank: Bank) -> list[dict[str, Any]]:
    return [{"S_nominal": entry.S_nominal, "model": entry.model} for entry in bank.entries]


def _describe_difference(then: Document, now: Document) -> str:
    """Return which plant parameters have changed, as a message."""
    if then == now:
        return ""
    before, after = dict(iterate_parameters(then)), dict(iterate_parameters(now))
    differing = [name for name in sorted({*before, *after}) if before.get(name) != after.get(name)]
    if not differing:
        return record_messages.parameters_differ_in_texts()
    changes = [(name, before.get(name), after.get(name)) for name in differing[:_MAX_NAMED]]
    return record_messages.parameters_differ(changes=changes, more=len(differing) - len(changes))


# Service -------------------------------------------------------------------------------------------


_RUNS_SHOWN = 20


class RunHistory:
    """Reads lineage and events of runs, and the checklist.

    ``bank_in_use`` returns the number of the active bank. Recordings above ``largest_bytes`` have no digest.
    """

    def __init__(
        self,
        database: Database,
        parameters: PlantParameters,
        bank_in_use: Callable[[], int | None],
        largest_bytes: int = MAX_DIGEST_BYTES,
    ) -> None:
        self._database = database
        self.set_parameters(parameters)
        self._bank_in_use = bank_in_use
        self._samples = SampleDigests(largest_bytes)

    def set_parameters(self, parameters: PlantParameters) -> None:
        """Compare later requests with these plant parameters."""
        self._parameters = parameters.to_document()

    def build_lineage(self, run_id: int) -> Lineage:
        """Return the sources of a run and what was derived from it.

        Raises UnknownRecordError.
        """
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            bank = None if run.bank_id is None else banks.get(session, run.bank_id)
            own_digest = {estimate.id for estimate in identifications.find(session, run_id=run_id)}
            built = [
                one for one in banks.find(session) if own_digest & {entry.identification_id for entry in one.entries}
            ]
            return Lineage(
                run=run.id,
                software=run.software,
                parameters=run.parameters_name,
                parameters_as_now=run.parameters == self._parameters,
                bank=None if bank is None else _build_bank_link(bank),
                entries=[] if bank is None else _build_entries(session, bank),
                banks_built=[_build_bank_link(one) for one in built],
                runs_with_them=runs.with_banks(session, [one.id for one in built], limit=_RUNS_SHOWN),
                nodes=LineageGraph(session, self._parameters, self._samples).build_nodes(run, built),
            )

    def load_marks(self, run_id: int) -> RunMarks:
        """Return the events during a run. Raises UnknownRecordError."""
        with self._database.reading() as session:
            return load_marks(session, run_id)

    def build_checklist(self) -> Checklist:
        """Return the steps of the setup with their states."""
        with self._database.reading() as session:
            return Checklist(steps=build_checklist(session, self._parameters, self._bank_in_use()))


def load_marks(session: Session, run_id: int) -> RunMarks:
    """Return the events during a run, on its own time axis. Raises UnknownRecordError."""
    run = runs.get(session, run_id)
    try:
        period_s, span = recordings.get(session, run_id).period_s, recordings.span(session, run_id)
    except UnknownRecordError:
        return RunMarks(marks=[])
    run_events = events.between(session, run.started_at, run.ended_at, station=run.station)
    faults = [event for event in run_events if event.kind == EventKind.FAULT]

    def is_doubled(trip: Event) -> bool:
        """Return whether an earlier version stored the trip as a fault too.

        For example "STOP" for "STOP was pressed.".
        """
        return any(fault.tick == trip.tick and trip.text.startswith(fault.text) for fault in faults)

    marks = [
        RunMark(t=(event.tick - span.first_tick) * period_s, kind=event.kind, text=event.text, who=event.who)
        for event in run_events
        # ticks start at 0 with each loop process: skip events of another process
        if event.tick is not None and span.first_tick <= event.tick <= span.end_tick
        if event.kind != EventKind.TRIP or not is_doubled(event)
    ]
    return RunMarks(marks=marks)


def _build_bank_link(bank: Bank) -> LineageBank:
    return LineageBank(id=bank.id, name=bank.name, version=bank.version)


def _build_entries(session: Session, bank: Bank) -> list[LineageEntry]:
    run_of = {estimate.id: estimate.run_id for estimate in identifications.find(session)}
    return [
        LineageEntry(
            name=stored_entry_name(entry), S_nominal=entry.S_nominal, run=run_of.get(entry.identification_id or 0)
        )
        for entry in bank.entries
    ]
