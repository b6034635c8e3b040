"""A run on the screen: what it was set to, what was measured, how it was judged."""

from typing import Any

from backend.cli.output import angles, out, print_table
from backend.reading import in_words, read, reading_of

_JUDGED = {True: "passed", False: "FAILED", None: "not measured"}


def show_run(document: dict[str, Any]) -> None:
    """Print how a run ended and what came of it; ``document`` as ``metrics_document`` makes it."""
    end = ": ".join(filter(None, (document["end_state"], document["end_detail"])))
    _say(f"run {document['run']}, {document['kind']}: {end}", style="bold")
    _figures(document)
    _criteria(document)
    if document["identification"]:
        _say(document["identification"]["verdict"])
    elif not document["metrics"]:
        _say(document["verdict"])
    for path in document.get("files", ()):
        out.print(f"wrote {path}", highlight=False, markup=False)


def show_settings(document: dict[str, Any]) -> None:
    """Print what a run was set to."""
    from backend.experiments.results.used_settings import used_settings

    used = used_settings(document["settings"])
    rows = [
        (
            item["meaning"],
            item["symbol"],
            _setting(item["value"], item["unit"]),
            reading_of(item["unit"], angles()).unit,
        )
        for item in used
    ]
    if rows:
        print_table(("setting", "symbol", "value", "unit"), rows)


def _setting(value: object, unit: str) -> object:
    return read(value, unit, angles()) if isinstance(value, float) else value


def _figures(document: dict[str, Any]) -> None:
    labels, units, missing = document["labels"], document["units"], document["not_measured"]
    rows = [
        (
            labels[name],
            _figure(value, units[name]),
            reading_of(units[name], angles()).unit,
            in_words(missing.get(name, "measured"), angles()),
        )
        for name, value in document["metrics"].items()
    ]
    if rows:
        kept = 4 if missing else 3
        print_table(("figure", "value", "unit", "measured")[:kept], [row[:kept] for row in rows])


def _criteria(document: dict[str, Any]) -> None:
    rows = [
        (
            item["title"],
            _figure(item["figure"], item["unit"]),
            f"{item['relation']} {read(item['bound'], item['unit'], angles()):g}",
            reading_of(item["unit"], angles()).unit,
            in_words(_judged(item), angles()),
        )
        for item in document["criteria"]
    ]
    if rows:
        print_table(("criterion", "value", "bound", "unit", "verdict"), rows)
        _say(document["verdict"])


def _judged(item: dict[str, Any]) -> str:
    from backend.reports.verdict import SEEN

    seen = "" if item["passed"] is None else f"{SEEN[item['relation']]}, "
    return _JUDGED[item["passed"]] + (f": {seen}{item['reason']}" if item["reason"] else "")


def _figure(value: float | None, unit: str) -> float | str:
    return "not measured" if value is None else read(value, unit, angles())


def _say(text: str, style: str = "") -> None:
    out.print(in_words(text, angles()), highlight=False, markup=False, style=style)
