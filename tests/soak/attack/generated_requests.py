"""Requests with generated documents and expressions from a seed: the same in every run, some valid, most nearly."""

import json
import random
import string
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

from backend.experiments.library import READY_NAMES, load_ready_text
from backend.plain_text import escape_line

Request = tuple[str, str, Any]
"""Method, path and JSON body, None for none."""

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="180mm" height="90mm" viewBox="0 0 900 450">'
NUMBERS = (0, 1, -1, 0.5, 2, 3.7, 1e-9, 1e9, 1e300, -1e12, 2**53, 10**18, 10**30, True, None, "1", "", "nan", "1e999")
LETTERS = string.ascii_letters + "λ_q′漢😀=@+-,;\n\t\r\x1b\u202e\u200b\ud800\0"
MOTIONS = (
    "hold",
    "step",
    "ramp",
    "pulse",
    "sine",
    "sweep",
    "prbs",
    "multisine",
    "push",
    "hand",
    "load",
    "tuning",
    "wall",
)
FIELDS = (
    "duration_s",
    "q_ref",
    "S_ref",
    "period_s",
    "rest_s",
    "bits",
    "chip_s",
    "periods",
    "lines",
    "from_Hz",
    "to_Hz",
    "F_push",
    "pushes",
    "pause_s",
    "seed",
    "q_amplitude",
    "load_A",
    "q_wall",
    "lam_q",
    "bank",
)
READ = (
    "/api/runs?where={words}&search={words}",
    "/api/metric-history?kind={words}&where={words}",
    "/api/log?words={words}",
    "/api/tuning/preview?lam_q={number}&lam_S={number}&S={number}&printed=true&k_ext={number}",
    "/api/tuning/motor?lam_motor={number}",
    "/api/tuning/robust?M_s={number}",
    "/api/experiments/texts/{words}",
    "/api/experiments/as-run/{number}",
    "/api/run-comparison?run=1&run={number}",
    "/api/runs/{number}/planned",
    "/api/runs/1/samples?signals=q,S&from_s={number}&to_s={number}",
    "/api/banks/{number}/detail",
    "/api/experiments",
    "/api/experiments/own",
)


def generated(dice: random.Random) -> Request:
    """Return one request."""
    ways: tuple[tuple[int, Callable[[random.Random], Request]], ...] = (
        (35, _check),
        (10, _changed_ready_made),
        (15, _read),
        (10, _sheet),
        (8, _prediction),
        (8, _preferences),
        (6, _dry_run),
        (4, _bank),
        (4, _spring),
    )
    return dice.choices([way for _, way in ways], [weight for weight, _ in ways])[0](dice)


def expression(dice: random.Random, depth: int = 0) -> str:
    """Return an expression, sometimes too long, deep or large."""
    if depth == 0 and dice.random() < 0.05:
        return dice.choice(("(" * 60 + "1" + ")" * 60, "1 + " * 300 + "1", "-" * 90 + "a", "9" * 190))
    if depth > 3 or dice.random() < 0.35:
        return dice.choice(("a", "i", "pi", "x", f"{dice.uniform(-9, 9):.3g}", str(dice.choice(NUMBERS)), "9" * 30))

    def inner() -> str:
        return expression(dice, depth + 1)

    forms: tuple[Callable[[], str], ...] = (
        lambda: f"({inner()} {dice.choice('+-*/%')} {inner()})",
        lambda: f"{inner()} ** {inner()}",
        lambda: f"round({inner()}, {dice.choice((2, -1, 15, -1000000000, 10**20))})",
        lambda: f"{dice.choice(('min', 'max', 'abs', 'sqrt', 'exec', 'pow'))}({inner()}, {inner()})",
        lambda: f"({inner()} if {inner()} < {inner()} else {inner()})",
        lambda: f"-{inner()}",
    )
    return dice.choice(forms)()


def document(dice: random.Random) -> dict[str, Any]:
    """Return an experiment, usually of valid form."""
    names = dice.sample(string.ascii_lowercase, 3)
    setting = {"symbol": _words(dice), "meaning": _words(dice), "minimum": 0, "maximum": 10}
    made: dict[str, Any] = {
        "format": 1,
        "name": "".join(names),
        "title": _words(dice) or "x",
        "settings": [{"name": "a", "default": dice.choice((1, 2.5, expression(dice))), **setting}],
        "phases": [
            {"name": f"p{number}", "title": "P", "parts": [_part(dice) for _ in range(dice.randint(1, 4))]}
            for number in range(dice.choice((1, 1, 2, 90)))
        ],
        "rules": [{"that": f"{expression(dice)} < {expression(dice)}", "remedy": "x"}] * dice.choice((0, 0, 1, 200)),
    }
    if dice.random() < 0.1:
        made[dice.choice(("formats", "law", "measures", "criteria"))] = dice.choice(NUMBERS)
    return made


def _part(dice: random.Random, depth: int = 0) -> dict[str, Any]:
    if depth < 6 and dice.random() < 0.25:
        times = dice.choice((2, 3, 1000, 10**9, expression(dice)))
        return {"do": "repeat", "times": times, "parts": [_part(dice, depth + 1) for _ in range(2)]}
    named = {name: _value(dice) for name in dice.sample(FIELDS, dice.randint(0, 2))}
    return {"do": dice.choice(MOTIONS), "duration_s": dice.choice((0.5, 1, 600, expression(dice))), **named}


def _value(dice: random.Random) -> Any:
    return dice.choice((dice.uniform(-2.0, 12.0), expression(dice), dice.choice(NUMBERS)))


def _words(dice: random.Random) -> str:
    length = dice.choice((3, 8, 8, 40, 900))
    return "".join(dice.choice(LETTERS[: dice.choice((52, len(LETTERS)))]) for _ in range(length))


def _check(dice: random.Random) -> Request:
    made = document(dice)
    text = json.dumps(made, ensure_ascii=dice.random() < 0.5)
    if dice.random() < 0.2:
        place = dice.randrange(len(text))
        text = (
            text[:place] + dice.choice(("[", "{", "&x ", "*x", "!!python/object ", "\t", '"', "\\ud800")) + text[place:]
        )
    if dice.random() < 0.05:
        text *= dice.choice((2, 20))
    path = "/api/experiments/own" if dice.random() < 0.1 else "/api/experiments/check"
    return "POST", path, {"text": text} | ({} if path.endswith("own") else {"play": False})


def _changed_ready_made(dice: random.Random) -> Request:
    lines = load_ready_text(dice.choice(READY_NAMES)).splitlines()
    for _ in range(dice.randint(0, 3)):
        place = dice.randrange(len(lines))
        lines[place] = lines[place].replace(dice.choice("0123456789"), expression(dice), 1)
    return "POST", "/api/experiments/check", {"text": "\n".join(lines), "play": False}


def _read(dice: random.Random) -> Request:
    path = dice.choice(READ)
    while "{" in path:
        words = quote(escape_line(_words(dice)), safe="")[:300]
        number = quote(str(dice.choice((dice.choice(NUMBERS), round(dice.uniform(0.0, 12.0), 3)))))
        path = path.replace("{words}", words, 1).replace("{number}", number, 1)
    return "GET", path, None


def _sheet(dice: random.Random) -> Request:
    shapes = (
        lambda: f'<path d="M0 0{"h1v1" * dice.choice((1, 100, 100_000))}" fill="none" stroke="#0072B2"/>',
        lambda: f'<text x="9" y="9">{"a漢b " * dice.choice((1, 20, 200))}</text>' * dice.choice((1, 50, 2_000)),
        lambda: "<g>" * dice.choice((1, 20)),
        lambda: '<rect width="1" height="2"/>' * dice.choice((1, 1_000, 30_000)),
        lambda: f"<{dice.choice(('script', 'image', 'use', 'a'))}/>",
    )
    drawn = "".join(dice.choice(shapes)() for _ in range(dice.randint(1, 4)))
    return "POST", "/api/chart-sheet.pdf", {"svg": f"{SVG}{drawn}</svg>"[: 2 * 1024 * 1024 - 1]}


def _prediction(dice: random.Random) -> Request:
    named = ("tension_N", "amplitude_rad", "chip_s", "bits", "periods", "settle_s", "levels", "F_low", "cycles")
    body: dict[str, Any] = {name: _number(dice) for name in dice.sample(named, dice.randint(0, 4))}
    return (
        "POST",
        "/api/identifications/prediction",
        {"kind": dice.choice(("actuator", "motor", "spring", "x")), **body},
    )


def _number(dice: random.Random) -> Any:
    return dice.choice((dice.randint(1, 12), round(dice.uniform(0.0, 40.0), 2), dice.choice(NUMBERS)))


def _preferences(dice: random.Random) -> Request:
    shapes = (
        lambda: {f"a{number}": dice.choice(NUMBERS) for number in range(dice.choice((1, 100, 20_000)))},
        lambda: {"hidden": [{}] * dice.choice((1, 50_000)), "scheme": "dark"},
        lambda: {"layouts": [{"version": 1, "name": _words(dice), "panels": [{}] * dice.choice((1, 400))}]},
    )
    return "PUT", "/api/preferences", dice.choice(shapes)()


def _dry_run(dice: random.Random) -> Request:
    settings = {f"{name}": _number(dice) for name in dice.sample(("lam_q", "lam_S", "q_duration_s", "bank", "b"), 2)}
    return (
        "POST",
        "/api/experiments/dry-run",
        {"name": dice.choice((*READY_NAMES, _words(dice)[:60])), "settings": settings},
    )


def _bank(dice: random.Random) -> Request:
    entry = {name: _number(dice) for name in ("S_nominal", "K_q", "T_q", "K_S", "T_S")}
    body = {"name": _words(dice)[:60], "entries": [entry] * dice.choice((1, 20, 30))}
    return "POST", "/api/banks/file", body


def _spring(dice: random.Random) -> Request:
    rows = "\n".join(
        f"{dice.uniform(0, 0.05):.5f},{dice.uniform(0, 60):.3f}" for _ in range(dice.choice((3, 60, 9_000)))
    )
    return "POST", "/api/spring-tables", {"name": _words(dice)[:120], "table": f"x [m],F [N]\n{rows}"}
