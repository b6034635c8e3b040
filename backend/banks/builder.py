"""Builds banks from identifications, compares them, and exports and imports them as files."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import isfinite
from typing import Any, Protocol

from backend.banks import messages
from backend.banks.tuning_settings import TuningSettings, default_lam_motor
from backend.control import build_decoupler, pid, stiffness_slope
from backend.identification import MAX_GAIN_ERROR_PERCENT
from backend.models import ENTRY, PLANT_NUMBERS, EntryModel, StoredPlantNumber
from backend.plain_text import PlainTextError, check_plain_texts, check_single_line, escape_line
from backend.realtime import SetTuning, make_tuning_command
from backend.response_docs import describe_field
from backend.storage import Bank, BankEntry, Database, Identification, Session, banks, entry_name, identifications, runs
from backend.tuning import (
    OuterProcess,
    PointModel,
    TuningError,
    TuningParameters,
    TuningPreviewer,
    decoupled_model,
    make_motor_loops,
    position_gains,
    stiffness_gains,
)
from plant import ErrorCode, PlantParameters, SinewError

# Bank consistency ----------------------------------------------------------------------------------
# Conditions on the entries of a bank before any loop uses them.


MIN_STIFFNESS_DISTANCE = 0.3
"""Least distance of two entries in stiffness [N·m/rad]; closer entries describe the same point."""

MODEL_NAMES = ("K_q", "T_q", "K_S", "T_S")


class BankError(SinewError, ValueError):
    """The selected entries do not form a bank; the message names them and the reason."""

    category = ErrorCode.BAD_VALUE


@dataclass(frozen=True)
class NamedEntry:
    """An entry with its name in messages."""

    name: str
    entry: BankEntry

    @property
    def point(self) -> PointModel:
        """Models of the entry."""
        return build_point_model(self.entry)


def build_point_model(entry: BankEntry) -> PointModel:
    """Return the models of an entry. Raises BankError if one is missing."""
    known = {name: getattr(entry.known, name) for name in MODEL_NAMES}
    if missing := [name for name, value in known.items() if value is None]:
        name = entry_name(entry.S_nominal, entry.known.tension_N)
        raise BankError(messages.entry_without_models(entry=name, missing=", ".join(missing)))
    return PointModel(entry.S_nominal, **known)


def require_consistent(parameters: PlantParameters, chosen: Sequence[NamedEntry]) -> tuple[BankEntry, ...]:
    """Return the entries in order of stiffness. Raises BankError if they do not form a bank."""
    if not chosen:
        raise BankError(messages.no_identifications())
    for item in chosen:
        _require_positive(item)
    ordered = sorted(chosen, key=lambda item: item.entry.S_nominal)
    for below, above in pairwise(ordered):
        _require_apart(below, above)
        _require_tension_rises(below, above)
    for item in ordered:
        _require_gain_of_geometry(parameters, item)
        _require_stable(parameters, item)
    return tuple(item.entry for item in ordered)


def require_same_parameters(parameters: PlantParameters, name: str, recorded: Mapping[str, Any]) -> None:
    """Raise BankError if a run used other parameters, because its model describes another plant."""
    then = PLANT_NUMBERS.read(recorded, name)
    for section, entries in PLANT_NUMBERS.read(parameters.to_document(), parameters.name).items():
        for entry, now in entries.items():
            was = then.get(section, {}).get(entry, StoredPlantNumber(None)).value
            if was != now.value:
                parameter = f"{section}.{entry}"
                raise BankError(
                    messages.other_parameters(name=name, parameter=parameter, recorded=was, current=now.value)
                )


def _require_positive(item: NamedEntry) -> None:
    values = {"S_nominal": item.entry.S_nominal} | {name: getattr(item.entry.known, name) for name in MODEL_NAMES}
    for name, value in values.items():
        if not isinstance(value, int | float) or isinstance(value, bool) or not isfinite(value) or not value > 0.0:
            raise BankError(messages.not_positive(name=item.name, parameter=name, value=value))


def _require_apart(below: NamedEntry, above: NamedEntry) -> None:
    distance = above.entry.S_nominal - below.entry.S_nominal
    if distance < MIN_STIFFNESS_DISTANCE:
        raise BankError(
            messages.entries_too_close(
                below=below.name, above=above.name, distance=distance, minimum=MIN_STIFFNESS_DISTANCE
            )
        )


def _require_tension_rises(below: NamedEntry, above: NamedEntry) -> None:
    low, high = below.entry.known.tension_N, above.entry.known.tension_N
    if low is not None and high is not None and not low < high:
        raise BankError(
            messages.tension_does_not_increase(
                below=below.name,
                above=above.name,
                S_below=below.entry.S_nominal,
                S_above=above.entry.S_nominal,
                F_below=low,
                F_above=high,
            )
        )


def _require_gain_of_geometry(parameters: PlantParameters, item: NamedEntry) -> None:
    g, point = parameters.geometry, item.point
    expected = {
        "K_q": (point.K_q, g.r_m / (2.0 * g.r_j)),
        "K_S": (point.K_S, stiffness_slope(build_decoupler(parameters), point.S_nominal)),
    }
    for name, (value, geometric) in expected.items():
        error = 100.0 * (value / geometric - 1.0)
        if abs(error) > MAX_GAIN_ERROR_PERCENT:
            raise BankError(
                messages.gain_unlike_geometry(
                    name=item.name,
                    parameter=name,
                    value=value,
                    geometric=geometric,
                    error_percent=error,
                    maximum_percent=MAX_GAIN_ERROR_PERCENT,
                )
            )


def _require_stable(parameters: PlantParameters, item: NamedEntry) -> None:
    try:
        TuningPreviewer(parameters, (item.point,), lam_motor=default_lam_motor(parameters))
    except TuningError as error:
        raise BankError(messages.not_robust(name=item.name, reason=error.message)) from None


# Bank building -------------------------------------------------------------------------------------
# From selected identifications to a bank, and from a bank to the gains of the control loop.


class HasEntries(Protocol):
    """A stored bank, or the copy of a bank in a report."""

    @property
    def entries(self) -> tuple[BankEntry, ...]:
        """Its entries in order of stiffness."""


def format_source(identification: Identification) -> str:
    """Return the name of an identification in messages: its run, or its kind if it has no run."""
    if identification.run_id is None:
        return messages.identification_without_run(kind=identification.kind, estimate=identification.id)
    return messages.identification_of_run(run=identification.run_id)


def build_entry(identification: Identification) -> BankEntry:
    """Return the bank entry of an actuator identification.

    Raises BankError if it is of another kind or not usable, UnreadableDocumentError.
    """
    if identification.kind != "actuator":
        raise BankError(messages.not_of_an_actuator(source=format_source(identification), kind=identification.kind))
    if not identification.usable:
        raise BankError(messages.not_usable(source=format_source(identification), verdict=identification.verdict))
    found = identification.actuator.model
    G_q, G_S = found.G_q.first_order, found.G_S.first_order
    tension_N = identification.actuator_options.tension_N
    model = EntryModel(K_q=G_q.K, T_q=G_q.T, K_S=G_S.K, T_S=G_S.T, tension_N=tension_N)
    return BankEntry(found.S_nominal, ENTRY.write(model), identification.id)


def build_bank(
    database: Database, parameters: PlantParameters, name: str, run_ids: Sequence[int], who: str, note: str = ""
) -> Bank:
    """Store the next version of a bank from the newest estimates of identification runs.

    Raises BankError, UnknownRecordError.
    """
    require_name(name)
    with database.reading() as session:
        named = [_load_named_entry(session, parameters, run_id) for run_id in run_ids]
    entries = require_consistent(parameters, named)
    with database.session() as session:
        return banks.add(session, name.strip(), entries, who, note)


def require_name(name: str) -> None:
    """Raise BankError for an invalid name of a bank."""
    if not name.strip():
        raise BankError(messages.no_name())
    try:
        check_single_line(name)
    except PlainTextError as error:
        raise BankError(messages.invalid_name(reason=error.message)) from None


def list_point_models(bank: HasEntries | None) -> tuple[PointModel, ...]:
    """Return the models of a bank's entries; empty without a bank."""
    return tuple(build_point_model(entry) for entry in (bank.entries if bank else ()))


def build_tuning_command(parameters: PlantParameters, tuning: TuningSettings, bank: Bank | None) -> SetTuning:
    """Return the command that applies a tuning with the models of ``bank``. Raises TuningError."""
    return make_tuning_command(
        parameters=parameters,
        lambdas=tuning.lambdas,
        points=list_point_models(bank),
        motor=None,
        interpolate=tuning.interpolate,
        u_plan=tuning.budget,
        k_ext=tuning.k_ext,
    )


def _load_named_entry(session: Session, parameters: PlantParameters, run_id: int) -> NamedEntry:
    found = identifications.of_run(session, run_id)
    entry, name = build_entry(found), format_source(found)
    require_same_parameters(parameters, name, runs.get(session, run_id).parameters)
    return NamedEntry(name, entry)


# Bank difference -----------------------------------------------------------------------------------
# Differences of two banks: models, gains, and M_s of the loops.


SAME_POINT = 1.0
"""Distance in stiffness [N·m/rad] below which entries of two banks count as the same operating point."""


@dataclass(frozen=True)
class OuterLoopFigures:
    """One outer loop at one operating point: model, gains at the active λ, and M_s."""

    K: float = field(metadata=describe_field("gain of the model"))
    T: float = field(metadata=describe_field("time constant of the model", "s"))
    k_p: float = field(metadata=describe_field("proportional gain, through the decoupler"))
    k_i: float = field(metadata=describe_field("integral gain, through the decoupler", "1/s"))
    M_s: float | None = field(metadata=describe_field("sensitivity peak on the high-order model; null when unstable"))


@dataclass(frozen=True)
class BankEntryFigures:
    """Both outer loops of one operating point, at its stiffness [N·m/rad] and tension [N]."""

    S_nominal: float = field(metadata=describe_field("stiffness at the operating point", "N·m/rad"))
    tension_N: float | None = field(metadata=describe_field("tendon tension at the operating point", "N"))
    estimate: int | None = field(metadata=describe_field("number of the stored estimate; null for an imported one"))
    position: OuterLoopFigures
    stiffness: OuterLoopFigures


@dataclass(frozen=True)
class BankEntryChange:
    """An operating point before and after; None if it is new or removed."""

    before: BankEntryFigures | None
    after: BankEntryFigures | None


def _compute_figures(parameters: PlantParameters, lambdas: TuningParameters, entry: BankEntry) -> BankEntryFigures:
    """Return models, gains and M_s of one entry. Raises TuningError for a λ without gains."""
    point = build_point_model(entry)
    model = decoupled_model(parameters, make_motor_loops(parameters, lambdas.lam_motor), point.S_nominal)
    q, S = position_gains(parameters, point, lambdas), stiffness_gains(parameters, point, lambdas)
    return BankEntryFigures(
        S_nominal=point.S_nominal,
        tension_N=entry.known.tension_N,
        estimate=entry.identification_id,
        position=_compute_loop_figures(point.K_q, point.T_q, q, OuterProcess(model[0, 0])),
        stiffness=_compute_loop_figures(point.K_S, point.T_S, S, OuterProcess(model[1, 1])),
    )


def compute_entry_figures(
    parameters: PlantParameters, lambdas: TuningParameters, entries: Sequence[BankEntry]
) -> tuple[BankEntryFigures, ...]:
    """Return models, gains and M_s of every entry. Raises TuningError for a λ without gains."""
    return tuple(_compute_figures(parameters, lambdas, entry) for entry in entries)


def compare_entries(
    parameters: PlantParameters, lambdas: TuningParameters, before: Sequence[BankEntry], after: Sequence[BankEntry]
) -> tuple[BankEntryChange, ...]:
    """Return the changes from one set of entries to another, in order of stiffness."""
    unmatched = [_compute_figures(parameters, lambdas, entry) for entry in after]
    pairs: list[BankEntryChange] = []
    for entry in before:
        old = _compute_figures(parameters, lambdas, entry)
        near = [new for new in unmatched if abs(new.S_nominal - old.S_nominal) < SAME_POINT]
        match = min(near, key=lambda new: abs(new.S_nominal - old.S_nominal), default=None)
        if match is not None:
            unmatched.remove(match)
        pairs.append(BankEntryChange(old, match))
    pairs += [BankEntryChange(None, new) for new in unmatched]
    return tuple(sorted(pairs, key=_get_stiffness))


def merge_entries(bank: Sequence[BankEntry], new: Sequence[BankEntry]) -> tuple[BankEntry, ...]:
    """Return the entries of a bank in which new entries replace those within SAME_POINT."""
    unchanged = [entry for entry in bank if all(abs(entry.S_nominal - item.S_nominal) >= SAME_POINT for item in new)]
    return tuple(sorted([*unchanged, *new], key=lambda entry: entry.S_nominal))


def _compute_loop_figures(K: float, T: float, gains: pid.IPGains, process: OuterProcess) -> OuterLoopFigures:
    M_s = process.sensitivity_peak(gains)
    return OuterLoopFigures(K, T, gains.k_p, gains.k_i, M_s if isfinite(M_s) else None)


def _get_stiffness(pair: BankEntryChange) -> float:
    present = pair.before or pair.after
    return present.S_nominal if present else 0.0


# Bank files ----------------------------------------------------------------------------------------
# A bank as a JSON file, for another data folder. Imported files are checked.


FORMAT = "sinew-bank"
VERSION = 1
MAX_ENTRIES = 20
MAX_NAME = 60
MAX_BYTES = 100_000

_ENTRY_NAMES = ("S_nominal", *MODEL_NAMES, "tension_N")
_UNITS = {
    "S_nominal": "N·m/rad",
    "K_q": "rad/rad",
    "T_q": "s",
    "K_S": "N·m/rad per rad",
    "T_S": "s",
    "tension_N": "N",
}


def build_bank_document(bank: Bank) -> dict[str, Any]:
    """Return the document of a bank file. It has no lineage, which refers to records of this data folder."""
    created = f"{bank.created_at:%FT%TZ}"
    entries = [{"S_nominal": entry.S_nominal, **_select_known_values(entry.model)} for entry in bank.entries]
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": escape_line(bank.name),
        "exported_from": {"bank": bank.id, "version": bank.version, "who": escape_line(bank.who), "made": created},
        "units": _UNITS,
        "entries": entries,
    }


def parse_bank_file(text: str) -> dict[str, Any]:
    """Return the document in the text of a bank file. Raises BankError."""
    if len(text.encode()) > MAX_BYTES:
        raise BankError(messages.file_too_large(maximum_bytes=MAX_BYTES))
    try:
        document = json.loads(text)
        check_plain_texts(document)
    except PlainTextError as error:
        raise BankError(messages.invalid_text_in_file(reason=error.message)) from None
    except (ValueError, RecursionError) as error:
        raise BankError(messages.file_is_not_json(reason=str(error))) from None
    if not isinstance(document, dict):
        raise BankError(messages.file_is_not_an_object())
    return document


def import_bank(
    database: Database, parameters: PlantParameters, document: dict[str, Any], who: str, name: str = ""
) -> Bank:
    """Store the bank of a file as the next version of its name, or of ``name``. Raises BankError."""
    if document.get("format") != FORMAT or document.get("version") != VERSION:
        raise BankError(messages.file_of_another_format(format_name=FORMAT, version=VERSION))
    bank_name, items = name or document.get("name"), document.get("entries")
    if not isinstance(bank_name, str) or len(bank_name) > MAX_NAME:
        raise BankError(messages.file_without_name(maximum=MAX_NAME))
    require_name(bank_name)
    if not isinstance(items, list) or not 0 < len(items) <= MAX_ENTRIES:
        raise BankError(messages.wrong_number_of_entries(maximum=MAX_ENTRIES))
    entries = require_consistent(
        parameters, [_parse_named_entry(position, item) for position, item in enumerate(items, start=1)]
    )
    note = messages.imported(origin=document.get("exported_from"))
    with database.session() as session:
        return banks.add(session, bank_name.strip(), entries, who, note)


def _parse_named_entry(position: int, item: Any) -> NamedEntry:
    name = messages.entry_at_position(position=position)
    tension_N = item.get("tension_N") if isinstance(item, dict) else None
    if isinstance(tension_N, int | float) and not isinstance(tension_N, bool):
        name = messages.entry_at_tension(tension_N=tension_N)
    if not isinstance(item, dict) or not set(item) <= set(_ENTRY_NAMES):
        raise BankError(messages.unknown_key(name=name, known=", ".join(_ENTRY_NAMES)))
    for key, value in item.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BankError(messages.not_a_number(name=name, key=key, value=value))
    S_nominal = item.get("S_nominal")
    if S_nominal is None:
        raise BankError(messages.entry_without_stiffness(name=name))
    return NamedEntry(name, BankEntry(float(S_nominal), _select_known_values(item)))


def _select_known_values(model: dict[str, Any]) -> dict[str, Any]:
    return {key: model[key] for key in (*MODEL_NAMES, "tension_N") if model.get(key) is not None}
