"""The notebook of docs/how-to/notebook.md, executed from top to bottom on a running service."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.api.conftest import until
from tests.e2e.service import running_service

pytestmark = pytest.mark.live

PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "notebook.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_code_blocks_of_the_notebook_run_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert len(BLOCKS) == 5
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    with running_service(tmp_path / "data") as service:
        for count in range(2):  # the second time, there is another run for the comparison
            for block in BLOCKS:
                exec(block.replace("http://127.0.0.1:8000", service.url), names)
            until(lambda: names["sinew"].get("/api/state").json()["holder"] is None)
            assert names["run"] == count + 1
        names["sinew"].close()
    samples, metrics, comparison = names["samples"], names["metrics"], names["comparison"]
    assert names["units"]["q"] == "rad"
    assert np.all(np.diff(samples.index) > 0)
    recorded = float(np.sqrt(np.mean((samples["q_ref"] - samples["q"]) ** 2)))
    assert metrics.loc["rmse_q", "value"] == pytest.approx(recorded, rel=1e-3)
    assert list(comparison.index) == [2, 1]
    assert set(names["settings"]["name"]) >= {"q_duration_s", "S_duration_s", "q_amplitude"}
    assert (tmp_path / "run-2.html").read_text().startswith("<!DOCTYPE html>")
    assert f"root mean square of the error: {recorded:.4f} rad" in capsys.readouterr().out
