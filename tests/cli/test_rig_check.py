"""``sinew rig check``: a wiring file is refused with line and remedy, a right one said to be so."""

import json
import sys
from pathlib import Path

import pytest

from backend.cli import main

SHIPPED = Path(__file__).parents[2] / "plant/wirings/pcie-6323.toml"


def test_the_shipped_wiring_is_in_order(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", "check"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert "pcie-6323: channels, units and calibrations are in order" in capsys.readouterr().out


def test_each_mistake_is_told_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "mine.toml"
    wrong.write_text(SHIPPED.read_text().replace('channel = "ai1"', 'channel = "ai99"').replace('"ctr2"', '"ctr1"'))
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", "check", "--wiring", str(wrong)])
    with pytest.raises(SystemExit) as ended:
        main()
    told = capsys.readouterr().err
    lines = wrong.read_text().splitlines()
    unknown = next(number for number, line in enumerate(lines, 1) if "ai99" in line)
    twice = [number for number, line in enumerate(lines, 1) if '"ctr1"' in line][1]
    assert ended.value.code == 1
    assert f"mine.toml:{unknown}: load_cell_B.channel: 'ai99' is not known" in told
    assert f"mine.toml:{twice}: encoder_B.counter: " in told
    assert [line.split(":")[:3] for line in told.splitlines()] == [
        ["sinew", " mine.toml", str(number)] for number in sorted([unknown, twice])
    ]
    monkeypatch.setattr(sys, "argv", ["sinew", "serve", "--plant", "rig", "--virtual-card", "--wiring", str(wrong)])
    with pytest.raises(SystemExit):
        main()
    assert capsys.readouterr().err == told


def test_programs_read_the_mistakes_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "mine.toml"
    wrong.write_text(SHIPPED.read_text().replace('channel = "ai1"', 'channel = "ai99"'))
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", "check", "--wiring", str(wrong), "--json"])
    with pytest.raises(SystemExit):
        main()
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert problem["entry"] == "load_cell_B.channel"
    assert "ai99" in wrong.read_text().splitlines()[problem["line"] - 1]


@pytest.mark.parametrize("words", [["--open"], ["--open", "--json"]])
def test_a_card_that_cannot_be_opened_is_told_in_either_form(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["sinew", "rig", "check", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code == 1
    assert "install NI-DAQmx" in printed.err
    assert printed.out == ""
