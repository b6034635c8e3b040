"""The paper's own procedure run on the `lab` plant, set beside what the paper published (docs/fidelity.md).

``python -m tests.bench.fidelity --write docs/fidelity.md`` makes the tables of that page anew; without ``--write`` it
prints them. Everything is simulated with fixed seeds, so that the same code gives the same page.
"""

import argparse
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from backend.controllers.decoupler import decoupler_for, stiffness_slope
from backend.experiments.plans.plan import ActuatorIdentificationPlan
from backend.identification.errors import IdentificationError
from backend.identification.estimate import estimate
from backend.identification.fit import Method
from backend.identification.motor import identify_motor
from backend.identification.published import TABLE_1
from backend.identification.record import Record
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from tests.bench.fidelity_experiments import figure_7_rows, figure_8_rows, robustness_rows
from tests.bench.fidelity_runs import Array, Bench, first_order_output_error, newtons_per_count, unloaded_steps

POSITIONS = 4
"""Rest positions within one count of the joint encoder from which the 1 ms excitation is repeated."""


Columns = dict[str, Array]


@dataclass(frozen=True)
class Runs:
    """Records at one tension: the default excitation, and the paper's 1 ms one from several rest positions."""

    default: Columns
    paper: tuple[Columns, ...]


def default_plan(tension_N: float) -> ActuatorIdentificationPlan:
    """Chips of 80 ms, 7 bits, ±1 rad, two periods."""
    return ActuatorIdentificationPlan(tension_N=tension_N)


def paper_plan(tension_N: float) -> ActuatorIdentificationPlan:
    """Chips of 1 ms as in the paper; amplitude, register and length are ours: ±0.5 rad, 12 bits, 20 s."""
    return ActuatorIdentificationPlan(tension_N=tension_N, amplitude_rad=0.5, chip_s=0.001, bits=12, periods=5)


def play_all(parameters: PlantParameters) -> dict[float, Runs]:
    """Play every record, one after the other on one headless loop."""
    bench, runs = Bench(parameters), {}
    for tension, row in TABLE_1.items():
        count = newtons_per_count(parameters, row.S)
        default = bench.play(default_plan(tension))
        shifted = (tension + count * position / POSITIONS for position in range(POSITIONS))
        runs[tension] = Runs(default, tuple(bench.play(paper_plan(held)) for held in shifted))
    return runs


def motor_rows(parameters: PlantParameters) -> Iterator[list[str]]:
    yield ["paper, equation 17", "2.86", "0.22"]
    runs = unloaded_steps(parameters)
    for name, chosen in (("A", runs["A"]), ("B", runs["B"]), ("A and B", runs["A"] + runs["B"])):
        found = identify_motor(chosen)
        (K_m, T_m), (K_spread, T_spread) = found.rule_mean, found.rule_spread
        yield [f"{name}, 63.21 % rule", f"{K_m:.3f} ± {K_spread:.3f}", f"{T_m:.3f} ± {T_spread:.3f}"]
        yield [f"{name}, least squares", f"{found.K_m:.3f}", f"{found.T_m:.3f}"]
    yield ["true constants in `lab.toml`", f"{parameters.motor.K_m:g}", f"{parameters.motor.T_m:g}"]


def gain_rows(parameters: PlantParameters, records: dict[float, Columns]) -> Iterator[list[str]]:
    g = parameters.geometry
    for tension, record in records.items():
        row = TABLE_1[tension]
        G_q = estimate(Record(T_s, record["theta_A_ref"], record["q"]), "lags4")
        G_S = estimate(Record(T_s, record["theta_A_ref"], record["S"]), "order:4")
        gain_q, gain_S = g.r_m / (2.0 * g.r_j), stiffness_slope(decoupler_for(parameters), row.S)
        yield [
            f"{tension:g} N", f"{row.K_q:.4f}", *_gain(G_q.first_order.K, gain_q), f"{G_q.first_order.T:.3f}",
            f"{row.K_S:.3f}", *_gain(G_S.first_order.K, gain_S), f"{G_S.first_order.T:.3f}",
        ]  # fmt: skip


def first_order_rows(runs: dict[float, Runs], signal: str) -> Iterator[list[str]]:
    for tension, row in TABLE_1.items():
        found = np.array([first_order_output_error(run["theta_A_ref"], run[signal]) for run in runs[tension].paper])
        K, T, fit = found.mean(axis=0)
        scatter = np.ptp(found, axis=0)[:2] / 2.0
        by_arx = _arx(runs[tension].paper[0], signal)
        published = (row.K_q, row.T_q) if signal == "q" else (row.K_S, row.T_S)
        yield [
            f"{tension:g} N", f"{published[0]:g}", f"{published[1]:g}", f"{K:.3f} ± {scatter[0]:.3f}",
            f"{T:.2f} ± {scatter[1]:.2f}", f"{fit:.0f} %", *by_arx,
        ]  # fmt: skip


def third_order_rows(parameters: PlantParameters, runs: dict[float, Runs], signal: str) -> Iterator[list[str]]:
    g = parameters.geometry
    for tension, row in TABLE_1.items():
        K, T, a2, a1 = (
            (row.K_q, row.T_q, row.a2_q, row.a1_q) if signal == "q" else (row.K_S, row.T_S, row.a2_S, row.a1_S)
        )
        yield [
            f"{tension:g} N", _third(K, T, a2, a1), _fitted_third(runs[tension].paper[0], signal),
            _fitted_third(runs[tension].default, signal), f"{g.J_j / row.S:.2e}; {g.B_j / row.S:.2e}",
        ]  # fmt: skip


def _gain(found: float, geometry: float) -> tuple[str, str]:
    return f"{found:.4f}", f"{100.0 * (found / geometry - 1.0):+.1f} %"


def _arx(run: Columns, signal: str) -> tuple[str, str]:
    try:
        found = estimate(Record(T_s, run["theta_A_ref"], run[signal]), "first", Method.ARX)
    except IdentificationError:
        return "none", "none"
    return f"{found.first_order.K:.3f}", f"{found.first_order.T:.2f}"


def _fitted_third(run: Columns, signal: str) -> str:
    try:
        found = estimate(Record(T_s, run["theta_A_ref"], run[signal]), "third", Method.OUTPUT_ERROR)
    except IdentificationError:
        return "none"
    return _third(*(found.model.parameters[name] for name in ("K", "T", "a2", "a1")))


def _third(K: float, T: float, a2: float, a1: float) -> str:
    return f"{K:.3g}; {T:.3g}; {a2:.2e}; {a1:.2e}"


def tables(parameters: PlantParameters) -> dict[str, str]:
    """All tables of the page in Markdown, by the name of the comment that marks their place."""
    runs = play_all(parameters)
    joint = "J_j/S [s²]; B_j/S [s]"
    first = ["tension", "paper: K", "T [s]", "output error: K", "T [s]", "fit", "ARX: K", "T [s]"]
    third = ["tension", "paper", "1 ms excitation", "80 ms excitation", joint]
    gains = ["tension", "paper: K_q", "K_q", "against geometry", "sum of lags [s]",
             "paper: K_S", "K_S", "against geometry", "sum of lags [s]"]  # fmt: skip
    return {
        "motor": _markdown(["", "K_m [rad/(V·s)]", "T_m [s]"], motor_rows(parameters)),
        "gains": _markdown(gains, gain_rows(parameters, {tension: played.default for tension, played in runs.items()})),
        "first order G_q": _markdown(first, first_order_rows(runs, "q")),
        "first order G_S": _markdown(first, first_order_rows(runs, "S")),
        "third order G_q": _markdown(third, third_order_rows(parameters, runs, "q")),
        "third order G_S": _markdown(third, third_order_rows(parameters, runs, "S")),
        "figure 7": _markdown(["what the paper's text says", "here"], figure_7_rows(parameters)),
        "figure 8": _markdown(
            ["pushes", "raw [N]", "aligned [N]", "offset at rest [N]", "rms of dF/dt [N/s]"], figure_8_rows(parameters)
        ),
        "robustness": _markdown(
            ["", "load", "motors A, B off by [rad]", "back within [s]", "joint off by [rad]", "tensions [N]"],
            robustness_rows(parameters, load_parameters("ideal")),
        ),
    }


def _markdown(headings: list[str], rows: Iterator[list[str]]) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _under_its_comment(table: str, place: re.Match[str]) -> str:
    return f"{place[1]}{table}\n"


def write(page: Path, made: dict[str, str]) -> None:
    """Put each table in its place, between its comment and the next empty line. Raises ValueError without the place."""
    text = page.read_text(encoding="utf-8")
    for name, table in made.items():
        text, places = re.subn(rf"(<!-- table: {name} -->\n)(\|.*\n)*", partial(_under_its_comment, table), text)
        if places != 1:
            raise ValueError(f"{page} has {places} places for the table {name!r}, not one")
    page.write_text(text, encoding="utf-8")


def main() -> None:
    """Print the tables or write them into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, metavar="PAGE", help="Markdown page whose tables to replace")
    page = parser.parse_args().write
    made = tables(load_parameters("lab"))
    if page is None:
        print("\n\n".join(f"{name}\n{table}" for name, table in made.items()))
    else:
        write(page, made)


if __name__ == "__main__":
    main()
