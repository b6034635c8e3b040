"""The layout for Foxglove and Lichtblick, of an MCAP export or of the live stream: plots as on the page, a table."""

import json
from typing import Any

from backend.sample import FIELDS

TOPIC = "/sample"
"""Topic of the samples."""

_PLOTS: dict[str, tuple[str, ...]] = {
    "Joint position": ("q", "q_ref", "q_ref_gov"),
    "Joint stiffness": ("S", "S_ref", "S_ref_gov", "S_true"),
    "Motor positions": ("theta_A", "theta_A_ref", "theta_B", "theta_B_ref"),
    "Tendon forces": ("F_A", "F_B", "F_push"),
    "Motor voltages": ("u_A", "u_B"),
    "Mode, limits, fault": ("mode", "limits", "fault"),
}
_COLOURS = ("#1c7ed6", "#e8590c", "#2f9e44", "#862e9c")
_FIELD = {field.name: field for field in FIELDS}


def layout() -> str:
    """Return the layout as the file that either program imports."""
    panels = {f"Plot!sinew{number}": _plot(title, names) for number, (title, names) in enumerate(_PLOTS.items())}
    table = {"RawMessages!sinew": {"topicPath": TOPIC, "expansion": "all", "diffEnabled": False}}
    left, right = list(panels)[::2], [*list(panels)[1::2]]
    document = {
        "configById": panels | table,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": {"direction": "row", "first": _column(left), "second": _column(right), "splitPercentage": 50},
            "second": "RawMessages!sinew",
            "splitPercentage": 80,
        },
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _plot(title: str, names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "title": f"{title} [{_FIELD[names[0]].unit}]",
        "foxglovePanelTitle": f"{title} [{_FIELD[names[0]].unit}]",
        "paths": [
            {
                "value": f"{TOPIC}.{name}",
                "label": _FIELD[name].symbol,
                "color": colour,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for name, colour in zip(names, _COLOURS, strict=False)
        ],
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
    }


def _column(panels: list[str]) -> Any:
    """Return panels one below the other, alike in height."""
    if len(panels) == 1:
        return panels[0]
    share = 100.0 / len(panels)
    return {"direction": "column", "first": panels[0], "second": _column(panels[1:]), "splitPercentage": share}
