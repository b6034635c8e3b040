"""The command in a report plays its run again: parsed out of page and PDF, run as it is, metrics compared."""

import json
import re
import shlex
from html import unescape
from pathlib import Path

import pytest
from pypdf import PdfReader

from tests.cli.conftest import Command

_BLOCK = re.compile(r'<p class="code">(.*?)</p>\n<pre[^>]*><code>(.*?)</code></pre>', re.DOTALL)


def blocks_of(page: str) -> dict[str, str]:
    """Return the blocks to copy of a page, by the first word of their captions."""
    return {unescape(caption).split()[0].rstrip(","): unescape(text) for caption, text in _BLOCK.findall(page)}


def played_again(command: Command, report: Path, monkeypatch: pytest.MonkeyPatch, folder: Path) -> dict[str, object]:
    """Run the command of a report in an empty folder, with the files that stand below it; return the metrics."""
    blocks = blocks_of(report.read_text(encoding="utf-8"))
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name in ("parameters.toml", "experiment.json"):
        if name in blocks:
            Path(name).write_text(blocks[name], encoding="utf-8")
    line = blocks["Play"]
    assert line.isascii()
    words = shlex.split(line.replace("\\\n", " "))
    assert words[0] == "sinew"
    again = command(*words[1:])
    assert again.returncode == 0, again.stderr
    return metrics_of(folder / "reproduced" / "report")


def metrics_of(folder: Path) -> dict[str, object]:
    document = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    return {name: document[name] for name in ("metrics", "criteria", "steps", "settings", "verdict")}


def test_an_experiment_is_played_again_to_the_same_metrics(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    values = {"q_duration_s": 1.5, "S_duration_s": 1, "lam_q": 0.61, "b": 0.3, "u_plan": 0, "seed": 11}
    words = [word for name, value in values.items() for word in ("--set", f"{name}={value}")]
    assert command("experiment", "tracking", *words, "--out", str(out), folder=tmp_path / "here").returncode == 0
    again = played_again(command, out / "report.html", monkeypatch, tmp_path / "again")
    assert again == metrics_of(out)
    page = blocks_of((out / "report.html").read_text(encoding="utf-8"))["Play"]
    pdf = "\n".join(sheet.extract_text() for sheet in PdfReader(out / "report.pdf").pages)
    assert [line.strip() for line in page.splitlines()] == [
        line.strip() for line in pdf[pdf.index("sinew experiment") :].splitlines()[: len(page.splitlines())]
    ]


def test_an_own_experiment_on_own_parameters_is_played_again_from_the_files_in_its_report(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, own, plant = tmp_path / "out", tmp_path / "Nudge.yaml", tmp_path / "bench.toml"
    own.write_text(
        "format: 1\nname: nudge\ntitle: Nudge\nmeasures: [steps]\nphases:\n"
        "  - name: only\n    title: Only\n    parts:\n"
        "      - {do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 1.0}\n"
        "      - {do: step, q_ref: 0.2, S_ref: 10.0, duration_s: 1.5}\n",
        encoding="utf-8",
    )
    lab = Path("plant/parameters/ideal.toml").read_text(encoding="utf-8")
    plant.write_text(re.sub(r"(J_j = \{ value = )[^,]+", r"\g<1>6.1e-4", lab), encoding="utf-8")
    words = ("experiment", str(own), "--params", str(plant), "--out", str(out))
    done = command(*words, folder=tmp_path / "here")
    assert done.returncode == 0, done.stderr
    again = played_again(command, out / "report.html", monkeypatch, tmp_path / "again")
    assert again == metrics_of(out)


def test_a_sequence_is_played_again(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    segments = '[{"duration_s": 1, "q_ref": 0.1, "S_ref": 9}, {"duration_s": 1, "q_ref": 0, "S_ref": 9}]'
    words = ("experiment", "sequence", "--set", f"segments={segments}", "--out", str(out))
    assert command(*words, folder=tmp_path / "here").returncode == 0
    again = played_again(command, out / "report.html", monkeypatch, tmp_path / "again")
    assert again["metrics"] == metrics_of(out)["metrics"]
    assert again["verdict"] == metrics_of(out)["verdict"]


def test_an_identification_is_played_and_estimated_again(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    short = ("--set", "periods=1", "--set", "bits=6", "--set", "settle_s=4")
    assert command("identify", "actuator", *short, "--out", str(out), folder=tmp_path / "here").returncode == 0
    stored = json.loads((out / "metrics.json").read_text(encoding="utf-8"))["identification"]["model"]
    again = played_again(command, out / "report.html", monkeypatch, tmp_path / "again")
    assert again == metrics_of(out)
    monkeypatch.chdir(out)
    lines = blocks_of((out / "report.html").read_text(encoding="utf-8"))["To"].replace("\\\n", " ").splitlines()
    for key, line in zip(("G_q", "G_S"), lines, strict=True):
        found = command(*shlex.split(line)[1:], "--json")
        assert found.returncode == 0, found.stderr
        told = json.loads(found.stdout)
        assert told["parameters"] == pytest.approx(stored[key]["parameters"], rel=1e-4)
