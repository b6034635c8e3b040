"""The lineage of a run as boxes: gains, bank, identifications, raw data, parameters, calibration, each with a digest.

A digest is that of the content (``documents/digest.py``, ``recording/digest.py``): two boxes with the same digest say
the same, in whichever database. What holds no more is marked where it stands.
"""

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

from backend.archive.checklist import replaces
from backend.models.document import UnreadableDocumentError, digest_of
from backend.recording.codec import CodecError, digest_of_recording
from backend.schemas.run import LineageKind, LineageNode
from backend.storage import banks, commissioning, identifications, origins, recordings, runs
from backend.storage.banks import Bank, name_of_entry
from backend.storage.database import Session
from backend.storage.identifications import Identification
from backend.storage.origins import Origin
from backend.storage.orm import Document, UnknownRecordError
from backend.storage.runs import EndState, Run, title_of
from backend.storage.search_index import numbers_of
from backend.storage.stations import station_of
from plant.interface import PlantChoice, PlantKind

READ_AT_ONCE_BYTES = 30_000_000
"""Stored recordings up to this size are read through while somebody waits: twenty minutes, in half a second."""
_REMEMBERED = 500
_TOLD = 3
"""Parameters that are named where more of them differ."""
_CALIBRATED = {PlantChoice(kind).name for kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD)}

Digest = tuple[str | None, str]
"""In hex, or None and why there is none."""


class SampleDigests:
    """Digests of recordings, remembered: samples of a run that is over change no more."""

    def __init__(self, largest_bytes: int) -> None:
        self._largest_bytes = largest_bytes
        self._known: OrderedDict[tuple[int, int], str] = OrderedDict()

    def of(self, session: Session, run: Run) -> Digest:
        """Return the digest of a run's samples."""
        if run.end_state == EndState.RUNNING:
            return None, "the run is not over"
        try:
            recording = recordings.get(session, run.id)
            key = run.id, recording.size_bytes
            if key not in self._known:
                if recording.size_bytes > self._largest_bytes:
                    return None, f"too long to be read through here: sinew runs lineage {run.id} does"
                self._known[key] = digest_of_recording(session, run.id)
                if len(self._known) > _REMEMBERED:
                    self._known.popitem(last=False)
            return self._known[key], ""
        except (UnknownRecordError, CodecError) as error:
            return None, str(error)


_SYMBOLS = {"lam_q": "λ_q", "lam_S": "λ_S", "lam_motor": "λ_motor"}


class LineageGraph:
    """Makes the boxes of one run; ``parameters`` are those of the plant as it is now."""

    def __init__(self, session: Session, parameters: Document, samples: SampleDigests) -> None:
        self._session = session
        self._now = parameters
        self._samples = samples
        self._nodes: dict[str, LineageNode] = {}
        self._station = ""

    def of(self, run: Run, built: Sequence[Bank]) -> list[LineageNode]:
        """Return the boxes of a run, itself first, and of the banks that were built from it."""
        self._station = run.station
        origins = [self._gains(run), self._parameters(run), *self._calibration(run)]
        found = identifications.find(self._session, run_id=run.id)
        mine = self._samples.of(self._session, run)
        own = self._node(LineageKind.RUN, f"run-{run.id}", f"Run {run.id}", title_of(run), mine, origins, run=run.id)
        for estimate in found:
            self._identification(estimate, "", [own])
        for bank in built:
            made_of = [f"identification-{one.id}" for one in found if one.id in _sources(bank)]
            self._bank(bank, made_of)
        return [self._nodes.pop(own), *self._nodes.values()]

    def _node(
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

    def _gains(self, run: Run) -> str:
        try:
            loop = run.set_to.loop.known()
        except UnreadableDocumentError as error:
            return self._node(LineageKind.GAINS, "gains", "Gains", "", (None, str(error)), [self._parameters(run)])
        way = origins.banks_on_the_way(self._session, run)
        used = [banks.get(self._session, number) for number in sorted(way.numbers - {run.bank_id})]
        if run.bank_id is None:
            made_of, content = [self._parameters(run)], digest_of(run.parameters)
        else:
            bank = banks.get(self._session, run.bank_id)
            made_of, content = [self._whole_bank(bank)], digest_of(_content(bank))
        made_of += [self._whole_bank(one) for one in used]
        detail = ", ".join(f"{_SYMBOLS.get(name, name)} {_shown(value)}" for name, value in loop.items())
        # The number of a bank is another one in each database; its content stands beside.
        choice = {name: value for name, value in loop.items() if name != "bank"}
        later = {"on_the_way": sorted(digest_of(_content(one)) for one in used)} if used else {}
        digest: Digest = digest_of({"loop": choice, "from": content, **later}), ""
        if origins.BANKS in self._carried(run):
            digest = None, "its bank was not imported with it: a bundle has it"
        elif way.computed:
            digest = None, f"it computes the numbers of its banks: {', '.join(way.computed)}"
        return self._node(LineageKind.GAINS, "gains", "Gains", detail, digest, made_of)

    def _carried(self, run: Run) -> Document:
        origin = origins.of_runs(self._session, [run.id]).get(run.id)
        return {} if origin is None else origin.carried

    def _whole_bank(self, bank: Bank) -> str:
        """Return the box of a bank, with those of all it came from."""
        made_of = []
        for entry in bank.entries:
            if entry.identification_id is not None:
                estimate = identifications.get(self._session, entry.identification_id)
                made_of.append(self._identification(estimate, name_of_entry(entry)))
        return self._bank(bank, made_of)

    def _bank(self, bank: Bank, made_of: Sequence[str]) -> str:
        node = f"bank-{bank.id}"
        if node in self._nodes:
            return node
        newest = banks.newest_version(self._session, bank)
        marks = [f"version {newest} of it is newer"] if newest > bank.version else []
        marks += ["an entry was identified again" for one in made_of if self._nodes[one].out_of_date][:1]
        title, entries = f"{bank.name} v{bank.version}", f"{len(bank.entries)} entries"
        detail = entries if _sources(bank) else f"{entries}, imported"
        digest = digest_of(_content(bank)), ""
        return self._node(LineageKind.BANK, node, title, detail, digest, made_of, "; ".join(marks), bank=bank.id)

    def _identification(self, estimate: Identification, name: str, origins: Sequence[str] | None = None) -> str:
        node = f"identification-{estimate.id}"
        if node in self._nodes:
            return node
        newer = next(
            (one for one in identifications.of_kind_after(self._session, estimate) if replaces(one, estimate)), None
        )
        mark = "" if newer is None else f"identified again in run {newer.run_id}"
        if not estimate.usable:
            mark = "; ".join(filter(None, (mark, "it is not usable")))
        made_of = self._data(estimate) if origins is None else list(origins)
        content = {
            "data": estimate.data,
            "method": estimate.method,
            "options": estimate.options,
            "model": estimate.model,
        }
        title = f"Identification{': ' + name if name else ''}"
        detail = f"{estimate.kind}, {estimate.method}"
        digest = digest_of(content), ""
        return self._node(
            LineageKind.IDENTIFICATION, node, title, detail, digest, made_of, mark, identification=estimate.run_id
        )

    def _data(self, estimate: Identification) -> list[str]:
        if estimate.run_id is None:
            name, sha256 = estimate.data.get("file"), estimate.data.get("sha256")
            kept: Digest = (sha256, "") if isinstance(sha256, str) else (None, "its file was not kept")
            node = f"file-{estimate.id}"
            return [self._node(LineageKind.DATA, node, "Imported data", str(name or "not from a run"), kept, [])]
        run = runs.get(self._session, estimate.run_id)
        node = f"data-{run.id}"
        if node not in self._nodes:
            made_of = [self._parameters(run), *self._calibration(run)]
            digest, started = self._samples.of(self._session, run), f"{run.started_at:%Y-%m-%d %H:%M} UTC"
            mark = self._missing(run)
            self._node(LineageKind.DATA, node, f"Samples of run {run.id}", started, digest, made_of, mark, run=run.id)
        return [node]

    def _missing(self, run: Run) -> str:
        try:
            recording = recordings.get(self._session, run.id)
        except UnknownRecordError as error:
            return str(error)
        return "" if recording.removed_at is None else "the samples were deleted"

    def _parameters(self, run: Run) -> str:
        digest = digest_of(run.parameters)
        node = f"parameters-{digest[:16]}"
        if node not in self._nodes:
            elsewhere = self._station != station_of(self._session)
            mark = "" if elsewhere else _difference(run.parameters, self._now)
            self._node(LineageKind.PARAMETERS, node, f"Parameters {run.parameters_name}", "", (digest, ""), [], mark)
        return node

    def _calibration(self, run: Run) -> list[str]:
        """Return the box of what was calibrated when a run on a rig began."""
        if run.plant not in _CALIBRATED:
            return []
        origin = origins.of_runs(self._session, [run.id]).get(run.id)
        if origin is not None:
            return self._carried_calibration(origin)
        kept = commissioning.calibrations(self._session, run.station)
        then = {one.step: one for one in kept if one.at <= run.started_at}
        later = sorted({one.step for one in kept if one.at > run.started_at})
        if not then:
            none = None, "nothing was calibrated before the run"
            return [
                self._node(LineageKind.CALIBRATION, "calibration-none", "Calibration", "from the wiring file", none, [])
            ]
        content = [commissioning.told(one) for one in then.values()]
        detail = ", ".join(f"{one.step} {one.at:%Y-%m-%d}" for one in then.values())
        mark = f"done again since: {', '.join(later)}" if later else ""
        digest = digest_of(content)
        node = f"calibration-{digest[:16]}"
        return [self._node(LineageKind.CALIBRATION, node, "Calibration", detail, (digest, ""), [], mark)]

    def _carried_calibration(self, origin: Origin) -> list[str]:
        """Return the box of what was calibrated at the rig that made an imported run."""
        content = origin.carried.get(origins.CALIBRATIONS)
        digest: Digest = (digest_of(content), "") if content else (None, "nothing came with the run")
        node = f"calibration-{(digest[0] or 'none')[:16]}"
        return [self._node(LineageKind.CALIBRATION, node, "Calibration", "of the rig that made it", digest, [])]


def _sources(bank: Bank) -> set[int]:
    return {entry.identification_id for entry in bank.entries if entry.identification_id is not None}


def _content(bank: Bank) -> list[dict[str, Any]]:
    return [{"S_nominal": entry.S_nominal, "model": entry.model} for entry in bank.entries]


def _difference(then: Document, now: Document) -> str:
    """Return in words which numbers of the plant are others now."""
    if then == now:
        return ""
    before, after = dict(numbers_of(then)), dict(numbers_of(now))
    differing = [name for name in sorted({*before, *after}) if before.get(name) != after.get(name)]
    if not differing:
        return "the plant has others now: their sources or texts differ"
    told = ", ".join(f"{name} {_shown(before.get(name))}, now {_shown(after.get(name))}" for name in differing[:_TOLD])
    more = f" and {len(differing) - _TOLD} more" if len(differing) > _TOLD else ""
    return f"the plant has others now: {told}{more}"


def _shown(value: float | str | None) -> str:
    if value is None:
        return "not there"
    return f"{value:.6g}" if type(value) is float else str(value)
