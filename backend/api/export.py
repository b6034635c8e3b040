"""Writes the sources of generated front-end code: OpenAPI schema, sample fields.

``python -m backend.api.export OUT_DIR`` writes the files; ``--check`` fails if a committed file is stale. The OpenAPI
schema is not committed and always written, because TypeScript types are generated from it.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from backend.api import messages
from backend.api.app import create_app
from backend.glossary import render_glossary_typescript
from backend.schemas import LiveMessage, Ping, render_sample_typescript


def build_openapi_schema() -> dict[str, Any]:
    """Return the OpenAPI schema, with the websocket messages as components."""
    schema = create_app().openapi()
    components = schema["components"]["schemas"]
    messages: dict[str, TypeAdapter[Any]] = {"LiveMessage": TypeAdapter(LiveMessage), "Ping": TypeAdapter(Ping)}
    for name, adapter in messages.items():
        part = adapter.json_schema(ref_template="#/components/schemas/{model}", mode="serialization")
        for other, definition in part.pop("$defs", {}).items():
            components.setdefault(other, definition)
        components[name] = part
    schema["components"]["schemas"] = dict(sorted(components.items()))
    return schema


def build_files() -> dict[str, str]:
    """Return the content of each committed generated file by its name."""
    return {"sample.gen.ts": render_sample_typescript(), "glossary.gen.ts": render_glossary_typescript()}


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("out_dir", type=Path)
    parser.add_argument("--check", action="store_true", help="fail when a committed file is stale")
    arguments = parser.parse_args()
    folder: Path = arguments.out_dir
    stale = {name: content for name, content in build_files().items() if _read(folder / name) != content}
    if arguments.check and stale:
        sys.exit(messages.stale_files(names=list(stale), folder=str(folder)))
    folder.mkdir(parents=True, exist_ok=True)
    schema = json.dumps(build_openapi_schema(), ensure_ascii=False) + "\n"
    for name, content in {**stale, "openapi.json": schema}.items():
        (folder / name).write_text(content, encoding="utf-8")


def _read(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.exists() else None


if __name__ == "__main__":
    main()
