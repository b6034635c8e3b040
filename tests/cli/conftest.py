import subprocess
import sys
from pathlib import Path
from typing import Protocol

import pytest

from backend.cli import main


class Command(Protocol):
    """Runs a command in this process, because a separate process takes seconds of imports."""

    def __call__(self, *words: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]: ...


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    def run(*words: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
        data = () if folder is None else ("--data", str(folder))
        monkeypatch.setattr(sys, "argv", ["sinew", *words, *data])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return subprocess.CompletedProcess(words, int(ended.value.code or 0), printed.out, printed.err)

    return run
