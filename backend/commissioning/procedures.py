"""Procedures of the commissioning: wiring, load cells, directions, zero, homing, tension, safety module."""

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from backend.commissioning.procedure import (
    SLACK,
    DirectionsDisprovedError,
    MeasuredNumber,
    ProcedureContext,
    Rows,
    Signal,
    StepFailedError,
    StepFinding,
    blocks,
    known,
)
from backend.control import PRETENSION_N
from backend.errors import check_range
from backend.faults import FAULT_CODE, Fault
from backend.realtime import (
    COAST_S,
    DRIVE_TIME_S,
    HOMING_MAX_V,
    MODE_CODE,
    TIME_MAX_S,
    TRIAL_MAX_V,
    Event,
    Home,
    HomingEnd,
    LoopExited,
    Mode,
    ModeChanged,
    Reset,
    SetMode,
    Stop,
    TryModule,
    TryMotor,
    Why,
    Zero,
    compute_switch_travel,
)
from backend.realtime import TENSION_MAX_N as HOMING_TENSION_MAX_N
from backend.sample import INDEX
from plant import SATURATED_V, SIDES, CellCalibration, ManualInput, Side, T_s, load_cell_line, spring_elongation

# Directions ----------------------------------------------------------------------------------------
#
# Which way each motor turns, found with a little voltage before any loop is closed on it.
#
# With the joint free, a motor that winds its tendon makes both tensions rise and takes the joint to
# its own side (A to +q); one that unwinds does the opposite. So tensions and joint tell what really
# moved, whatever the wiring says.


START_N = 2.0
START_RANGE_N = (0.8, 5.0)
"""Tensions from which both ways can be told [N]: neither slack nor far from it."""

TURNED_RAD, JOINT_RAD, TENSION_N = 0.05, 0.003, 0.15
"""So much of a change counts: 64 counts of a motor's encoder, 2 of the joint's, 3 standard deviations of a load cell
that has not even been averaged."""

_TRIAL_S = 4.0


@dataclass(frozen=True)
class Seen:
    """Changes while one motor got a positive voltage: of its own encoder and the other's [rad], joint, mean tension."""

    motor: str
    own: float
    other: float
    q: float
    F: float


async def direction(work: ProcedureContext) -> StepFinding:
    """Try both motors in turn and say what is wrong with the wiring, if anything."""
    r_m = work.parameters.geometry.r_m
    theta_A, theta_B = (
        spring_elongation(work.parameters.make_identified_spring(side), START_N) / r_m for side in SIDES
    )
    low, high = START_RANGE_N
    await work.drives_off()
    await work.ask(
        f"Turn both motors by hand until both load cells read some {START_N:g} N, take your hands off, and confirm: "
        "the drives come on",
        ManualInput(theta_A=theta_A, theta_B=theta_B),
    )
    await work.let_go()
    F_A, F_B = await work.mean("F_A", "F_B")
    if not (low <= F_A <= high and low <= F_B <= high):
        raise StepFailedError(
            f"the tendons hold {F_A:.1f} N and {F_B:.1f} N, {low:g} to {high:g} N are asked for: wind them by hand"
        )
    await work.drives_on()
    seen = [await _tried(work, "A"), await _tried(work, "B")]
    figures = [
        figure
        for tried in seen
        for figure in (
            MeasuredNumber(f"motor {tried.motor} turned by", known(tried.own), "rad"),
            MeasuredNumber(f"joint moved by, with motor {tried.motor}", known(tried.q), "rad"),
            MeasuredNumber(f"tensions rose by, with motor {tried.motor}", known(tried.F), "N"),
        )
    ]
    problems = [problem for tried in seen for problem in judged(tried)]
    text = "; ".join(dict.fromkeys(problems)) or "both motors turn as the wiring says"
    return StepFinding(not problems, text, tuple(figures))


async def _tried(work: ProcedureContext, motor: Side) -> Seen:
    work.phase(f"motor {motor}")
    first = work.loop.ring.count
    await work.recorded(0.2)
    began = work.loop.ring.count
    work.tried_motors = True
    await work.send(TryMotor(motor))
    # Both ends are seen in the samples: that it began, and that it is over.
    await work.loop.advance_until(lambda: work.loop.ring.count > began + round(0.1 / T_s), 1.0)
    await work.loop.advance_until(lambda: work.mode is not Mode.IDENTIFY, _TRIAL_S)
    if work.mode is not Mode.OFF:
        raise StepFailedError(f"the loop stopped while motor {motor} was tried: it tells why; reset it, and try again")
    rows = work.since(first)
    u = rows[:, INDEX[f"u_{motor}"]]
    out = int(np.argmax(u))
    if not 0.0 < u[out] <= TRIAL_MAX_V + 1e-9:
        raise StepFailedError(f"motor {motor} was not given any voltage: try again")
    top = rows[out + round(0.25 * COAST_S / T_s) : out + round(COAST_S / T_s)]
    rest = rows[: round(0.2 / T_s)]
    change = top.mean(axis=0) - rest.mean(axis=0)
    other = "B" if motor == "A" else "A"
    return Seen(
        motor,
        float(change[INDEX[f"theta_{motor}"]]),
        float(change[INDEX[f"theta_{other}"]]),
        float(change[INDEX["q"]]),
        float(change[INDEX["F_A"]] + change[INDEX["F_B"]]) / 2.0,
    )


def judged(seen: Seen) -> list[str]:
    """Return what is wrong with the wiring of one motor, each with the entry to change."""
    motor, other = seen.motor, "B" if seen.motor == "A" else "A"
    if not abs(seen.F) >= TENSION_N and not abs(seen.q) >= JOINT_RAD:
        if max(abs(seen.own), abs(seen.other)) >= TURNED_RAD:
            return [f"motor {motor} turned and neither joint nor tension followed: look at its tendon"]
        return [f"motor {motor} did not turn: look at motor_{motor}.channel, its amplifier and the drive-enable line"]
    if not (abs(seen.F) >= TENSION_N and abs(seen.q) >= JOINT_RAD):
        return [
            f"motor {motor}: joint ({seen.q:.4f} rad) and tensions ({seen.F:.2f} N) do not go together: look at "
            "encoder_q and the load cells with the wiring test"
        ]
    wound = seen.F > 0.0
    moved = "A" if (seen.q > 0.0) is wound else "B"
    problems = []
    if moved != motor:
        problems.append(
            f"the voltage for motor {motor} turned motor {other}: exchange motor_A.channel and motor_B.channel"
        )
    if not wound:
        problems.append(f"motor {moved} lets out its tendon at a positive voltage: turn the sign of motor_{moved}.gain")
    turned, still = (seen.own, seen.other) if moved == motor else (seen.other, seen.own)
    if not math.isfinite(turned):
        problems.append(f"the encoder of motor {moved} gives no number: look at encoder_{moved}.counter and its cable")
    elif abs(turned) < TURNED_RAD and abs(still) >= TURNED_RAD:
        problems.append("the encoders of the motors are exchanged: exchange encoder_A.counter and encoder_B.counter")
    elif abs(turned) < TURNED_RAD:
        problems.append(f"the encoder of motor {moved} stands still: look at encoder_{moved}.counter and its cable")
    elif (turned > 0.0) is not wound:
        problems.append(f"the encoder of motor {moved} goes backwards: turn the sign of encoder_{moved}.direction")
    return problems


# Homing --------------------------------------------------------------------------------------------
#
# The zero found by motion: the motors drive the joint to its end switch, once their directions are
# proven.


_REMEDIES = {
    HomingEnd.NOT_REACHED: "turn the joint to its middle, look at end_switch.line, its cable and end_switch.position",
    HomingEnd.STUCK_CLOSED: "look at the switch, at end_switch.line and end_switch.active",
    HomingEnd.WRONG_WAY: "do the wiring test and the direction step again",
    HomingEnd.JOINT_HELD: "look what holds the joint, and at encoder_q",
    HomingEnd.MOTOR_OFF: "do the direction step again",
    HomingEnd.TENSION: "look what holds the joint, and calibrate the load cells",
    HomingEnd.SLACK: "look at the tendons on their reels, and at the load cells",
    HomingEnd.TOO_LONG: "turn the joint to its middle and try again",
}


async def home(work: ProcedureContext) -> StepFinding:
    """Have the loop drive the joint to its end switch, and take the zero that it found there."""
    position = work.wiring.end_switch.position
    await work.drives_off()
    await work.ask(
        "Turn the joint by hand near to its middle, slacken the tendons, take your hands off, and confirm: the drives "
        f"come on, and with {HOMING_MAX_V:g} V at most the motors drive the joint to its end switch at "
        f"{position:.4g} rad, by {compute_switch_travel(position):.4g} rad at most"
    )
    await work.let_go()
    await work.drives_on()
    ends: list[Why] = []

    def hear(event: Event | LoopExited) -> None:
        if isinstance(event, ModeChanged) and event.before is Mode.IDENTIFY:
            ends.append(event.cause)

    work.phase("homing")
    forget = work.loop.listen(hear)
    first = work.loop.ring.count
    try:
        await work.send(Home(position))
        await work.loop.advance_until(lambda: bool(ends), TIME_MAX_S + 1.0)
    finally:
        forget()
    await work.loop.advance(0.2)
    if ends[0] in (HomingEnd.WRONG_WAY, HomingEnd.MOTOR_OFF):
        raise DirectionsDisprovedError(_told(ends[0]))
    if ends[0] is not HomingEnd.HOMED:
        raise StepFailedError(_told(ends[0]))
    rows = work.since(first)
    way = rows[rows[:, INDEX["mode"]] == MODE_CODE[Mode.IDENTIFY]]
    figures = (
        MeasuredNumber("joint was driven over", known(float(np.ptp(way[:, INDEX["q"]]))), "rad"),
        MeasuredNumber("highest tension", known(float(way[:, [INDEX["F_A"], INDEX["F_B"]]].max())), "N"),
        MeasuredNumber("largest voltage", known(float(np.abs(way[:, [INDEX["u_A"], INDEX["u_B"]]]).max())), "V"),
        MeasuredNumber("joint position now", known(float(rows[-1, INDEX["q"]])), "rad"),
    )
    return StepFinding(True, f"the joint's encoder counts from the end switch at {position:.4g} rad", figures)


def _told(cause: Why) -> str:
    if not isinstance(cause, HomingEnd) or cause not in _REMEDIES:
        return f"the loop stopped on the way ({cause}): the status line says why; reset it, and try again"
    limit = f", {HOMING_TENSION_MAX_N:g} N at most" if cause is HomingEnd.TENSION else ""
    return f"{cause}{limit}: {_REMEDIES[cause]}"


# Load cells ----------------------------------------------------------------------------------------
#
# Tare and calibration of the load cells, from the volts that the card read.


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


async def tare(work: ProcedureContext) -> StepFinding:
    """Take 1 s of volts without load as the zero of both cells."""
    await work.drives_off()
    await work.ask("Slacken both tendons and take everything off the load cells, and confirm", SLACK)
    await work.let_go()
    work.phase("measuring")
    rows = await work.recorded(MEASURED_S)
    figures, calibrations = [], []
    for tendon in "AB":
        known = load_cell_line(work.wiring, tendon)
        if known is None:
            continue  # a table has its zero in itself
        volts = _volts(rows, tendon)
        zero_V, noise_N = float(volts.mean()), abs(known[0]) * float(volts.std())
        figures += [
            MeasuredNumber(f"zero of load cell {tendon}", zero_V, "V"),
            MeasuredNumber(f"noise of load cell {tendon}", noise_N, "N"),
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
    return StepFinding(True, f"the zero of {which} is set", tuple(figures), tuple(calibrations))


def require_weights(values: dict[str, float]) -> None:
    """Raise OutOfRangeError for two weights that are too near to each other, or in the wrong order."""
    lighter = values["weight_1_N"]
    heavier = values["weight_2_N"]
    remedy = f"take weights at least {WEIGHTS_APART_N:g} N apart, the lighter one first"
    check_range(
        "weight_2_N",
        heavier,
        minimum=lighter + WEIGHTS_APART_N,
        maximum=None,
        unit="N",
        remedy=remedy,
        words="heavier weight",
    )


async def calibrate(work: ProcedureContext) -> StepFinding:
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
        known = load_cell_line(work.wiring, tendon)
        if not np.ptp(means) >= 1e-3:
            raise StepFailedError(
                f"load cell {tendon} reads {1e3 * np.ptp(means):.2f} mV more under {weights[-1]:g} N than under "
                f"{weights[0]:g} N, 1 mV at least tells weights apart: look at its cable, amplifier and channel"
            )
        slope, at_0_V = (float(part) for part in np.polyfit(means, weights, 1))
        offset = -at_0_V / slope
        off_line_N = float(np.abs(slope * means + at_0_V - weights).max())
        figures += [
            MeasuredNumber(f"slope of load cell {tendon}", slope, "N/V"),
            MeasuredNumber(f"offset of load cell {tendon}", offset, "V"),
        ]
        if known is not None and slope * known[0] < 0.0:
            raise StepFailedError(
                f"load cell {tendon} has {slope:.4g} N/V, and the wiring says {known[0]:.4g} N/V, the other way: turn "
                f"the sign of load_cell_{tendon}.slope, or exchange its two leads"
            )
        if len(weights) > 2:
            figures.append(MeasuredNumber(f"load cell {tendon} off its line by at most", off_line_N, "N"))
        if not off_line_N <= OFF_LINE_N:
            raise StepFailedError(
                f"load cell {tendon} is off its line by {off_line_N:.2f} N, at most {OFF_LINE_N:g} N are a line: look "
                "at the weights, or calibrate it by a table in the wiring file"
            )
        _require_still(tendon, abs(slope) * max(float(column.std()) for column in volts))
        calibrations.append(CellCalibration(tendon, slope, offset, _source(f"calibrated with {len(weights)} weights")))
    await work.ask(_TAKEN_UP)
    which = "both load cells" if len(calibrations) == 2 else f"load cell {work.cells}"
    return StepFinding(True, f"slope and offset of {which} are measured", tuple(figures), tuple(calibrations))


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


# Tension -------------------------------------------------------------------------------------------
#
# Pretension under watch, and the safety module's trip, provoked at that tension.


TENSION_MAX_N = 18.0
"""Beyond this [N] the pretension of 10 N has gone wrong, and is stopped hard."""

APART_N = 6.0
"""So much may one tension be ahead of the other [N] on the way up: the joint is free, so that they rise together."""

NEAR_N = 1.0
WINDING_S = 60.0
LOOK_S = 0.05
TRIP_S = 20.0
LOWERED_N = 5.0

TURNED_BACK_RAD = 0.01
"""A motor that loses its drive is turned back by its tendon, by so much at least [rad]: 13 counts of its encoder. In
the model it is 0.04 rad; one that keeps its drive winds up by as much and more."""

DRIVEN_MIN_V = 0.5
"""So much at least is on the outputs at the end [V]: more than friction holds a motor against."""

_SET_BACK = "; set the module's limit back to what it was"


async def pretension(work: ProcedureContext) -> StepFinding:
    """Wind up, both tensions watched, hold, and let go again."""
    highest, apart = await _wound(work)
    F = await work.mean("F_A", "F_B", seconds=0.5)
    F_A, F_B = (float(held) for held in F)
    await work.send(SetMode(Mode.OFF))
    await work.loop.advance(0.2)
    figures = (
        MeasuredNumber("tension of tendon A", known(F_A), "N"),
        MeasuredNumber("tension of tendon B", known(F_B), "N"),
        MeasuredNumber("highest tension on the way", highest, "N"),
        MeasuredNumber("most that one was ahead of the other", apart, "N"),
    )
    if not near_pretension(F):
        raise StepFailedError(f"the tendons hold {F_A:.1f} N and {F_B:.1f} N, not {PRETENSION_N:g} N: calibrate them")
    return StepFinding(True, f"both tendons rose together to {PRETENSION_N:g} N", figures)


async def safety_module(work: ProcedureContext) -> StepFinding:
    """At the pretension, have the module's limit lowered below it: it has to trip, and to cut motors that are driven.

    From the trip on the loop drives them for DRIVEN_S more, so that it is the module that lets go.
    """
    work.phase("winding up to the pretension")
    await _wound(work)
    before = await work.mean("F_A", "F_B")
    first = work.loop.ring.count
    await work.send(TryModule())
    await work.ask(
        f"Lower the tension limit at the safety module below {PRETENSION_N:g} N: it has to trip; then confirm",
        ManualInput(F_limit=LOWERED_N),
    )
    work.phase("waiting for the trip")
    try:
        await work.loop.advance_until(lambda: work.mode is Mode.TRIPPED, TRIP_S)
    except TimeoutError:
        raise StepFailedError(
            f"the module did not trip within {TRIP_S:g} s below the tension that the tendons held: do not go on; look "
            f"at its limit, its supply, and safety_tripped in the wiring file{_SET_BACK}"
        ) from None
    await work.loop.advance(1.0)
    rows = work.since(first)
    tripped = int(np.argmax(rows[:, INDEX["mode"]] == rows[-1, INDEX["mode"]]))
    if rows[-1, INDEX["fault"]] != FAULT_CODE[Fault.SAFETY_MODULE]:
        raise StepFailedError(
            f"the loop stopped, but not because of the safety module: the status line says why{_SET_BACK}"
        )
    driven = rows[max(tripped - round(DRIVE_TIME_S / T_s), 0) : tripped]
    volts = driven[:, [INDEX["u_A"], INDEX["u_B"]]].max(axis=0)
    turned = driven[-1, [INDEX["theta_A"], INDEX["theta_B"]]] - driven[0, [INDEX["theta_A"], INDEX["theta_B"]]]
    after = rows[-100:, [INDEX["F_A"], INDEX["F_B"]]].mean(axis=0)
    still_driven = float(np.abs(rows[tripped:, [INDEX["u_A"], INDEX["u_B"]]]).max())
    figures = (
        MeasuredNumber("tension before", known(float(before.mean())), "N"),
        MeasuredNumber("voltage that motor A was still given", known(float(volts[0])), "V"),
        MeasuredNumber("voltage that motor B was still given", known(float(volts[1])), "V"),
        MeasuredNumber("motor A turned by meanwhile", known(float(turned[0])), "rad"),
        MeasuredNumber("motor B turned by meanwhile", known(float(turned[1])), "rad"),
        MeasuredNumber("tension 1 s after", known(float(after.mean())), "N"),
    )
    problem = "" if still_driven == 0.0 else "the loop did not go to zero volts"
    problem = problem or uncut(volts, turned)
    problem = problem or ("" if let_go(before, after) else "the tension did not fall after it")
    if problem:
        return StepFinding(False, f"the module tripped, but {problem}: do not go on{_SET_BACK}", figures)
    await work.ask("Set the module's limit back to what it was, acknowledge it there, and confirm")
    await work.let_go()
    await work.send(Reset())
    return StepFinding(True, "the module tripped and cut both motors while they were still given voltage", figures)


def uncut(volts: Signal, turned: Signal) -> str:
    """Return what tells that the drives were not cut: ``turned`` [2] in rad while up to ``volts`` [2] were given."""
    for motor, u, way in zip("AB", volts, turned, strict=True):
        if not u >= DRIVEN_MIN_V:
            return f"motor {motor} was given {u:.2f} V only: whether its drive was cut cannot be told"
        if not way <= -TURNED_BACK_RAD:
            return (
                f"motor {motor} did not let go while it was given {u:.2f} V for {DRIVE_TIME_S:g} s more (it turned by "
                f"{way:.4f} rad, {-TURNED_BACK_RAD:g} rad are letting go): look at how the module cuts the drives"
            )
    return ""


def near_pretension(F: Signal) -> bool:
    """Tell whether both tensions [2] are the pretension; no number is not."""
    return bool((np.abs(F - PRETENSION_N) <= NEAR_N).all())


def let_go(before: Signal, after: Signal) -> bool:
    """Tell whether both tensions [2] have fallen by more than NEAR_N; no number has not."""
    return bool((after < before - NEAR_N).all())


def peaks(F: Rows) -> tuple[float, float]:
    """Return the highest tension of [n, 2] and the most that one was ahead of the other [N]; nan for no number."""
    return float(F.max()), float(np.abs(F[:, 0] - F[:, 1]).max())


async def _wound(work: ProcedureContext) -> tuple[float, float]:
    """Go to pretension under watch; return the highest tension and the most that one was ahead [N]."""
    work.phase("winding up")
    await work.ask("Take your hands off: the motors wind up. Confirm to begin")
    await work.let_go()
    await work.drives_on()
    first = work.loop.ring.count
    await work.send(SetMode(Mode.PRETENSION))
    waited_s, highest, apart, steady_s = 0.0, 0.0, 0.0, 0.0
    while waited_s < WINDING_S:
        await work.loop.advance(LOOK_S)
        waited_s += LOOK_S
        rows = work.since(first)
        first += len(rows)
        if not len(rows):
            continue
        F = rows[:, [INDEX["F_A"], INDEX["F_B"]]]
        # NumPy's maximum keeps a nan, Python's max may drop it.
        highest, apart = (float(most) for most in np.maximum((highest, apart), peaks(F)))
        if not (highest <= TENSION_MAX_N and apart <= APART_N):
            await work.loop.send(Stop(Fault.STOP_PRESSED, hard=True, detail="the pretension went wrong"))
            raise StepFailedError(
                f"stopped: up to {highest:.1f} N, one tendon ahead by up to {apart:.1f} N; at most {TENSION_MAX_N:g} N "
                f"and {APART_N:g} N belong to a pretension of {PRETENSION_N:g} N: do the steps before anew"
            )
        if work.mode is not Mode.PRETENSION:
            raise StepFailedError("the loop stopped on the way up: the status line says why")
        steady_s = steady_s + LOOK_S if near_pretension(F.mean(axis=0)) else 0.0
        if steady_s >= 2.0:
            return highest, apart
    raise StepFailedError(f"the pretension was not reached within {WINDING_S:g} s")


# Wiring test ---------------------------------------------------------------------------------------
#
# Drives off: what is moved by hand has to be seen by its own sensor, by enough, to the right side.


class _Sensor(NamedTuple):
    """``least``: what a hand moves at the very least; ``place`` and ``sign``: entries of the wiring."""

    signal: str
    words: str
    unit: str
    least: float
    section: str
    place: str
    sign: str


_Q = _Sensor(
    signal="q", words="joint encoder", unit="rad", least=0.08, section="encoder_q", place="counter", sign="direction"
)
_ENCODERS = (
    _Q,
    _Sensor(
        signal="theta_A",
        words="encoder of motor A",
        unit="rad",
        least=0.3,
        section="encoder_A",
        place="counter",
        sign="direction",
    ),
    _Sensor(
        signal="theta_B",
        words="encoder of motor B",
        unit="rad",
        least=0.3,
        section="encoder_B",
        place="counter",
        sign="direction",
    ),
)
_CELLS = (
    _Sensor(
        signal="F_A", words="load cell A", unit="N", least=3.0, section="load_cell_A", place="channel", sign="slope"
    ),
    _Sensor(
        signal="F_B", words="load cell B", unit="N", least=3.0, section="load_cell_B", place="channel", sign="slope"
    ),
)
_MOVED = 0.4
"""A sensor that has gone by this part of its least has moved."""

_WIND = f"Turn motor {{}} by hand by {_ENCODERS[1].least:g} rad or more so that it winds its tendon, and confirm"
_ASKS = (
    (_Q, f"Turn the joint by hand towards +q by {_Q.least:g} rad or more, and confirm", ManualInput(q=0.15)),
    (_ENCODERS[1], _WIND.format("A"), ManualInput(theta_A=0.5)),
    (_ENCODERS[2], _WIND.format("B"), ManualInput(theta_B=0.5)),
    (_CELLS[0], "Pull at load cell A with some 7 N, and confirm", ManualInput(pull_A=7.0)),
    (_CELLS[1], "Pull at load cell B with some 7 N, and confirm", ManualInput(pull_B=7.0)),
)


async def wiring_test(work: ProcedureContext) -> StepFinding:
    """Ask for each movement in turn; whatever is wrong is found at once, each with the entry to change."""
    await work.drives_off()
    problems: list[str] = []
    figures = []
    for wanted, words, hand in _ASKS:
        work.phase(wanted.words)
        group = _ENCODERS if wanted in _ENCODERS else _CELLS
        first = work.loop.ring.count
        await work.recorded(0.3)
        await work.ask(words, hand)
        await work.recorded(0.3)
        rows = work.since(first)
        seen = {sensor: _excursion(blocks(rows, sensor.signal)) for sensor in group}
        figures.append(MeasuredNumber(f"{wanted.words} moved by", known(seen[wanted]), wanted.unit))
        problems += _judged(work, wanted, seen)
        if wanted in _ENCODERS:
            await work.ask("Put it back to where it was, and confirm", SLACK)
        await work.let_go()
    text = "; ".join(dict.fromkeys(problems)) or "every sensor moves as it should"
    return StepFinding(not problems, text, tuple(figures))


def _excursion(values: Signal) -> float:
    """Return the largest way from where it began, with its sign; nan where there was no number."""
    ways = values - values[0]
    return float(ways[np.argmax(np.abs(ways))]) if np.isfinite(ways).all() else float("nan")


def _judged(work: ProcedureContext, wanted: _Sensor, seen: dict[_Sensor, float]) -> list[str]:
    way = seen[wanted]
    entry = getattr(work.wiring, wanted.section)
    at = getattr(entry, wanted.place)
    if not np.isfinite(way):
        return [f"the {wanted.words} gives no number: look at its cable and its amplifier at {at}"]
    # The joint, turned by hand, may drag a motor along by a taut tendon: for a motor and a load cell all others count.
    others = [other for other, moved in seen.items() if other is not wanted and abs(moved) > _MOVED * other.least]
    if abs(way) < _MOVED * wanted.least:
        if others:
            other = others[0]
            return [
                f"it is the {other.words} that moved, not the {wanted.words}: exchange {wanted.section}.{wanted.place} "
                f"and {other.section}.{other.place} in the wiring file"
            ]
        return [f"the {wanted.words} did not move: look at its cable and at {wanted.section}.{wanted.place} ({at})"]
    if abs(way) < wanted.least:
        return [
            f"the {wanted.words} moved by {way:.2f} {wanted.unit} only, {wanted.least:g} are asked for: move it "
            f"further, or mend {wanted.section}"
        ]
    if way < 0.0:
        return [
            f"the {wanted.words} goes backwards: turn the sign of {wanted.section}.{wanted.sign} in the wiring file"
        ]
    if others and wanted is not _Q:
        return [f"the {others[0].words} moved too: look for a cable that carries both"]
    return []


# Zeroing -------------------------------------------------------------------------------------------
#
# Where joint and motors stand: at the joint's zero mark, or at its end switch where its position is
# known.


NEAR_RAD = 0.01
"""The joint reads so near [rad] to where it was put, once that was said."""


async def zero(work: ProcedureContext) -> StepFinding:
    """Set the encoders; the motors' own zeros are found by the pretension each time."""
    await work.drives_off()
    position = work.wiring.end_switch.position
    homing = not math.isnan(position)
    if homing:
        # Slack enough for the joint to get there: what it takes up of a tendon, its motor has to let out.
        out = -abs(position) * work.parameters.geometry.r_j / work.parameters.geometry.r_m
        hand = ManualInput(q=1.02 * position, theta_A=out, theta_B=out)
        await work.ask(
            f"Slacken both tendons, turn the joint slowly by hand onto its end switch at {position:.4g} rad, hold it "
            "there, and confirm",
            hand,
        )
    else:
        position = 0.0
        await work.ask("Turn the joint by hand to its zero mark, hold it there, and confirm", SLACK)
    work.phase("setting the encoders")
    await work.send(Zero(position, 0.0, 0.0, at_switch=homing))
    await work.recorded(0.1)
    newest = work.loop.ring.newest()
    q = math.nan if newest is None else float(newest[INDEX["q"]])
    if not abs(q - position) <= NEAR_RAD:
        raise StepFailedError(
            f"the joint reads {q:.4f} rad after it was set to {position:.4f}: hold it still and try again"
        )
    if homing:
        await work.ask("Turn the joint back to its middle, and confirm", SLACK)
    await work.let_go()
    how = "the end switch" if homing else "its zero mark"
    return StepFinding(
        True,
        f"the joint's encoder counts from {how}",
        (MeasuredNumber("joint position that was set", position, "rad"),),
    )
