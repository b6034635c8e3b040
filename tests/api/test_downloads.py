"""Downloads of samples: streams that are refused before they begin, and end with whoever takes them."""

import io
import zipfile
from pathlib import Path

import httpx
import numpy as np
import pandas
import pytest

from backend.exports.importer import import_bundle
from backend.exports.importer import import_export as take_in_samples
from backend.exports.mcap import foxglove_layout
from backend.storage import runs
from backend.storage.database import open_database
from tests.api.conftest import ended, once_told, until, wait_for
from tests.e2e.service import Service


@pytest.fixture(scope="module")
def run(operator: httpx.Client) -> int:
    operator.post("/api/stop").raise_for_status()
    operator.post("/api/reset").raise_for_status()
    operator.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    wait_for(operator, "pretension_done", True)
    operator.post("/api/mode", json={"mode": "run"}).raise_for_status()
    number = int(once_told(operator, "recording_run")["recording_run"])
    operator.post("/api/stop").raise_for_status()
    ended(operator, number)
    return number


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat", "mcap"])
def test_every_format_is_taken_in_again(operator: httpx.Client, run: int, kind: str, tmp_path: Path) -> None:
    answer = operator.get(f"/api/runs/{run}/data.{kind}").raise_for_status()
    assert answer.headers["content-disposition"] == f'attachment; filename="sinew-run-{run}.{kind}"'
    assert "content-length" not in answer.headers  # a stream
    (tmp_path / f"run.{kind}").write_bytes(answer.content)
    database = open_database(tmp_path / "empty")
    assert take_in_samples(database, tmp_path / f"run.{kind}", "Ben").new
    database.close()


def test_a_bundle_is_taken_in_elsewhere(operator: httpx.Client, run: int, tmp_path: Path) -> None:
    file = tmp_path / "run.zip"
    file.write_bytes(operator.get(f"/api/runs/{run}/bundle.zip").raise_for_status().content)
    assert f"recordings/{run}.parquet" in zipfile.ZipFile(file).namelist()
    database = open_database(tmp_path / "empty")
    taken = import_bundle(database, file, "Ben", tmp_path)
    with database.reading() as session:
        assert runs.get(session, taken.run).kind == "session"
    database.close()


def test_what_cannot_be_had_is_refused_before_the_first_byte(operator: httpx.Client, viewer: httpx.Client) -> None:
    for path in ("data.csv", "data.mcap", "bundle.zip"):
        assert operator.get(f"/api/runs/999999/{path}").status_code == 404
    assert viewer.get("/api/runs/foxglove-layout.json").raise_for_status().text == foxglove_layout()


def test_a_viewer_reads_what_the_operator_recorded(viewer: httpx.Client, run: int) -> None:
    text = viewer.get(f"/api/runs/{run}/data.csv").raise_for_status().text
    table = pandas.read_csv(io.StringIO(text), comment="#")
    np.testing.assert_allclose(np.diff(table["t"]), 1e-3, atol=1e-9)


def test_who_leaves_leaves_no_process_behind(service: Service, operator: httpx.Client, run: int) -> None:
    with operator.stream("GET", f"/api/runs/{run}/data.csv") as answer:
        next(answer.iter_bytes(64))
    until(lambda: True if not _writers(service) else None)


def _writers(service: Service) -> list[str]:
    """Processes of the service that write a download."""
    found = []
    for task in Path(f"/proc/{service.pid}/task").iterdir():
        for child in (task / "children").read_text(encoding="ascii").split():
            status = Path(f"/proc/{child}/cmdline").read_bytes()
            if task.name != str(service.pid) and b"multiprocessing.spawn" in status:
                found.append(child)
    return found
