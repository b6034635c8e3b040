"""Procedures of the steps: wiring, load cells, directions, zero, homing, pretension, safety module."""

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from backend.commissioning import messages
from backend.commissioning.procedure import (
    SLACK,
    DirectionsDisprovedError,
    MeasuredNumber,
    ProcedureContext,
    Rows,
    Signal,
    StepFailedError,
    StepFinding,
    average_blocks,
    to_finite,
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
    ModeCause,
    ModeChanged,
    Reset,
    SetMode,
    Stop,
    TryModule,
    TryMotor,
    Zero,
    compute_switch_travel,
)
from backend.realtime import TENSION_MAX_N as HOMING_TENSION_MAX_N
from backend.sample import INDEX
from plant import (
    SATURATED_V,
    SIDES,
    CellCalibration,
    ManualInput,
    Message,
    Side,
    T_s,
    load_cell_line,
    spring_elongation,
)

# Directions ----------------------------------------------------------------------------------------
# The direction of each motor, determined with a low voltage before any loop is closed.
#
# With the joint free, a motor that winds its tendon raises both tensions and turns the joint to its
# side (A to +q); a motor that unwinds does the opposite. Tensions and joint therefore identify the
# motor and its direction independently of the wiring file.


START_N = 2.0
START_RANGE_N = (0.8, 5.0)
"""Range of the initial tensions [N], in which a rise and a fall can be detected."""

TURNED_MIN_RAD, JOINT_MIN_RAD, TENSION_MIN_N = 0.05, 0.003, 0.15
"""Least detectable changes of motor angle [rad], joint position [rad] and tension [N]: 64 counts of a motor's encoder,
2 counts of the joint's encoder, 3 standard deviations of a single reading of a load cell."""

_TRIAL_TIMEOUT_S = 4.0


@dataclass(frozen=True)
class MotorResponse:
    """Changes caused by a positive voltage on ``motor``.

    ``own`` and ``other``: angles of this and the other motor [rad]; ``q``: joint [rad]; ``F``: mean tension [N].
    """

    motor: str
    own: float
    other: float
    q: float
    F: float


async def check_directions(context: ProcedureContext) -> StepFinding:
    """Apply a voltage to each motor in turn and find errors of the wiring."""
    r_m = context.parameters.geometry.r_m
    theta_A, theta_B = (
        spring_elongation(context.parameters.make_identified_spring(side), START_N) / r_m for side in SIDES
    )
    low, high = START_RANGE_N
    await context.switch_drives_off()
    await context.request_action(
        messages.turn_motors_to_tension(F=START_N),
        ManualInput(theta_A=theta_A, theta_B=theta_B),
    )
    await context.release_rig()
    F_A, F_B = await context.measure_mean("F_A", "F_B")
    if not (low <= F_A <= high and low <= F_B <= high):
        raise StepFailedError(
            messages.wrong_initial_tensions(F_A=float(F_A), F_B=float(F_B), minimum=low, maximum=high)
        )
    await context.switch_drives_on()
    responses = [await _try_motor(context, "A"), await _try_motor(context, "B")]
    figures = [
        figure
        for response in responses
        for figure in (
            MeasuredNumber(messages.rotation_of_motor(motor=response.motor), to_finite(response.own), "rad"),
            MeasuredNumber(messages.joint_motion_by_motor(motor=response.motor), to_finite(response.q), "rad"),
            MeasuredNumber(messages.tension_increase_by_motor(motor=response.motor), to_finite(response.F), "N"),
        )
    ]
    problems = [problem for response in responses for problem in find_direction_problems(response)]
    if problems:
        return StepFinding(False, messages.several_problems(problems=tuple(dict.fromkeys(problems))), tuple(figures))
    return StepFinding(True, messages.directions_as_wired(), tuple(figures))


async def _try_motor(context: ProcedureContext, motor: Side) -> MotorResponse:
    context.report_phase(messages.testing_motor(motor=motor))
    first = context.loop.ring.count
    await context.record(0.2)
    start_tick = context.loop.ring.count
    context.has_tried_motors = True
    await context.send(TryMotor(motor))
    # Start and end of the test are both determined from samples.
    await context.loop.advance_until(lambda: context.loop.ring.count > start_tick + round(0.1 / T_s), 1.0)
    await context.loop.advance_until(lambda: context.mode is not Mode.IDENTIFY, _TRIAL_TIMEOUT_S)
    if context.mode is not Mode.OFF:
        raise StepFailedError(messages.loop_stopped_in_motor_test(motor=motor))
    rows = context.read_since(first)
    u = rows[:, INDEX[f"u_{motor}"]]
    out = int(np.argmax(u))
    if not 0.0 < u[out] <= TRIAL_MAX_V + 1e-9:
        raise StepFailedError(messages.motor_without_voltage(motor=motor))
    top = rows[out + round(0.25 * COAST_S / T_s) : out + round(COAST_S / T_s)]
    rest = rows[: round(0.2 / T_s)]
    change = top.mean(axis=0) - rest.mean(axis=0)
    other = "B" if motor == "A" else "A"
    return MotorResponse(
        motor,
        float(change[INDEX[f"theta_{motor}"]]),
        float(change[INDEX[f"theta_{other}"]]),
        float(change[INDEX["q"]]),
        float(change[INDEX["F_A"]] + change[INDEX["F_B"]]) / 2.0,
    )


def find_direction_problems(response: MotorResponse) -> list[Message]:
    """Return the errors in the wiring of one motor, each with the entry to change."""
    motor, other = response.motor, "B" if response.motor == "A" else "A"
    if not abs(response.F) >= TENSION_MIN_N and not abs(response.q) >= JOINT_MIN_RAD:
        if max(abs(response.own), abs(response.other)) >= TURNED_MIN_RAD:
            return [messages.nothing_followed_motor(motor=motor)]
        return [messages.motor_did_not_turn(motor=motor)]
    if not (abs(response.F) >= TENSION_MIN_N and abs(response.q) >= JOINT_MIN_RAD):
        return [messages.joint_contradicts_tensions(motor=motor, q=response.q, F=response.F)]
    wound = response.F > 0.0
    moved = "A" if (response.q > 0.0) is wound else "B"
    problems = []
    if moved != motor:
        problems.append(messages.motors_exchanged(driven=motor, turned=other))
    if not wound:
        problems.append(messages.wrong_sign_of_motor(motor=moved))
    turned, still = (response.own, response.other) if moved == motor else (response.other, response.own)
    if not math.isfinite(turned):
        problems.append(messages.invalid_motor_encoder(motor=moved))
    elif abs(turned) < TURNED_MIN_RAD and abs(still) >= TURNED_MIN_RAD:
        problems.append(messages.motor_encoders_exchanged())
    elif abs(turned) < TURNED_MIN_RAD:
        problems.append(messages.motor_encoder_does_not_move(motor=moved))
    elif (turned > 0.0) is not wound:
        problems.append(messages.wrong_sign_of_motor_encoder(motor=moved))
    return problems


# Homing --------------------------------------------------------------------------------------------
# After the directions are proven, the motors drive the joint to its end switch, which sets the zero.


async def home_joint(context: ProcedureContext) -> StepFinding:
    """Drive the joint to its end switch and set the zero there."""
    position = context.wiring.end_switch.position
    await context.switch_drives_off()
    await context.request_action(
        messages.turn_joint_to_middle(voltage=HOMING_MAX_V, position=position, travel=compute_switch_travel(position))
    )
    await context.release_rig()
    await context.switch_drives_on()
    ends: list[ModeCause] = []

    def on_event(event: Event | LoopExited) -> None:
        if isinstance(event, ModeChanged) and event.before is Mode.IDENTIFY:
            ends.append(event.cause)

    context.report_phase("homing")
    unsubscribe = context.loop.listen(on_event)
    first = context.loop.ring.count
    try:
        await context.send(Home(position))
        await context.loop.advance_until(lambda: bool(ends), TIME_MAX_S + 1.0)
    finally:
        unsubscribe()
    await context.loop.advance(0.2)
    if ends[0] in (HomingEnd.WRONG_WAY, HomingEnd.MOTOR_OFF):
        raise DirectionsDisprovedError(_describe_end(ends[0]))
    if ends[0] is not HomingEnd.HOMED:
        raise StepFailedError(_describe_end(ends[0]))
    rows = context.read_since(first)
    motion = rows[rows[:, INDEX["mode"]] == MODE_CODE[Mode.IDENTIFY]]
    figures = (
        MeasuredNumber(messages.motion_of_joint(), to_finite(float(np.ptp(motion[:, INDEX["q"]]))), "rad"),
        MeasuredNumber(
            messages.highest_tension(), to_finite(float(motion[:, [INDEX["F_A"], INDEX["F_B"]]].max())), "N"
        ),
        MeasuredNumber(
            messages.largest_voltage(), to_finite(float(np.abs(motion[:, [INDEX["u_A"], INDEX["u_B"]]]).max())), "V"
        ),
        MeasuredNumber(messages.current_joint_position(), to_finite(float(rows[-1, INDEX["q"]])), "rad"),
    )
    return StepFinding(True, messages.joint_homed(position=position), figures)


def _describe_end(cause: ModeCause) -> Message:
    if not isinstance(cause, HomingEnd) or cause not in messages.HOMING_REMEDIES:
        return messages.loop_stopped_in_homing(cause=cause)
    remedy = messages.HOMING_REMEDIES[cause]
    if cause is HomingEnd.TENSION:
        return messages.tension_in_homing(cause=cause, maximum_N=HOMING_TENSION_MAX_N, remedy=remedy)
    return messages.not_homed(cause=cause, remedy=remedy)


# Load cells ----------------------------------------------------------------------------------------
# Tare and calibration of the load cells, from the voltages of the card.


AVERAGING_S = 1.0
NOISE_MAX_N = 1.0
"""Largest standard deviation of a load cell at rest [N]."""

TARE_MAX_V = 2.0
"""Largest voltage of an unloaded load cell [V]; more means a taut tendon or an unadjusted amplifier."""

WEIGHTS_APART_N = 5.0
"""Least difference of two weights [N]; with noise of 0.05 N, the slope is then accurate to 0.1 %."""

LINE_DEVIATION_MAX_N = 0.5
"""Largest deviation of a weight from the fitted line [N]: ten times the noise of a single reading."""


async def tare_load_cells(context: ProcedureContext) -> StepFinding:
    """Set the mean voltage of 1 s without load as the zero of both load cells."""
    await context.switch_drives_off()
    await context.request_action(messages.unload_load_cells(), SLACK)
    await context.release_rig()
    context.report_phase("measuring")
    rows = await context.record(AVERAGING_S)
    figures, calibrations = [], []
    for tendon in "AB":
        wiring_line = load_cell_line(context.wiring, tendon)
        if wiring_line is None:
            continue  # a table contains its zero
        volts = _extract_volts(rows, tendon)
        zero_V, noise_N = float(volts.mean()), abs(wiring_line[0]) * float(volts.std())
        figures += [
            MeasuredNumber(messages.zero_of_load_cell(tendon=tendon), zero_V, "V"),
            MeasuredNumber(messages.noise_of_load_cell(tendon=tendon), noise_N, "N"),
        ]
        _require_low_noise(tendon, noise_N)
        if not abs(zero_V) <= TARE_MAX_V:
            raise StepFailedError(messages.load_cell_zero_too_large(tendon=tendon, zero_V=zero_V, maximum_V=TARE_MAX_V))
        calibrations.append(CellCalibration(tendon, wiring_line[0], zero_V, messages.tared(at=datetime.now(UTC))))
    if not calibrations:
        raise StepFailedError(messages.load_cells_have_tables())
    await context.request_action(messages.remove_load())
    found = messages.load_cells_tared(tendons="".join(tared.tendon for tared in calibrations))
    return StepFinding(True, found, tuple(figures), tuple(calibrations))


def require_weights(values: dict[str, float]) -> None:
    """Raise OutOfRangeError for two weights that differ too little or are in the wrong order."""
    lighter = values["weight_1_N"]
    heavier = values["weight_2_N"]
    check_range(
        "weight_2_N",
        heavier,
        minimum=lighter + WEIGHTS_APART_N,
        maximum=None,
        unit="N",
        remedy=messages.weights_too_close(minimum_N=WEIGHTS_APART_N),
        label=messages.heavier_weight(),
    )


async def calibrate_load_cells(context: ProcedureContext) -> StepFinding:
    """Fit a line through the voltages under known weights, for each load cell."""
    require_weights(context.values)
    await context.switch_drives_off()
    weights = sorted(context.values.values())
    figures, calibrations = [], []
    for tendon in context.cells:
        volts = []
        for weight in weights:
            manual_input = replace(SLACK, pull_A=weight) if tendon == "A" else replace(SLACK, pull_B=weight)
            await context.request_action(messages.hang_weight(weight_N=weight, tendon=tendon), manual_input)
            context.report_phase(messages.measuring_weight(tendon=tendon, weight_N=weight))
            volts.append(_extract_volts(await context.record(AVERAGING_S), tendon))
        await context.release_rig()
        means = np.array([column.mean() for column in volts])
        wiring_line = load_cell_line(context.wiring, tendon)
        if not np.ptp(means) >= 1e-3:
            raise StepFailedError(
                messages.weights_not_distinguished(
                    tendon=tendon,
                    difference_V=float(np.ptp(means)),
                    lightest_N=weights[0],
                    heaviest_N=weights[-1],
                )
            )
        slope, at_0_V = (float(part) for part in np.polyfit(means, weights, 1))
        offset = -at_0_V / slope
        deviation_N = float(np.abs(slope * means + at_0_V - weights).max())
        figures += [
            MeasuredNumber(messages.slope_of_load_cell(tendon=tendon), slope, "N/V"),
            MeasuredNumber(messages.offset_of_load_cell(tendon=tendon), offset, "V"),
        ]
        if wiring_line is not None and slope * wiring_line[0] < 0.0:
            raise StepFailedError(
                messages.wrong_sign_of_load_cell(tendon=tendon, slope=slope, wiring_slope=wiring_line[0])
            )
        if len(weights) > 2:
            figures.append(MeasuredNumber(messages.deviation_of_load_cell(tendon=tendon), deviation_N, "N"))
        if not deviation_N <= LINE_DEVIATION_MAX_N:
            raise StepFailedError(
                messages.load_cell_not_linear(tendon=tendon, deviation_N=deviation_N, maximum_N=LINE_DEVIATION_MAX_N)
            )
        _require_low_noise(tendon, abs(slope) * max(float(column.std()) for column in volts))
        source = messages.calibrated(weights=len(weights), at=datetime.now(UTC))
        calibrations.append(CellCalibration(tendon, slope, offset, source))
    await context.request_action(messages.remove_load())
    found = messages.load_cells_calibrated(tendons=context.cells)
    return StepFinding(True, found, tuple(figures), tuple(calibrations))


def _extract_volts(rows: Rows, tendon: str) -> Signal:
    volts: Signal = rows[:, INDEX[f"V_{tendon}"]]
    if not np.isfinite(volts).all():
        raise StepFailedError(messages.invalid_load_cell(tendon=tendon))
    if not (np.abs(volts) < SATURATED_V).all():
        highest_V = float(np.abs(volts).max())
        raise StepFailedError(messages.load_cell_saturated(tendon=tendon, voltage=highest_V, maximum_V=SATURATED_V))
    return volts


def _require_low_noise(tendon: str, noise_N: float) -> None:
    if not noise_N <= NOISE_MAX_N:
        raise StepFailedError(messages.load_cell_too_noisy(tendon=tendon, noise_N=noise_N, maximum_N=NOISE_MAX_N))


# Pretension and safety module ----------------------------------------------------------------------
# Pretension with monitored tensions, and a trip of the safety module provoked at that tension.


TENSION_MAX_N = 18.0
"""Tension [N] above which the pretension of 10 N has failed and is stopped hard."""

TENSION_DIFFERENCE_MAX_N = 6.0
"""Largest difference of the tensions [N] during winding; with the joint free, both rise together."""

PRETENSION_TOLERANCE_N = 1.0
WINDING_TIMEOUT_S = 60.0
POLL_S = 0.05
TRIP_TIMEOUT_S = 20.0
LOWERED_LIMIT_N = 5.0

TURNED_BACK_MIN_RAD = 0.01
"""Least angle [rad] by which the tendon turns a motor back that has lost its drive: 13 counts of its encoder. In the
model it is 0.04 rad; a motor with an active drive winds up by at least as much."""

DRIVEN_MIN_V = 0.5
"""Least voltage at the end of the test [V], enough to overcome static friction."""


async def apply_pretension(context: ProcedureContext) -> StepFinding:
    """Apply pretension with monitored tensions, hold it, and release it."""
    highest, apart = await _wind_up(context)
    F = await context.measure_mean("F_A", "F_B", seconds=0.5)
    F_A, F_B = (float(tension) for tension in F)
    await context.send(SetMode(Mode.OFF))
    await context.loop.advance(0.2)
    figures = (
        MeasuredNumber(messages.tension_of_tendon(tendon="A"), to_finite(F_A), "N"),
        MeasuredNumber(messages.tension_of_tendon(tendon="B"), to_finite(F_B), "N"),
        MeasuredNumber(messages.highest_tension_in_motion(), highest, "N"),
        MeasuredNumber(messages.largest_difference_of_tensions(), apart, "N"),
    )
    if not is_near_pretension(F):
        raise StepFailedError(messages.not_at_pretension(F_A=F_A, F_B=F_B, pretension_N=PRETENSION_N))
    return StepFinding(True, messages.pretension_reached(pretension_N=PRETENSION_N), figures)


async def check_safety_module(context: ProcedureContext) -> StepFinding:
    """Check that the safety module trips and cuts motors that are still driven.

    The person lowers the limit of the module below the pretension. After the trip, the loop drives the motors for
    another DRIVE_TIME_S, so that only the module can release them.
    """
    context.report_phase(messages.applying_pretension())
    await _wind_up(context)
    before = await context.measure_mean("F_A", "F_B")
    first = context.loop.ring.count
    await context.send(TryModule())
    await context.request_action(
        messages.lower_limit_of_module(pretension_N=PRETENSION_N),
        ManualInput(F_limit=LOWERED_LIMIT_N),
    )
    context.report_phase(messages.waiting_for_trip())
    try:
        await context.loop.advance_until(lambda: context.mode is Mode.TRIPPED, TRIP_TIMEOUT_S)
    except TimeoutError:
        raise StepFailedError(messages.module_did_not_trip(timeout_s=TRIP_TIMEOUT_S)) from None
    await context.loop.advance(1.0)
    rows = context.read_since(first)
    tripped = int(np.argmax(rows[:, INDEX["mode"]] == rows[-1, INDEX["mode"]]))
    if rows[-1, INDEX["fault"]] != FAULT_CODE[Fault.SAFETY_MODULE]:
        raise StepFailedError(messages.stopped_without_module())
    driven = rows[max(tripped - round(DRIVE_TIME_S / T_s), 0) : tripped]
    volts = driven[:, [INDEX["u_A"], INDEX["u_B"]]].max(axis=0)
    turned = driven[-1, [INDEX["theta_A"], INDEX["theta_B"]]] - driven[0, [INDEX["theta_A"], INDEX["theta_B"]]]
    after = rows[-100:, [INDEX["F_A"], INDEX["F_B"]]].mean(axis=0)
    remaining_V = float(np.abs(rows[tripped:, [INDEX["u_A"], INDEX["u_B"]]]).max())
    figures = (
        MeasuredNumber(messages.tension_before_trip(), to_finite(float(before.mean())), "N"),
        MeasuredNumber(messages.voltage_still_applied(motor="A"), to_finite(float(volts[0])), "V"),
        MeasuredNumber(messages.voltage_still_applied(motor="B"), to_finite(float(volts[1])), "V"),
        MeasuredNumber(messages.rotation_under_voltage(motor="A"), to_finite(float(turned[0])), "rad"),
        MeasuredNumber(messages.rotation_under_voltage(motor="B"), to_finite(float(turned[1])), "rad"),
        MeasuredNumber(messages.tension_1_s_after_trip(), to_finite(float(after.mean())), "N"),
    )
    problem = None if remaining_V == 0.0 else messages.voltage_after_trip()
    problem = problem or find_uncut_drive(volts, turned)
    problem = problem or (None if has_tension_fallen(before, after) else messages.tension_after_trip())
    if problem is not None:
        return StepFinding(False, messages.module_insufficient(reason=problem), figures)
    await context.request_action(messages.restore_limit_of_module())
    await context.release_rig()
    await context.send(Reset())
    return StepFinding(True, messages.module_disabled_motors(), figures)


def find_uncut_drive(volts: Signal, turned: Signal) -> Message | None:
    """Return why the drives were not cut; None if they were.

    ``turned`` [2] are the angles of the motors [rad] while they were given up to ``volts`` [2].
    """
    for motor, u, angle in zip("AB", volts, turned, strict=True):
        if not u >= DRIVEN_MIN_V:
            return messages.voltage_too_low(motor=motor, u=float(u))
        if not angle <= -TURNED_BACK_MIN_RAD:
            return messages.drive_not_disabled(
                motor=motor, u=float(u), duration_s=DRIVE_TIME_S, angle=float(angle), maximum=-TURNED_BACK_MIN_RAD
            )
    return None


def is_near_pretension(F: Signal) -> bool:
    """Return whether both tensions [2] are the pretension; False for nan."""
    return bool((np.abs(F - PRETENSION_N) <= PRETENSION_TOLERANCE_N).all())


def has_tension_fallen(before: Signal, after: Signal) -> bool:
    """Return whether both tensions [2] have fallen by more than PRETENSION_TOLERANCE_N; False for nan."""
    return bool((after < before - PRETENSION_TOLERANCE_N).all())


def compute_peaks(F: Rows) -> tuple[float, float]:
    """Return the highest tension of [n, 2] and the largest difference of both [N]; nan if one is nan."""
    return float(F.max()), float(np.abs(F[:, 0] - F[:, 1]).max())


async def _wind_up(context: ProcedureContext) -> tuple[float, float]:
    """Apply pretension; return the highest tension and the largest difference of both [N]."""
    context.report_phase(messages.applying_pretension())
    await context.request_action(messages.keep_clear_of_pretension())
    await context.release_rig()
    await context.switch_drives_on()
    first = context.loop.ring.count
    await context.send(SetMode(Mode.PRETENSION))
    waited_s, highest, apart, steady_s = 0.0, 0.0, 0.0, 0.0
    while waited_s < WINDING_TIMEOUT_S:
        await context.loop.advance(POLL_S)
        waited_s += POLL_S
        rows = context.read_since(first)
        first += len(rows)
        if not len(rows):
            continue
        F = rows[:, [INDEX["F_A"], INDEX["F_B"]]]
        # NumPy's maximum propagates nan, Python's max may not.
        highest, apart = (float(most) for most in np.maximum((highest, apart), compute_peaks(F)))
        if not (highest <= TENSION_MAX_N and apart <= TENSION_DIFFERENCE_MAX_N):
            await context.loop.send(Stop(Fault.STOP_PRESSED, hard=True, detail=messages.pretension_failed()))
            raise StepFailedError(
                messages.tensions_out_of_bounds(
                    highest_N=highest,
                    difference_N=apart,
                    maximum_N=TENSION_MAX_N,
                    maximum_difference_N=TENSION_DIFFERENCE_MAX_N,
                    pretension_N=PRETENSION_N,
                )
            )
        if context.mode is not Mode.PRETENSION:
            raise StepFailedError(messages.loop_stopped_in_pretension())
        steady_s = steady_s + POLL_S if is_near_pretension(F.mean(axis=0)) else 0.0
        if steady_s >= 2.0:
            return highest, apart
    raise StepFailedError(messages.pretension_not_reached(timeout_s=WINDING_TIMEOUT_S))


# Wiring test ---------------------------------------------------------------------------------------
# With the drives off, each sensor must follow the manual motion of its part, by enough and in the
# right direction.


class _Sensor(NamedTuple):
    """A sensor; ``least`` is the required motion, ``place`` and ``sign`` are entries of the wiring file."""

    signal: str
    words: str
    unit: str
    least: float
    section: str
    place: str
    sign: str


_Q = _Sensor(
    signal="q",
    words=messages.joint_encoder(),
    unit="rad",
    least=0.08,
    section="encoder_q",
    place="counter",
    sign="direction",
)
_ENCODERS = (
    _Q,
    _Sensor(
        signal="theta_A",
        words=messages.motor_encoder(motor="A"),
        unit="rad",
        least=0.3,
        section="encoder_A",
        place="counter",
        sign="direction",
    ),
    _Sensor(
        signal="theta_B",
        words=messages.motor_encoder(motor="B"),
        unit="rad",
        least=0.3,
        section="encoder_B",
        place="counter",
        sign="direction",
    ),
)
_CELLS = (
    _Sensor(
        signal="F_A",
        words=messages.load_cell(tendon="A"),
        unit="N",
        least=3.0,
        section="load_cell_A",
        place="channel",
        sign="slope",
    ),
    _Sensor(
        signal="F_B",
        words=messages.load_cell(tendon="B"),
        unit="N",
        least=3.0,
        section="load_cell_B",
        place="channel",
        sign="slope",
    ),
)
_MOVED_FRACTION = 0.4
"""Fraction of ``least`` from which a sensor counts as moved."""

_MOVEMENTS = (
    (_Q, messages.turn_joint(angle=_Q.least), ManualInput(q=0.15)),
    (_ENCODERS[1], messages.wind_tendon(motor="A", angle=_ENCODERS[1].least), ManualInput(theta_A=0.5)),
    (_ENCODERS[2], messages.wind_tendon(motor="B", angle=_ENCODERS[2].least), ManualInput(theta_B=0.5)),
    (_CELLS[0], messages.pull_at_load_cell(tendon="A", F=7.0), ManualInput(pull_A=7.0)),
    (_CELLS[1], messages.pull_at_load_cell(tendon="B", F=7.0), ManualInput(pull_B=7.0)),
)


async def check_wiring(context: ProcedureContext) -> StepFinding:
    """Request each manual motion in turn; return all errors, each with the entry to change."""
    await context.switch_drives_off()
    problems: list[Message] = []
    figures = []
    for wanted, words, manual_input in _MOVEMENTS:
        context.report_phase(wanted.words)
        group = _ENCODERS if wanted in _ENCODERS else _CELLS
        first = context.loop.ring.count
        await context.record(0.3)
        await context.request_action(words, manual_input)
        await context.record(0.3)
        rows = context.read_since(first)
        excursions = {sensor: _compute_excursion(average_blocks(rows, sensor.signal)) for sensor in group}
        figures.append(
            MeasuredNumber(messages.change_of_sensor(sensor=wanted.words), to_finite(excursions[wanted]), wanted.unit)
        )
        problems += _find_sensor_problems(context, wanted, excursions)
        if wanted in _ENCODERS:
            await context.request_action(messages.turn_back(), SLACK)
        await context.release_rig()
    if problems:
        return StepFinding(False, messages.several_problems(problems=tuple(dict.fromkeys(problems))), tuple(figures))
    return StepFinding(True, messages.sensors_respond(), tuple(figures))


def _compute_excursion(values: Signal) -> float:
    """Return the largest change from the first value, with its sign; nan if a value is nan."""
    changes = values - values[0]
    return float(changes[np.argmax(np.abs(changes))]) if np.isfinite(changes).all() else float("nan")


def _find_sensor_problems(
    context: ProcedureContext, wanted: _Sensor, excursions: dict[_Sensor, float]
) -> list[Message]:
    excursion = excursions[wanted]
    at = getattr(getattr(context.wiring, wanted.section), wanted.place)
    if not np.isfinite(excursion):
        return [messages.invalid_sensor(sensor=wanted.words, place=at)]
    # The joint may turn a motor through a taut tendon, so other sensors are ignored when the joint is turned.
    others = [
        other
        for other, moved in excursions.items()
        if other is not wanted and abs(moved) > _MOVED_FRACTION * other.least
    ]
    if abs(excursion) < _MOVED_FRACTION * wanted.least:
        if others:
            other = others[0]
            return [
                messages.other_sensor_moved(
                    sensor=wanted.words,
                    entry=f"{wanted.section}.{wanted.place}",
                    other=other.words,
                    other_entry=f"{other.section}.{other.place}",
                )
            ]
        entry = f"{wanted.section}.{wanted.place}"
        return [messages.sensor_did_not_move(sensor=wanted.words, entry=entry, place=at)]
    if abs(excursion) < wanted.least:
        return [
            messages.sensor_moved_too_little(
                sensor=wanted.words,
                section=wanted.section,
                value=excursion,
                minimum=wanted.least,
                unit=wanted.unit,
            )
        ]
    if excursion < 0.0:
        return [messages.wrong_sign_of_sensor(sensor=wanted.words, entry=f"{wanted.section}.{wanted.sign}")]
    if others and wanted is not _Q:
        return [messages.two_sensors_moved(other=others[0].words)]
    return []


# Zero ----------------------------------------------------------------------------------------------
# Sets the encoders at the zero mark of the joint, or at its end switch if its position is known.


ZERO_TOLERANCE_RAD = 0.01
"""Largest difference [rad] between the joint position after setting and the one that was set."""


async def set_zero(context: ProcedureContext) -> StepFinding:
    """Set the encoders; the zeros of the motors are determined by each pretension."""
    await context.switch_drives_off()
    position = context.wiring.end_switch.position
    homing = not math.isnan(position)
    if homing:
        # The motors must release as much tendon as the joint takes up.
        out = -abs(position) * context.parameters.geometry.r_j / context.parameters.geometry.r_m
        manual_input = ManualInput(q=1.02 * position, theta_A=out, theta_B=out)
        await context.request_action(messages.hold_joint_at_switch(position=position), manual_input)
    else:
        position = 0.0
        await context.request_action(messages.hold_joint_at_mark(), SLACK)
    context.report_phase(messages.setting_encoders())
    await context.send(Zero(position, 0.0, 0.0, at_switch=homing))
    await context.record(0.1)
    newest = context.loop.ring.newest()
    q = math.nan if newest is None else float(newest[INDEX["q"]])
    if not abs(q - position) <= ZERO_TOLERANCE_RAD:
        raise StepFailedError(messages.zero_not_held(q=q, position=position))
    if homing:
        await context.request_action(messages.turn_joint_back(), SLACK)
    await context.release_rig()
    found = messages.zeroed_at_switch() if homing else messages.zeroed_at_mark()
    return StepFinding(True, found, (MeasuredNumber(messages.position_set(), position, "rad"),))
