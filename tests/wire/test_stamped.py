"""The page stamps exactly those requests that the service asks control for: its list is made by hand."""

import re
from pathlib import Path

from backend.api.export import build_openapi_schema

WIRE = Path(__file__).parents[2] / "frontend" / "src" / "wire"
CONTROL_ITSELF = "/api/control"
"""Given up and handed over with a stamp that is put on by hand."""


def test_every_request_that_needs_control_is_stamped_and_no_other() -> None:
    written = re.search(r"const COMMANDS =\s*/(.*)/;", (WIRE / "control.ts").read_text(encoding="utf-8"))
    assert written is not None
    commands = re.compile(written[1])
    paths = build_openapi_schema()["paths"]
    asked = {
        (method, path.replace("{id}", "7")): any(one["name"] == "Sinew-Control" for one in told.get("parameters", ()))
        for path, methods in paths.items()
        for method, told in methods.items()
        if method != "get" and not path.startswith(CONTROL_ITSELF)
    }
    assert sum(asked.values()) > 10
    assert [order for order, stamped in asked.items() if stamped != bool(commands.match(order[1]))] == []
