"""Monte Carlo of the estimators on records whose truth is known: bias, spread against the Cramér-Rao bound, coverage.

``python -m tests.bench.identification_bench [--seeds N] [--only WORDS]`` chooses what runs: the default estimator, ARX
with the low-pass and plain ARX on the same records. A standard deviation from 50 seeds scatters by 10 %.
"""

import argparse
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from backend.identification.estimation import estimate_model
from backend.identification.fitting import fit_arx
from backend.identification.initialization import WHITE, FitProblem
from backend.identification.models import find_structure
from backend.identification.records import Controller, IdentificationError, Record
from tests.bench.table import Ratio, print_ratios
from tests.identification.closed_loop_records import (
    FIRST,
    K_I,
    K_P,
    ONE_HERTZ,
    PERIOD_S,
    THIRD,
    Array,
    Disturbed,
    closed_loop_record,
    held_response,
)

SEEDS = 200
TRUTHS = {"first": FIRST, "third": THIRD}
NORMAL_95 = 1.959964
MAX_BIAS, MAX_SPREAD, MIN_COVERAGE = 1.0 / 3.0, 1.25, 0.88
MAX_SECONDS = {20_000: 0.2, 100_000: 1.0}
REPETITIONS = 10


@dataclass(frozen=True)
class Case:
    """One row of the study: structure, noise in dB below the output, and other faults of the record."""

    name: str
    snr_dB: float
    kind: str = "white"

    @property
    def truth(self) -> dict[str, float]:
        return TRUTHS[self.name]

    @property
    def label(self) -> str:
        return f"{self.name} {self.snr_dB:.0f} dB {self.kind}"

    def signals(self, seed: int, samples: int = 20_000) -> tuple[Array, Array, Array]:
        options: dict[str, Disturbed] = {
            "white": {},
            "coloured": {"pole": ONE_HERTZ},
            "cut, offset, drift": {"offset": 2.0, "drift": 3.0, "cut": 777},
        }
        return closed_loop_record(self.truth, self.snr_dB, seed, samples=samples, **options[self.kind])


CASES = [Case(name, snr) for name in TRUTHS for snr in (40.0, 30.0, 20.0, 10.0)]
CASES += [Case(name, 20.0, kind) for name in TRUTHS for kind in ("coloured", "cut, offset, drift")]


@dataclass(frozen=True)
class Outcome:
    """All seeds of a case and an estimator: relative ``errors``, shape (runs, p); share ``covered`` by intervals."""

    errors: Array
    covered: Array | None
    failed: int

    @property
    def bias(self) -> Array:
        return np.asarray(np.mean(self.errors, axis=0))

    @property
    def spread(self) -> Array:
        return np.asarray(np.std(self.errors, axis=0, ddof=1))


def cramer_rao(case: Case) -> Array:
    """Smallest relative standard deviations that an unbiased estimator can have, shape (p,).

    Inverse of the information in the record, (dG/dp u)' (dG/dp u) / variance, from the input as it was (white noise
    enters the input with one sample's delay, so the input carries no other information).
    """
    u = case.signals(seed=0)[0]
    clean = closed_loop_record(case.truth, 300.0, 0)[1]
    noise = np.std(clean) * 10.0 ** (-case.snr_dB / 20.0)
    step = 1e-5
    columns = []
    for name in case.truth:
        up, down = dict(case.truth), dict(case.truth)
        up[name] *= 1.0 + step
        down[name] *= 1.0 - step
        columns.append((held_response(up, u) - held_response(down, u)) / (2.0 * step))
    information = np.column_stack(columns).T @ np.column_stack(columns) / noise**2
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))


def default_estimate(case: Case, seed: int) -> tuple[Array, Array | None] | None:
    u, y, _ = case.signals(seed)
    try:
        found = estimate_model(Record(PERIOD_S, u, y, controller=Controller(K_P, K_I)), case.name)
    except IdentificationError:
        return None
    truth = np.array(list(case.truth.values()))
    error = found.model.vector - truth
    half_width = NORMAL_95 * np.sqrt(np.diag(found.covariance))
    return error / truth, np.abs(error) <= half_width


def arx_estimate(case: Case, seed: int, low_pass: bool) -> tuple[Array, Array | None] | None:
    u, y, _ = case.signals(seed)
    try:
        parameters, _ = fit_arx(FitProblem(Record(PERIOD_S, u, y), find_structure(case.name), WHITE), low_pass)
    except IdentificationError:
        return None
    return parameters / np.array(list(case.truth.values())) - 1.0, None


ESTIMATORS: dict[str, Callable[[Case, int], tuple[Array, Array | None] | None]] = {
    "default": default_estimate,
    "ARX with low-pass": partial(arx_estimate, low_pass=True),
    "plain ARX": partial(arx_estimate, low_pass=False),
}


def study(case: Case, seeds: int, pool: ProcessPoolExecutor) -> dict[str, Outcome]:
    """Return the outcomes of all estimators on the same records."""
    outcomes = {}
    for name, estimator in ESTIMATORS.items():
        runs = [run for run in pool.map(partial(estimator, case), range(seeds), chunksize=5) if run is not None]
        errors = np.array([error for error, _ in runs]).reshape(len(runs), len(case.truth))
        inside = [covered for _, covered in runs if covered is not None]
        outcomes[name] = Outcome(errors, np.mean(inside, axis=0) if inside else None, seeds - len(runs))
    return outcomes


def seconds_per_estimate(samples: int) -> float:
    """Return the least processor time of several default estimates in one thread."""
    u, y, _ = Case("third", 20.0).signals(0, samples)
    record = Record(PERIOD_S, u, y, controller=Controller(K_P, K_I))
    durations = []
    for _ in range(REPETITIONS):
        begun = time.process_time()
        estimate_model(record, "third")
        durations.append(time.process_time() - begun)
    return min(durations)


def bench(console: Console) -> bool:
    """Run the study, print table and bounds, return whether all are met."""
    return _run(console, CASES, SEEDS)


def _run(console: Console, cases: list[Case], seeds: int) -> bool:
    table = Table(title=f"Bias ± standard deviation in per cent, {seeds} seeds", title_justify="left")
    for heading in ("case", "parameter", "Cramér-Rao bound", *ESTIMATORS):
        table.add_column(heading)
    lines = [
        Ratio.at_most(f"estimate of {samples} samples, time over bound", seconds_per_estimate(samples) / bound, 1.0)
        for samples, bound in MAX_SECONDS.items()
    ]
    with ProcessPoolExecutor() as pool:
        for case in track(cases, "Monte Carlo", console=Console(stderr=True)):
            outcomes = study(case, seeds, pool)
            bound = cramer_rao(case) if case.kind == "white" else None
            _rows(table, case, bound, outcomes)
            lines += _bounds(case, bound, outcomes["default"])
    console.print(table)
    print_ratios(console, "Default estimator", lines)
    return all(line.met is not False for line in lines)


def _bounds(case: Case, bound: Array | None, outcome: Outcome) -> list[Ratio]:
    lines = [
        Ratio.at_most(f"{case.label}: failed runs", outcome.failed, 0),
        Ratio.at_most(f"{case.label}: |bias|/sd", float(np.max(np.abs(outcome.bias) / outcome.spread)), MAX_BIAS),
    ]
    if outcome.covered is not None:
        lines.append(Ratio.at_least(f"{case.label}: coverage", float(np.min(outcome.covered)), MIN_COVERAGE))
    if bound is not None:
        lines.append(Ratio.at_most(f"{case.label}: sd/bound", float(np.max(outcome.spread / bound)), MAX_SPREAD))
    return lines


def _rows(table: Table, case: Case, bound: Array | None, outcomes: dict[str, Outcome]) -> None:
    for position, parameter in enumerate(case.truth):
        cells = [case.label, parameter, "" if bound is None else f"{100 * bound[position]:.3g}"]
        for outcome in outcomes.values():
            if len(outcome.errors) < 2:
                cells.append(f"no model ({outcome.failed} failed)")
                continue
            text = f"{100 * outcome.bias[position]:+.2g} ± {100 * outcome.spread[position]:.3g}"
            if outcome.covered is not None:
                text += f", covers {100 * outcome.covered[position]:.0f} %"
            cells.append(text + (f" ({outcome.failed} failed)" if outcome.failed else ""))
        table.add_row(*cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--only", default="", help="cases whose label contains this")
    options = parser.parse_args()
    chosen = [case for case in CASES if options.only in case.label]
    sys.exit(0 if _run(Console(width=160), chosen, options.seeds) else 1)


if __name__ == "__main__":
    main()
