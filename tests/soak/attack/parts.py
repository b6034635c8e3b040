"""The parts of the attack, and the distribution of 400 kills over them."""

import argparse
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from rich.console import Console

from tests.soak.attack.costly import under_costly_requests
from tests.soak.attack.ending import end_service
from tests.soak.attack.floods import under_floods
from tests.soak.attack.frozen import freeze
from tests.soak.attack.full_disk import fill_disk
from tests.soak.attack.generated import REQUESTS, under_generated_requests
from tests.soak.attack.kill_loop import kill_card_loop, kill_loop
from tests.soak.attack.kill_pool import kill_pool
from tests.soak.attack.kill_service import kill_service
from tests.soak.attack.kill_watchdog import kill_watchdog
from tests.soak.attack.killed_commands import KILLS as COMMAND_KILLS
from tests.soak.attack.killed_commands import kill_commands
from tests.soak.attack.load import under_load
from tests.soak.attack.lost_folder import lose_folder
from tests.soak.attack.wrong_clock import move_clock

Part = Callable[[argparse.Namespace, Console], bool]

KILLS: Mapping[str, tuple[int, Callable[[int, Console], bool]]] = {
    "service-kills": (30, kill_service),
    "loop-kills": (120, kill_loop),
    "card-kills": (100, kill_card_loop),
    "watchdog-kills": (75, kill_watchdog),
    "pool-kills": (75, kill_pool),
}
"""Share of each in the kills, and what kills. A new service takes longer than a new loop: so there are fewer."""

KILLS_IN_ALL = sum(share for share, _ in KILLS.values())

TURNS: Mapping[str, Callable[[int, Console], bool]] = {
    "frozen": freeze,
    "clock": move_clock,
    "disk-full": fill_disk,
    "folder-lost": lose_folder,
    "signals": end_service,
}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--kills", type=int, default=KILLS_IN_ALL, help=f"kills in all, spread over those that kill ({KILLS_IN_ALL})"
    )
    parser.add_argument("--presses", type=int, default=40, help="how often STOP is pressed under each crowd (40)")
    parser.add_argument(
        "--command-kills", type=int, default=COMMAND_KILLS, help=f"kills of commands in all ({COMMAND_KILLS})"
    )
    parser.add_argument("--requests", type=int, default=REQUESTS, help=f"generated requests in all ({REQUESTS})")
    parser.add_argument("--sockets", type=int, default=5000, help="idle sockets at the door (5000)")
    parser.add_argument("--turns", type=int, default=3, help="how often all else is done to the service (3)")


def parts(chosen: Iterable[str]) -> dict[str, Part]:
    """Return the parts of the attack by name; those of ``chosen`` that kill share the kills."""
    shares = {name: share for name, (share, _) in KILLS.items() if name in chosen} or dict.fromkeys(KILLS, 1)
    made: dict[str, Part] = {"crowds": lambda given, console: under_load(given.presses, given.sockets, console)}
    made["costly"] = lambda given, console: under_costly_requests(given.presses, console)
    made["generated"] = lambda given, console: under_generated_requests(given.requests, given.seed, console)
    made["floods"] = lambda given, console: under_floods(given.presses, console)
    made["commands-killed"] = lambda given, console: kill_commands(given.command_kills, console)
    for name, (share, kill) in KILLS.items():
        made[name] = partial(_killing, kill, share / sum(shares.values()))
    for name, attack in TURNS.items():
        made[name] = partial(_in_turns, attack)
    return made


def _killing(kill: Callable[[int, Console], bool], portion: float, given: argparse.Namespace, console: Console) -> bool:
    return kill(max(1, round(given.kills * portion)), console)


def _in_turns(attack: Callable[[int, Console], bool], given: argparse.Namespace, console: Console) -> bool:
    return attack(given.turns, console)


NAMES = ("crowds", "costly", "generated", "floods", "commands-killed", *KILLS, *TURNS)
