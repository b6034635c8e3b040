"""Creates and reads stored studies; each includes the experiment, plant and banks as of its creation."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from pydantic import TypeAdapter

from backend.errors import Path
from backend.execution import LoadBank, list_plan_banks
from backend.experiments import (
    KIND,
    ExperimentDefinition,
    ExperimentError,
    Lines,
    build_experiment_definition,
    find_line,
    parser,
)
from backend.models import DocumentCodec, Value, complete_motion
from backend.storage import Bank, NewStudy, StoredStudy, UnknownRecordError
from backend.studies import messages
from backend.studies.design import FORMAT, STUDY, Design, Study, build_design
from backend.studies.point import StudyBase, plan_point
from plant import PlantParameters

BASE: DocumentCodec[StudyBase] = DocumentCodec(StudyBase, messages.stored_input(), 0)
_BASE = TypeAdapter(StudyBase)  # serializes the dates of banks, which DocumentCodec does not


@dataclass(frozen=True)
class StudyContext:
    """Data that a new study refers to: experiments, plant, banks, and the tuning for studies without their own."""

    find_experiment: Callable[[str], ExperimentDefinition]
    parameters: PlantParameters
    tuning: Mapping[str, Value]
    load_bank: LoadBank


def parse_study(text: str, *, stored: bool = False) -> tuple[Study, Lines]:
    """Return the study that a text describes, and the line of each of its parts. Raises ExperimentError.

    A ``stored`` text is not checked against rules that were added after it was stored.
    """
    document, lines = parser.parse_document(text, stored=stored)
    if not isinstance(document, Mapping):
        raise ExperimentError(messages.not_a_study(), (), 1)
    return parser.validate_document(STUDY, FORMAT, document, lines, stored=stored), lines


def create_study(text: str, context: StudyContext, who: str) -> NewStudy:
    """Return the study to store. Raises ExperimentError with line, value, bound and unit."""
    study, lines = parse_study(text)
    entry = _find_definition(study, lines, context)
    if entry.experiment is None:
        no_document = messages.no_experiment_document(name=entry.name)
        raise ExperimentError(no_document, ("experiment",), find_line(("experiment",), lines))
    base = StudyBase(
        parser.to_canonical_text(entry.experiment),
        entry.run_kind,
        context.parameters.name,
        context.parameters.to_document(),
        {**context.tuning, **complete_motion(study.settings)},
    )
    design = build_design(study, lines, base, entry.settings)
    base = replace(base, banks=_load_banks(design, context.load_bank, lines))
    return NewStudy(
        name=study.name,
        title=study.title,
        text=text,
        base=_BASE.dump_python(base, mode="json"),
        points=len(design),
        who=who,
    )


def parse_design(stored: StoredStudy) -> Design:
    """Return the design of a stored study. Raises UnreadableDocumentError, ExperimentError."""
    return Design(
        parse_study(stored.text, stored=True)[0], BASE.read(stored.base, messages.study_of_number(number=stored.id))
    )


def _find_definition(study: Study, lines: Lines, context: StudyContext) -> ExperimentDefinition:
    if study.written is None:
        return context.find_experiment(study.experiment)
    inner = {path[1:]: line for path, line in lines.items() if path[:1] == ("written",)}
    try:
        return build_experiment_definition(study.written, inner, run_kind=KIND)
    except ExperimentError as error:
        raise ExperimentError(error.why, ("written", *error.path), error.line) from None


def _load_banks(design: Design, load_bank: LoadBank, lines: Lines) -> tuple[Bank, ...]:
    """Return the banks that the study uses: of the tuning, of an axis, of changes during the experiment."""
    _, plan, loop = plan_point(design.base, design.point(0))
    paths: dict[int, Path] = dict.fromkeys((loop.bank, *list_plan_banks(plan)), ())
    if "bank" in design.study.settings:
        paths[loop.bank] = ("settings", "bank")
    for index, (name, values) in enumerate(design.axes):
        if name == "bank":
            paths |= {int(value): ("axes", index, "over") for value in values}
    return tuple(_load_bank(load_bank, number, paths[number], lines) for number in sorted(paths) if number)


def _load_bank(load_bank: LoadBank, number: int, path: Path, lines: Lines) -> Bank:
    try:
        return load_bank(number)
    except UnknownRecordError as error:
        raise ExperimentError(error.message, path, find_line(path, lines)) from None
