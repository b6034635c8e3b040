"""How to play a run of the simulator again: a command to copy, with the files that it needs."""

import json
import shlex
from collections.abc import Iterator, Sequence

from backend.experiments import library, parser
from backend.experiments.library import OF_THE_PAPER, experiments
from backend.models.run import PLANT_NUMBERS, Value
from backend.reports.document import Block, Code, Paragraph
from backend.reports.source import Source
from backend.storage.runs import EndState, RunKind
from plant.interface import SIMULATOR
from plant.parameters import SHIPPED, load_parameters

_IDENTIFY = {
    RunKind.ACTUATOR_IDENTIFICATION: "actuator",
    RunKind.MOTOR_IDENTIFICATION: "motor",
    RunKind.SPRING_IDENTIFICATION: "spring",
}
_PARAMETERS_FILE, _EXPERIMENT_FILE = "parameters.toml", "experiment.json"
_FOLDER = "reproduced"
_LINE = 92
"""Longest line of a command [characters], so that it fits between the margins of a page."""


def reproduction(source: Source) -> tuple[Block, ...]:
    """Return the command that plays a run again, and its files; a paragraph with the reason where there is none."""
    if reason := _not_again(source):
        return (Paragraph(f"No command plays this run again: {reason}."),)
    return tuple(_blocks(source))


def _not_again(source: Source) -> str:
    run = source.run
    if run.plant != SIMULATOR.name:
        return f"only the simulator repeats a run, and this one is of the plant {run.plant}"
    if run.set_to.plan is None:
        return "it was moved by hand"
    if run.end_state != EndState.COMPLETED:
        return "it did not play its program to the end"
    return ""


def _blocks(source: Source) -> Iterator[Block]:
    run, plan = source.run, dict(source.run.set_to.plan or {})
    words = ["sinew"]
    experiment = str(plan.pop("experiment")) if "experiment" in plan else ""
    files: list[Code] = []
    if run.kind in _IDENTIFY:
        words += ["identify", _IDENTIFY[RunKind(run.kind)]]
    elif not experiment or (ready := _ready_made(experiment)):
        words += ["experiment", run.kind if not experiment else ready]
    else:
        words += ["experiment", _EXPERIMENT_FILE]
        files.append(Code(f"{_EXPERIMENT_FILE}, the experiment as it was played:", _indented(json.loads(experiment))))
    lines = [" ".join(words)]
    lines += [f"--set {_quoted(name, value)}" for name, value in {**plan, **run.set_to.loop.known()}.items()]
    parameters = run.parameters_name
    if not _is_shipped(source):
        parameters = _PARAMETERS_FILE
        files.append(Code(f"{_PARAMETERS_FILE}, the numbers of the plant as they were:", _toml(source)))
    where = [f"--params {parameters}", f"--out {_FOLDER}/report"]
    if source.bank is None:
        where.append(f"--data {_FOLDER}")
    yield Code(_caption(source, bool(files)), " \\\n  ".join([lines[0], *_filled([*lines[1:], *where])]))
    yield from files


def _filled(words: Sequence[str]) -> Iterator[str]:
    """Yield lines of as many words as fit; one with lines of its own stands alone."""
    line = ""
    for word in words:
        if line and ("\n" in line + word or len(line) + len(word) >= _LINE):
            yield line
            line = ""
        line = f"{line} {word}".strip()
    yield line


def _caption(source: Source, files: bool) -> str:
    words = "Play this run again"
    if source.bank is None:
        words += f", in a data folder of its own, {_FOLDER}"
    else:
        words += f", in the data folder that has bank “{source.bank.name}” version {source.bank.version}"
    if files:
        words += ", with the files below in the same folder as the shell"
    if source.run.set_to.granted is None:
        words += (
            ". The same versions give the same samples; where the run was not the first of its command, its noise and "
            "its state at the start differ"
        )
    else:
        words += ". The run was played in real time from where the joint was; the command starts from slack tendons"
    return f"{words}:"


def _ready_made(experiment: str) -> str:
    """Return the name of the experiment that Sinew holds with the same text, "" where there is none."""
    name = str(json.loads(experiment).get("name", ""))
    if name not in OF_THE_PAPER and name not in experiments():
        return ""
    try:
        return name if parser.canonical(library.ready_made(name)[0]) == experiment else ""
    except (KeyError, OSError):
        return ""


def _quoted(name: str, value: Value) -> str:
    if isinstance(value, bool):
        return f"{name}={str(value).lower()}"
    if isinstance(value, str) and value.startswith("["):  # parts of a sequence: a line for each
        return shlex.quote(f"{name}=[\n" + ",\n".join(json.dumps(item) for item in json.loads(value)) + "\n]")
    return shlex.quote(f"{name}={value if isinstance(value, str) else repr(value)}")


def _is_shipped(source: Source) -> bool:
    """Whether the numbers of the plant are those of a set that comes with Sinew."""
    name = source.run.parameters_name
    return name in SHIPPED and load_parameters(name).document() == source.run.parameters


def _indented(document: object) -> str:
    return json.dumps(document, indent=1, ensure_ascii=True)


def _toml(source: Source) -> str:
    """Return a parameter set as a TOML file, whose strings are written as those of JSON."""
    lines = []
    for section, entries in PLANT_NUMBERS.read(source.run.parameters, f"run {source.run.id}").items():
        lines.append(f"[{section}]")
        for entry, number in entries.items():
            said = f"unit = {_string(number.unit)}, source = {_string(number.source)}"
            lines.append(f"{entry} = {{ value = {json.dumps(number.value)}, {said} }}")
        lines.append("")
    return "\n".join(lines[:-1])


def _string(words: str) -> str:
    return json.dumps(words, ensure_ascii=False).replace("\x7f", "\\u007f")
