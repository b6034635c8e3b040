"""A robot operates the real page for a long time: after each action the page agrees with the service."""

import tempfile
from pathlib import Path

from rich.console import Console

from tests.e2e.browser import chromium
from tests.e2e.service import running_service
from tests.e2e.truth.robot import UntrueError, fresh_seed, robot_at_work

DEEDS = 200


def truthful_page(seed: int | None, deeds: int, console: Console) -> bool:
    """Let the robot perform actions from ``seed`` or a random one; return whether the page always agreed."""
    chosen = fresh_seed() if seed is None else seed
    console.print(f"truth: {deeds} deeds of seed {chosen}; --seed {chosen} does them again")
    with tempfile.TemporaryDirectory() as data, running_service(Path(data)) as service, chromium() as browser:
        try:
            robot_at_work(browser, service, chosen, deeds, console.print)
        except UntrueError as untrue:
            console.print(f"UNTRUE: {untrue}")
            return False
    console.print(f"truth: page and service agreed after each of {deeds} deeds of seed {chosen}")
    return True
