"""Identification tables of docs/explanation/fidelity.md: the paper's procedure on `lab`, and the published values."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from backend.control.decoupler import build_decoupler, stiffness_slope
from backend.experiments.plans import ActuatorIdentificationPlan
from backend.identification.estimation import estimate_model
from backend.identification.fitting import Method
from backend.identification.models import TABLE_1
from backend.identification.motor import identify_motor
from backend.identification.records import IdentificationError, Record
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from tests.docs.figures.identification_runs import (
    Array,
    Bench,
    first_order_output_error,
    newtons_per_count,
    unloaded_steps,
)
from tests.docs.figures.places import Computation, Found, Place, Rows, Table, Values

POSITIONS = 4
"""Rest positions within one count of the joint encoder from which the 1 ms excitation is repeated."""

PAGE = "docs/explanation/fidelity.md"
_FIRST = ("tension", "paper: K", "T [s]", "output error: K", "T [s]", "fit", "ARX: K", "T [s]")
_THIRD = ("tension", "paper", "1 ms excitation", "80 ms excitation", "J_j/S [s²]; B_j/S [s]")

MOTOR = Table(PAGE, "motor", ("", "K_m [rad/(V·s)]", "T_m [s]"))
GAINS = Table(
    PAGE,
    "gains",
    (
        "tension",
        *("paper: K_q", "K_q", "against geometry", "sum of lags [s]"),
        *("paper: K_S", "K_S", "against geometry", "sum of lags [s]"),
    ),
)
FIRST_ORDER = {signal: Table(PAGE, f"first order G_{signal}", _FIRST) for signal in ("q", "S")}
THIRD_ORDER = {signal: Table(PAGE, f"third order G_{signal}", _THIRD) for signal in ("q", "S")}

Columns = dict[str, Array]


@dataclass(frozen=True)
class Runs:
    """Records at one tension: the default excitation, and the paper's 1 ms one from several rest positions."""

    default: Columns
    paper: tuple[Columns, ...]


def default_plan(tension_N: float) -> ActuatorIdentificationPlan:
    """Return the default: chips of 80 ms, 7 bits, ±1 rad, two periods."""
    return ActuatorIdentificationPlan(tension_N=tension_N)


def paper_plan(tension_N: float) -> ActuatorIdentificationPlan:
    """Return chips of 1 ms as in the paper; amplitude, register and length are chosen: ±0.5 rad, 12 bits, 20 s."""
    return ActuatorIdentificationPlan(tension_N=tension_N, amplitude_rad=0.5, chip_s=0.001, bits=12, periods=5)


def played_at(parameters: PlantParameters, tension: float) -> Runs:
    """Execute all identifications of one tension successively on one headless loop."""
    bench = Bench(parameters)
    count = newtons_per_count(parameters, TABLE_1[tension].S)
    default = bench.play(default_plan(tension))
    shifted = (tension + count * position / POSITIONS for position in range(POSITIONS))
    return Runs(default, tuple(bench.play(paper_plan(held)) for held in shifted))


def motor_rows(parameters: PlantParameters) -> Iterator[list[str]]:
    yield ["paper, equation 17", "2.86", "0.22"]
    runs = unloaded_steps(parameters)
    for name, chosen in (("A", runs["A"]), ("B", runs["B"]), ("A and B", runs["A"] + runs["B"])):
        found = identify_motor(chosen)
        (K_m, T_m), (K_spread, T_spread) = found.rule_mean, found.rule_spread
        yield [f"{name}, 63.21 % rule", f"{K_m:.3f} ± {K_spread:.3f}", f"{T_m:.3f} ± {T_spread:.3f}"]
        yield [f"{name}, least squares", f"{found.K_m:.3f}", f"{found.T_m:.3f}"]
    yield ["true constants in `lab.toml`", f"{parameters.motor.K_m:g}", f"{parameters.motor.T_m:g}"]


def gain_row(parameters: PlantParameters, tension: float, record: Columns) -> list[str]:
    g, row = parameters.geometry, TABLE_1[tension]
    G_q = estimate_model(Record(T_s, record["theta_A_ref"], record["q"]), "lags4")
    G_S = estimate_model(Record(T_s, record["theta_A_ref"], record["S"]), "order:4")
    gain_q, gain_S = g.r_m / (2.0 * g.r_j), stiffness_slope(build_decoupler(parameters), row.S)
    return [
        f"{tension:g} N", f"{row.K_q:.4f}", *_gain(G_q.first_order.K, gain_q), f"{G_q.first_order.T:.3f}",
        f"{row.K_S:.3f}", *_gain(G_S.first_order.K, gain_S), f"{G_S.first_order.T:.3f}",
    ]  # fmt: skip


def first_order_row(tension: float, runs: Runs, signal: str) -> list[str]:
    row = TABLE_1[tension]
    found = np.array([first_order_output_error(run["theta_A_ref"], run[signal]) for run in runs.paper])
    K, T, fit = found.mean(axis=0)
    scatter = np.ptp(found, axis=0)[:2] / 2.0
    by_arx = _arx(runs.paper[0], signal)
    published = (row.K_q, row.T_q) if signal == "q" else (row.K_S, row.T_S)
    return [
        f"{tension:g} N", f"{published[0]:g}", f"{published[1]:g}", f"{K:.3f} ± {scatter[0]:.3f}",
        f"{T:.2f} ± {scatter[1]:.2f}", f"{fit:.0f} %", *by_arx,
    ]  # fmt: skip


def third_order_row(parameters: PlantParameters, tension: float, runs: Runs, signal: str) -> list[str]:
    g, row = parameters.geometry, TABLE_1[tension]
    K, T, a2, a1 = (row.K_q, row.T_q, row.a2_q, row.a1_q) if signal == "q" else (row.K_S, row.T_S, row.a2_S, row.a1_S)
    return [
        f"{tension:g} N", _third(K, T, a2, a1), _fitted_third(runs.paper[0], signal),
        _fitted_third(runs.default, signal), f"{g.J_j / row.S:.2e}; {g.B_j / row.S:.2e}",
    ]  # fmt: skip


def _gain(found: float, geometry: float) -> tuple[str, str]:
    return f"{found:.4f}", f"{100.0 * (found / geometry - 1.0):+.1f} %"


def _arx(run: Columns, signal: str) -> tuple[str, str]:
    try:
        found = estimate_model(Record(T_s, run["theta_A_ref"], run[signal]), "first", Method.ARX)
    except IdentificationError:
        return "none", "none"
    return f"{found.first_order.K:.3f}", f"{found.first_order.T:.2f}"


def _fitted_third(run: Columns, signal: str) -> str:
    try:
        found = estimate_model(Record(T_s, run["theta_A_ref"], run[signal]), "third", Method.OUTPUT_ERROR)
    except IdentificationError:
        return "none"
    return _third(*(found.model.parameters[name] for name in ("K", "T", "a2", "a1")))


def _third(K: float, T: float, a2: float, a1: float) -> str:
    return f"{K:.3g}; {T:.3g}; {a2:.2e}; {a1:.2e}"


def motors() -> Found:
    """Return the table of motor constants."""
    return {MOTOR: list(motor_rows(load_parameters("lab")))}


def actuator_at(tension: float) -> Found:
    """Return the rows of one tension for all tables of models."""
    parameters = load_parameters("lab")
    runs = played_at(parameters, tension)
    found: dict[Place, Rows | Values] = {GAINS: [gain_row(parameters, tension, runs.default)]}
    for signal in ("q", "S"):
        found[FIRST_ORDER[signal]] = [first_order_row(tension, runs, signal)]
        found[THIRD_ORDER[signal]] = [third_order_row(parameters, tension, runs, signal)]
    return found


def computations() -> Iterator[Computation]:
    """Return the identifications of the page."""
    yield Computation("identified motor", (MOTOR,), motors)
    for tension in TABLE_1:
        places = (GAINS, *FIRST_ORDER.values(), *THIRD_ORDER.values())
        yield Computation(f"identified actuator, {tension:g} N", places, partial(actuator_at, tension))
