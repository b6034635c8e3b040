"""A run on the screen: what it was set to, what was measured, how it was judged."""

from typing import Any

from backend.cli.output import out, print_table

_JUDGED = {True: "passed", False: "FAILED", None: "not measured"}


def show_run(document: dict[str, Any]) -> None:
    """Print how a run ended and what came of it; ``document`` as ``metrics_document`` makes it."""
    end = ": ".join(filter(None, (document["end_state"], document["end_detail"])))
    out.print(f"run {document['run']}, {document['kind']}: {end}", highlight=False, markup=False, style="bold")
    _figures(document)
    _criteria(document)
    if document["identification"]:
        out.print(document["identification"]["verdict"], highlight=False, markup=False)
    elif not document["metrics"]:
        out.print(document["verdict"], highlight=False, markup=False)
    for path in document.get("files", ()):
        out.print(f"wrote {path}", highlight=False, markup=False)


def show_settings(document: dict[str, Any]) -> None:
    """Print what a run was set to."""
    from backend.experiments.used_settings import used_settings

    used = used_settings(document["settings"])
    rows = [(item["meaning"], item["symbol"], item["value"], item["unit"]) for item in used]
    if rows:
        print_table(("setting", "symbol", "value", "unit"), rows)


def _figures(document: dict[str, Any]) -> None:
    labels, units, missing = document["labels"], document["units"], document["not_measured"]
    rows = [
        (labels[name], _figure(value), units[name], missing.get(name, "measured"))
        for name, value in document["metrics"].items()
    ]
    if rows:
        kept = 4 if missing else 3
        print_table(("figure", "value", "unit", "measured")[:kept], [row[:kept] for row in rows])


def _criteria(document: dict[str, Any]) -> None:
    rows = [
        (
            item["title"],
            _figure(item["figure"]),
            f"{item['relation']} {item['bound']:g}",
            item["unit"],
            _JUDGED[item["passed"]] + (f": {item['reason']}" if item["reason"] else ""),
        )
        for item in document["criteria"]
    ]
    if rows:
        print_table(("criterion", "value", "bound", "unit", "verdict"), rows)
        out.print(document["verdict"], highlight=False, markup=False)


def _figure(value: float | None) -> float | str:
    return "not measured" if value is None else value
