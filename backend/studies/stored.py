"""A study as it is kept, with all that its text speaks of as that was when it was begun."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from pydantic import TypeAdapter

from backend.errors import Path
from backend.execution import BankOf, list_plan_banks
from backend.experiments import (
    KIND,
    ExperimentDefinition,
    ExperimentError,
    Lines,
    build_library_entry,
    find_line,
    parser,
)
from backend.models import DocumentCodec, Value, complete_motion
from backend.storage import Bank, NewStudy, StoredStudy, UnknownRecordError
from backend.studies.design import FORMAT, STUDY, Design, Study, designed
from backend.studies.point import StudyBase, planned
from plant import PlantParameters

BASE: DocumentCodec[StudyBase] = DocumentCodec(StudyBase, "what it is computed from", 0)
_BASE = TypeAdapter(StudyBase)  # writes the dates of banks too, which documents by themselves have none of


@dataclass(frozen=True)
class StudyContext:
    """What a study is begun among: experiments by name, the plant, the tuning where it names none, the banks."""

    entry_named: Callable[[str], ExperimentDefinition]
    parameters: PlantParameters
    tuning: Mapping[str, Value]
    bank_of: BankOf


def read(written: str, *, stored: bool = False) -> tuple[Study, Lines]:
    """Return the study that a text says, and the line of each of its parts. Raises ExperimentError.

    A ``stored`` text is read as it was accepted.
    """
    document, lines = parser.document_of(written, stored=stored)
    if not isinstance(document, Mapping):
        raise ExperimentError("a study is a mapping with format, name, title and axes or spread", (), 1)
    return parser.in_form(STUDY, FORMAT, document, lines, stored=stored), lines


def create_study(written: str, around: StudyContext, who: str) -> NewStudy:
    """Return a study as it is to be kept. Raises ExperimentError naming line, value, bound and unit."""
    study, lines = read(written)
    entry = _entry(study, lines, around)
    if entry.written is None:
        why = f"{entry.name} is no experiment that is data: write it as one"
        raise ExperimentError(why, ("experiment",), find_line(("experiment",), lines))
    base = StudyBase(
        parser.canonical(entry.written),
        entry.run_kind,
        around.parameters.name,
        around.parameters.to_document(),
        {**around.tuning, **complete_motion(study.settings)},
    )
    design = designed(study, lines, base, entry.settings)
    base = replace(base, banks=_banks(design, around.bank_of, lines))
    return NewStudy(
        name=study.name,
        title=study.title,
        text=written,
        base=_BASE.dump_python(base, mode="json"),
        points=len(design),
        who=who,
    )


def parse_design(stored: StoredStudy) -> Design:
    """Return the points of a stored study. Raises UnreadableDocumentError, ExperimentError."""
    return Design(read(stored.text, stored=True)[0], BASE.read(stored.base, f"study {stored.id}"))


def _entry(study: Study, lines: Lines, around: StudyContext) -> ExperimentDefinition:
    if study.written is None:
        return around.entry_named(study.experiment)
    inner = {path[1:]: line for path, line in lines.items() if path[:1] == ("written",)}
    try:
        return build_library_entry(study.written, inner, run_kind=KIND)
    except ExperimentError as error:
        raise ExperimentError(error.why, ("written", *error.path), error.line) from None


def _banks(design: Design, bank_of: BankOf, lines: Lines) -> tuple[Bank, ...]:
    """Return the banks that are used: of the tuning, of an axis, or on the way of the first point."""
    _, plan, loop = planned(design.base, design.point(0))
    said_at: dict[int, Path] = dict.fromkeys((loop.bank, *list_plan_banks(plan)), ())
    if "bank" in design.study.settings:
        said_at[loop.bank] = ("settings", "bank")
    for place, (name, values) in enumerate(design.axes):
        if name == "bank":
            said_at |= {int(value): ("axes", place, "over") for value in values}
    return tuple(_bank(bank_of, number, said_at[number], lines) for number in sorted(said_at) if number)


def _bank(bank_of: BankOf, number: int, path: Path, lines: Lines) -> Bank:
    try:
        return bank_of(number)
    except UnknownRecordError as error:
        raise ExperimentError(str(error), path, find_line(path, lines)) from None
