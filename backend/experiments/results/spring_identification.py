"""From a load sweep, or a table measured elsewhere, to the springs' characteristics with their lineage."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from backend.experiments.plans.identification_plans import SpringIdentificationPlan
from backend.experiments.results.metrics import NoSamplesError, figure
from backend.identification.records import DataFileError, FileFault, IdentificationError
from backend.identification.spring import SpringIdentification, identify_spring, read_load_sweep
from backend.identification.tables import DecimalMark
from backend.models.document import Document
from backend.models.identification import (
    SPRING_MODELS,
    SPRING_QUALITIES,
    SpringFit,
    SpringModel,
    SpringModels,
    SpringQualities,
    SpringQuality,
    TableReading,
)
from backend.plain_text import PlainTextError, require_line, require_plain
from backend.storage.identifications import NewIdentification
from backend.storage.runs import Run
from plant.interface import T_s
from plant.parameters import SIDES, PlantParameters, Side

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

PAIR_S = 0.1
"""Time over which elongation and force are averaged to one pair [s]: less noise, and pairs that know no neighbour."""

MAX_ERROR_N = 2.5
"""A characteristic further from a measured pair than this, 5 % of the 50 N range, is not usable."""

_CURVE_POINTS = 60


@dataclass(frozen=True)
class LoadSweep:
    """Pairs of one spring: elongation ``x`` [m], force ``F`` [N], and whether tension was ``rising``; shape (n,)."""

    x: Array
    F: Array
    rising: NDArray[np.bool_]

    def hysteresis(self) -> Array:
        """Force on the way up minus force on the way down [N], at elongations that both ways passed."""
        if self.rising.all() or not self.rising.any():
            return np.empty(0)
        up, down = (np.argsort(self.x[way]) for way in (self.rising, ~self.rising))
        x_up, F_up = self.x[self.rising][up], self.F[self.rising][up]
        x_down, F_down = self.x[~self.rising][down], self.F[~self.rising][down]
        x = np.linspace(max(x_up[0], x_down[0]), min(x_up[-1], x_down[-1]), _CURVE_POINTS)
        return np.asarray(_smooth(x, x_up, F_up) - _smooth(x, x_down, F_down))


@dataclass(frozen=True)
class SpringFigures:
    """What came out for both springs, and what they went through."""

    rms_A_N: float = figure("N", "Error of spring A", "RMS of measured minus fitted force, recommended order")
    rms_B_N: float = figure("N", "Error of spring B", "RMS of measured minus fitted force, recommended order")
    max_error_N: float = figure("N", "Largest error", "of both springs, recommended order")
    hysteresis_N: float = figure("N", "Hysteresis", "largest mean force difference between the ways up and down")
    min_tension_N: float = figure("N", "Smallest tension", "of both load cells during the sweep")
    max_tension_N: float = figure("N", "Largest tension", "of both load cells during the sweep")
    q_deviation: float = figure("rad", "Joint deviation", "largest |q| during the sweep; 0 would be perfect antagonism")


def load_sweep(columns: Columns, plan: SpringIdentificationPlan, side: Side, parameters: PlantParameters) -> LoadSweep:
    """Return the pairs of one spring (equations 1 and 2). Raises NoSamplesError.

    Elongations count from the zero that pretension gave the encoders.
    """
    swept = _swept(columns, plan)
    g = parameters.geometry
    sign = -1.0 if side == "A" else 1.0
    x = g.r_m * columns[f"theta_{side}"][swept] + sign * g.r_j * columns["q"][swept]
    F = columns[f"F_{side}"][swept]
    width, leg = round(PAIR_S / T_s), round(plan.sweep_s / T_s)
    count = x.size // width
    middle = (np.arange(count) + 0.5) * width
    x, F = (values[: count * width].reshape(count, width).mean(axis=1) for values in (x, F))
    return LoadSweep(x, F, (middle // leg) % 2 == 0)


def identify(
    columns: Columns, plan: SpringIdentificationPlan, parameters: PlantParameters
) -> dict[Side, tuple[LoadSweep, SpringIdentification]]:
    """Fit both springs. Raises NoSamplesError, IdentificationError."""
    sweeps = {side: load_sweep(columns, plan, side, parameters) for side in SIDES}
    return {side: (sweep, identify_spring(sweep.x, sweep.F)) for side, sweep in sweeps.items()}


def figures_of(
    columns: Columns,
    plan: SpringIdentificationPlan,
    found: Mapping[Side, tuple[LoadSweep, SpringIdentification]],
) -> SpringFigures:
    """Return what came out and what the springs went through."""
    swept = _swept(columns, plan)
    tensions = np.concatenate([columns[f"F_{side}"][swept] for side in SIDES])
    (sweep_A, A), (sweep_B, B) = (found[side] for side in SIDES)
    return SpringFigures(
        rms_A_N=A.best.rms_N,
        rms_B_N=B.best.rms_N,
        max_error_N=max(A.best.max_N, B.best.max_N),
        hysteresis_N=max(_largest(sweep_A.hysteresis()), _largest(sweep_B.hysteresis())),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        q_deviation=float(np.abs(columns["q"][swept]).max()),
    )


def to_store(
    run: Run,
    plan: SpringIdentificationPlan,
    found: Mapping[Side, tuple[LoadSweep, SpringIdentification]],
    parameters: PlantParameters,
    software: str,
) -> NewIdentification:
    """Return both springs as they are stored: polynomials, quality, and which samples they came from."""
    before = {str(side): tuple(parameters.identified_of(side).k) for side in SIDES}
    return _record(
        {f"Spring {side}": pair for side, pair in found.items()},
        {str(side): pair for side, pair in found.items()},
        before,
        run_id=run.id,
        data={"inputs": ["theta_A", "theta_B", "q"], "outputs": ["F_A", "F_B"], "pair_s": PAIR_S, "period_s": T_s},
        options=asdict(plan),
        who=run.who,
        software=software,
    )


def from_table(
    name: str,
    text: str,
    who: str,
    software: str,
    header: int | None = None,
    decimal: str | None = None,
) -> NewIdentification:
    """Fit a table measured elsewhere, columns ``x [m]`` or ``x [mm]`` and ``F [N]``.

    ``header`` is the line that names the columns, ``decimal`` "point" or "comma"; both are found where they are not
    given. Raises IdentificationError.
    """
    for what, words, require in (("name of the table", name, require_line), ("the table", text, require_plain)):
        try:
            require(words.removeprefix("\ufeff"))
        except PlainTextError as error:
            raise IdentificationError(f"{what}: {error}") from None
    if "\ufffd" in text:
        raise DataFileError(f"{name} is not text in UTF-8: save it as CSV in UTF-8", FileFault.ENCODING)
    mark = None if decimal is None else DecimalMark(decimal)
    x, F, columns = read_load_sweep(text, header=header, decimal=mark)
    reading = TableReading(
        columns.units["x"],
        columns.units["F"],
        columns.layout,
        {name: reason for name, reason in columns.not_read().items() if name not in ("x", "F")},
        tuple(columns.notes),
    )
    rising = np.ones(x.size, dtype=bool)
    pair = LoadSweep(x, F, rising), identify_spring(x, F)
    digest = hashlib.sha256(text.encode()).hexdigest()
    return _record(
        {"The table": pair},
        {"table": pair},
        {},
        run_id=None,
        data={"file": name, "sha256": digest, "points": int(x.size), "read": asdict(reading)},
        options={},
        who=who,
        software=software,
    )


def _record(
    named: Mapping[str, tuple[LoadSweep, SpringIdentification]],
    found: Mapping[str, tuple[LoadSweep, SpringIdentification]],
    before: Mapping[str, tuple[float, ...]],
    *,
    run_id: int | None,
    data: Document,
    options: Document,
    who: str,
    software: str,
) -> NewIdentification:
    models = {key: _model(result, before.get(key)) for key, (_, result) in found.items()}
    qualities = {key: _quality(sweep, result) for key, (sweep, result) in found.items()}
    return NewIdentification(
        kind="spring",
        run_id=run_id,
        data=data,
        method="least-squares polynomials",
        options=options,
        model=SPRING_MODELS.write(SpringModels(models.get("A"), models.get("B"), models.get("table"))),
        quality=SPRING_QUALITIES.write(SpringQualities(qualities.get("A"), qualities.get("B"), qualities.get("table"))),
        usable=all(_is_usable(result) for _, result in found.values()),
        verdict=" ".join(f"{name}: {_verdict(*pair)}" for name, pair in named.items()),
        who=who,
        software=software,
    )


def _model(result: SpringIdentification, before: tuple[float, ...] | None) -> SpringModel:
    fits = tuple(
        SpringFit(
            order=fit.order,
            k=tuple(fit.k),
            std_errors=tuple(fit.std_errors),
            rms_N=fit.rms_N,
            max_N=fit.max_N,
            cross_validation_N=fit.cross_validation_N,
            rising=fit.rising,
        )
        for fit in result.fits
    )
    return SpringModel(result.recommended, result.reason, fits, before)


def _quality(sweep: LoadSweep, result: SpringIdentification) -> SpringQuality:
    order = np.argsort(sweep.x)
    shown = order[np.unique(np.linspace(0, order.size - 1, 4 * _CURVE_POINTS).astype(int))]
    x = np.linspace(sweep.x.min(), sweep.x.max(), _CURVE_POINTS)
    hysteresis = sweep.hysteresis()
    return SpringQuality(
        pairs=int(sweep.x.size),
        hysteresis_N=_largest(hysteresis) if hysteresis.size else None,
        x=_listed(sweep.x[shown]),
        F=_listed(sweep.F[shown]),
        rising=tuple(bool(value) for value in sweep.rising[shown]),
        errors={str(fit.order): _listed(fit.errors[shown]) for fit in result.fits},
        curve={"x": _listed(x), **{str(fit.order): _listed(fit.force(x)) for fit in result.fits}},
    )


def _is_usable(result: SpringIdentification) -> bool:
    return result.best.rising and result.best.max_N <= MAX_ERROR_N


def _verdict(sweep: LoadSweep, result: SpringIdentification) -> str:
    best = result.best
    if not best.rising:
        return f"not usable, the polynomial of order {best.order} falls somewhere between the measured elongations."
    if best.max_N > MAX_ERROR_N:
        return f"not usable, order {best.order} misses a pair by {best.max_N:.2f} N, more than {MAX_ERROR_N:g} N."
    hysteresis = sweep.hysteresis()
    ways = f", the ways up and down differ by {_largest(hysteresis):.2f} N" if hysteresis.size else ""
    return f"usable with order {best.order}, largest error {best.max_N:.2f} N{ways}."


def _swept(columns: Columns, plan: SpringIdentificationPlan) -> slice:
    """Find the sweep from its end: the way to the lowest tension takes as long as it takes."""
    ticks = 2 * plan.cycles * round(plan.sweep_s / T_s)
    start = columns["t"].size - ticks
    if start < 0:
        raise NoSamplesError(f"the run holds {columns['t'].size} samples, fewer than the {ticks} of its sweep")
    return slice(start, None)


def _smooth(x: Array, x_measured: Array, F_measured: Array) -> Array:
    """Force at ``x`` from scattered pairs of one way: a local line through the pairs of a tenth of the range."""
    half = 0.05 * (x_measured[-1] - x_measured[0])
    values = []
    for centre in x:
        near = np.abs(x_measured - centre) <= half
        line = np.polyfit(x_measured[near] - centre, F_measured[near], 1) if near.sum() > 2 else (0.0, np.nan)
        values.append(line[1])
    return np.array(values)


def _largest(values: Array) -> float:
    return float(np.nanmax(np.abs(values)))


def _listed(values: Array) -> tuple[float, ...]:
    return tuple(round(float(value), 7) for value in values)
