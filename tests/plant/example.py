"""The example package as a user installs it, found by its entry point."""

import shutil
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).parent / "example_package"
NAME = "two-springs"


def installed_in(folder: Path, source: Path = SOURCE) -> Path:
    """Install the package below ``folder`` and return what has to be on Python's path."""
    copied, site = folder / "source", folder / "site"
    shutil.copytree(source, copied)  # where it is built it may leave files
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"]
    command = [*pip, "--no-build-isolation", "--target", str(site), str(copied)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return site
