"""Tare and calibration of the load cells, from the volts that the card read."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from backend.bring_up.work import SLACK, Figure, Finding, Rows, Signal, StepFailedError, Work
from backend.errors import require_within
from backend.sample import INDEX
from plant.calibration import CellCalibration, linear
from plant.terminals import SATURATED_V

MEASURED_S = 1.0
NOISE_MAX_N = 1.0
"""Standard deviation that a load cell at rest may have [N]."""

TARE_MAX_V = 2.0
"""Largest zero that a load cell may have [V]: more than that is a taut tendon, or an amplifier that is not set."""

WEIGHTS_APART_N = 5.0
"""Least difference of two weights [N]: with 0.05 N of noise the slope then is good to 0.1 %."""

OFF_LINE_N = 0.5
"""So far may a weight lie off the line through all of them [N]: ten times the noise of a single reading."""

_TAKEN_UP = (
    "Take everything off the load cells, and confirm: the loop starts anew with what was measured, the drives stay "
    "off, and the encoders lose their zero"
)


async def tare(work: Work) -> Finding:
    """Take 1 s of volts without load as the zero of both cells."""
    await work.drives_off()
    await work.ask("Slacken both tendons and take everything off the load cells, and confirm", SLACK)
    await work.let_go()
    work.phase("measuring")
    rows = await work.recorded(MEASURED_S)
    figures, calibrations = [], []
    for tendon in "AB":
        known = linear(work.wiring, tendon)
        if known is None:
            continue  # a table has its zero in itself
        volts = _volts(rows, tendon)
        zero_V, noise_N = float(volts.mean()), abs(known[0]) * float(volts.std())
        figures += [
            Figure(f"zero of load cell {tendon}", zero_V, "V"),
            Figure(f"noise of load cell {tendon}", noise_N, "N"),
        ]
        _require_still(tendon, noise_N)
        if not abs(zero_V) <= TARE_MAX_V:
            raise StepFailedError(
                f"load cell {tendon} reads {zero_V:.2f} V without load, at most {TARE_MAX_V:g} V are a zero: "
                "slacken its tendon, or set its amplifier"
            )
        calibrations.append(CellCalibration(tendon, known[0], zero_V, _source("tared")))
    if not calibrations:
        raise StepFailedError("both load cells are calibrated by tables: calibrate them instead")
    await work.ask(_TAKEN_UP)
    which = "both load cells" if len(calibrations) == 2 else f"load cell {calibrations[0].tendon}"
    return Finding(True, f"the zero of {which} is set", tuple(figures), tuple(calibrations))


def require_weights(values: dict[str, float]) -> None:
    """Raise OutOfRangeError for two weights that are too near to each other, or in the wrong order."""
    lighter = values["weight_1_N"]
    heavier = values["weight_2_N"]
    remedy = f"take weights at least {WEIGHTS_APART_N:g} N apart, the lighter one first"
    require_within("weight_2_N", heavier, lighter + WEIGHTS_APART_N, None, "N", remedy, words="heavier weight")


async def calibrate(work: Work) -> Finding:
    """Hang the weights on each cell, the lightest first, and draw the best line through them."""
    require_weights(work.values)
    await work.drives_off()
    weights = sorted(work.values.values())
    figures, calibrations = [], []
    for tendon in work.cells:
        volts = []
        for weight in weights:
            hand = replace(SLACK, pull_A=weight) if tendon == "A" else replace(SLACK, pull_B=weight)
            await work.ask(f"Hang {weight:g} N on load cell {tendon}, let it come to rest, and confirm", hand)
            work.phase(f"load cell {tendon}, {weight:g} N")
            volts.append(_volts(await work.recorded(MEASURED_S), tendon))
        await work.let_go()
        means = np.array([column.mean() for column in volts])
        known = linear(work.wiring, tendon)
        if not np.ptp(means) >= 1e-3:
            raise StepFailedError(
                f"load cell {tendon} reads {1e3 * np.ptp(means):.2f} mV more under {weights[-1]:g} N than under "
                f"{weights[0]:g} N, 1 mV at least tells weights apart: look at its cable, amplifier and channel"
            )
        slope, at_0_V = (float(part) for part in np.polyfit(means, weights, 1))
        offset = -at_0_V / slope
        off_line_N = float(np.abs(slope * means + at_0_V - weights).max())
        figures += [
            Figure(f"slope of load cell {tendon}", slope, "N/V"),
            Figure(f"offset of load cell {tendon}", offset, "V"),
        ]
        if known is not None and slope * known[0] < 0.0:
            raise StepFailedError(
                f"load cell {tendon} has {slope:.4g} N/V, and the wiring says {known[0]:.4g} N/V, the other way: turn "
                f"the sign of load_cell_{tendon}.slope, or exchange its two leads"
            )
        if len(weights) > 2:
            figures.append(Figure(f"load cell {tendon} off its line by at most", off_line_N, "N"))
        if not off_line_N <= OFF_LINE_N:
            raise StepFailedError(
                f"load cell {tendon} is off its line by {off_line_N:.2f} N, at most {OFF_LINE_N:g} N are a line: look "
                "at the weights, or calibrate it by a table in the wiring file"
            )
        _require_still(tendon, abs(slope) * max(float(column.std()) for column in volts))
        calibrations.append(CellCalibration(tendon, slope, offset, _source(f"calibrated with {len(weights)} weights")))
    await work.ask(_TAKEN_UP)
    which = "both load cells" if len(calibrations) == 2 else f"load cell {work.cells}"
    return Finding(True, f"slope and offset of {which} are measured", tuple(figures), tuple(calibrations))


def _volts(rows: Rows, tendon: str) -> Signal:
    volts: Signal = rows[:, INDEX[f"V_{tendon}"]]
    if not np.isfinite(volts).all():
        raise StepFailedError(f"load cell {tendon} gave no number of volts: look at its cable, amplifier and channel")
    if not (np.abs(volts) < SATURATED_V).all():
        raise StepFailedError(
            f"load cell {tendon} reads up to {np.abs(volts).max():.2f} V, {SATURATED_V:.2f} V are the end of its "
            "input: less load, or less gain of its amplifier"
        )
    return volts


def _require_still(tendon: str, noise_N: float) -> None:
    if not noise_N <= NOISE_MAX_N:
        raise StepFailedError(
            f"load cell {tendon} is unsteady by {noise_N:.2f} N, at most {NOISE_MAX_N:g} N are rest: let it come to "
            "rest, look at shield and ground"
        )


def _source(how: str) -> str:
    return f"{how} on {datetime.now(UTC):%Y-%m-%d}"
