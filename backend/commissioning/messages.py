"""Messages about the commissioning: steps that cannot start, and the findings of failed steps."""

from plant import Angle, catalogue_entry

# Directions ----------------------------------------------------------------------------------------


@catalogue_entry
def wrong_initial_tensions(*, F_A: float, F_B: float, minimum: float, maximum: float) -> str:
    return (
        f"the tensions are {F_A:.1f} N and {F_B:.1f} N, but {minimum:g} to {maximum:g} N is required: wind the "
        "tendons by hand"
    )


@catalogue_entry
def several_problems(*, problems: tuple[str, ...]) -> str:
    return "; ".join(problems)


@catalogue_entry
def loop_stopped_in_motor_test(*, motor: str) -> str:
    return (
        f"the control loop stopped while motor {motor} was tested: see the status line; reset the control loop, and "
        "try again"
    )


@catalogue_entry
def motor_without_voltage(*, motor: str) -> str:
    return f"motor {motor} received no voltage: try again"


@catalogue_entry
def nothing_followed_motor(*, motor: str) -> str:
    return f"motor {motor} turned, but neither joint nor tension followed: check its tendon"


@catalogue_entry
def motor_did_not_turn(*, motor: str) -> str:
    return f"motor {motor} did not turn: check motor_{motor}.channel, its amplifier and the drive-enable line"


@catalogue_entry
def joint_contradicts_tensions(*, motor: str, q: float, F: float) -> str:
    return (
        f"motor {motor}: joint ({Angle(q):.4f}) and tensions ({F:.2f} N) "
        "contradict each other: check encoder_q and the load cells with the wiring test"
    )


@catalogue_entry
def motors_exchanged(*, driven: str, turned: str) -> str:
    return f"the voltage for motor {driven} turned motor {turned}: swap motor_A.channel and motor_B.channel"


@catalogue_entry
def wrong_sign_of_motor(*, motor: str) -> str:
    return f"motor {motor} releases its tendon at a positive voltage: change the sign of motor_{motor}.gain"


@catalogue_entry
def invalid_motor_encoder(*, motor: str) -> str:
    return f"the encoder of motor {motor} has no valid reading: check encoder_{motor}.counter and its cable"


@catalogue_entry
def motor_encoders_exchanged() -> str:
    return "the encoders of the motors are swapped: swap encoder_A.counter and encoder_B.counter"


@catalogue_entry
def motor_encoder_does_not_move(*, motor: str) -> str:
    return f"the encoder of motor {motor} does not move: check encoder_{motor}.counter and its cable"


@catalogue_entry
def wrong_sign_of_motor_encoder(*, motor: str) -> str:
    return f"the encoder of motor {motor} has the wrong sign: change the sign of encoder_{motor}.direction"


# Homing --------------------------------------------------------------------------------------------


@catalogue_entry
def loop_stopped_in_homing(*, cause: str) -> str:
    return (
        f"the control loop stopped during the motion ({cause}): see the status line; reset the control loop, and try "
        "again"
    )


@catalogue_entry
def not_homed(*, cause: str, remedy: str) -> str:
    return f"{cause}: {remedy}"


@catalogue_entry
def tension_in_homing(*, cause: str, maximum_N: float, remedy: str) -> str:
    return f"{cause} (at most {maximum_N:g} N is permitted): {remedy}"


# Load cells ----------------------------------------------------------------------------------------


@catalogue_entry
def load_cell_zero_too_large(*, tendon: str, zero_V: float, maximum_V: float) -> str:
    return (
        f"load cell {tendon} reads {zero_V:.2f} V without load, but at most {maximum_V:g} V is permitted: slacken "
        "its tendon, or adjust its amplifier"
    )


@catalogue_entry
def load_cells_have_tables() -> str:
    return "both load cells are calibrated by tables, which include the zero: renew the calibration instead"


@catalogue_entry
def weights_too_close(*, minimum_N: float) -> str:
    return f"use weights at least {minimum_N:g} N apart, the lighter one first"


@catalogue_entry
def weights_not_distinguished(*, tendon: str, difference_V: float, lightest_N: float, heaviest_N: float) -> str:
    return (
        f"the readings of load cell {tendon} under {lightest_N:g} to {heaviest_N:g} N differ by "
        f"{1e3 * difference_V:.2f} mV, but at least 1 mV is required to distinguish weights: "
        "check its cable, amplifier and channel"
    )


@catalogue_entry
def wrong_sign_of_load_cell(*, tendon: str, slope: float, wiring_slope: float) -> str:
    return (
        f"load cell {tendon} has {slope:.4g} N/V, but the wiring file gives {wiring_slope:.4g} N/V, with the "
        f"opposite sign: change the sign of load_cell_{tendon}.slope, or swap the two leads of the load cell"
    )


@catalogue_entry
def load_cell_not_linear(*, tendon: str, deviation_N: float, maximum_N: float) -> str:
    return (
        f"load cell {tendon} deviates from its line by {deviation_N:.2f} N, but at most {maximum_N:g} N is "
        "permitted: check the weights, or calibrate it by a table in the wiring file"
    )


@catalogue_entry
def invalid_load_cell(*, tendon: str) -> str:
    return f"load cell {tendon} has no valid voltage: check its cable, amplifier and channel"


@catalogue_entry
def load_cell_saturated(*, tendon: str, voltage: float, maximum_V: float) -> str:
    return (
        f"load cell {tendon} reads up to {voltage:.2f} V, but its input range ends at {maximum_V:.2f} V: reduce the "
        "load or the gain of its amplifier"
    )


@catalogue_entry
def load_cell_too_noisy(*, tendon: str, noise_N: float, maximum_N: float) -> str:
    return (
        f"load cell {tendon} has noise of {noise_N:.2f} N, but at most {maximum_N:g} N is permitted: let it come to "
        "rest, and check shield and ground"
    )


# Pretension and safety module ----------------------------------------------------------------------


@catalogue_entry
def not_at_pretension(*, F_A: float, F_B: float, pretension_N: float) -> str:
    return f"the tensions are {F_A:.1f} N and {F_B:.1f} N, not {pretension_N:g} N: calibrate the load cells"


@catalogue_entry
def module_did_not_trip(*, timeout_s: float) -> str:
    return (
        f"the module did not trip within {timeout_s:g} s although its limit was below the "
        "tension of the tendons: do not continue; check its limit, its supply, and safety_tripped "
        "in the wiring file; restore the limit of the module"
    )


@catalogue_entry
def stopped_without_module() -> str:
    return (
        "the control loop stopped, but not because of the safety module: see the status line; restore the limit of "
        "the module"
    )


@catalogue_entry
def module_insufficient(*, reason: str) -> str:
    return f"the module tripped, but {reason}: do not continue; restore the limit of the module"


@catalogue_entry
def voltage_after_trip() -> str:
    return "the control loop did not set zero volts"


@catalogue_entry
def tension_after_trip() -> str:
    return "the tension did not fall afterwards"


@catalogue_entry
def voltage_too_low(*, motor: str, u: float) -> str:
    return f"motor {motor} received only {u:.2f} V, which is too little to test whether its drive was disabled"


@catalogue_entry
def drive_not_disabled(*, motor: str, u: float, duration_s: float, angle: float, maximum: float) -> str:
    return (
        f"motor {motor} turned back by {Angle(-angle):.4f} while it received {u:.2f} V for another {duration_s:g} s, "
        f"but at least {Angle(-maximum):g} is required: check how the module disables the drives"
    )


@catalogue_entry
def tensions_out_of_bounds(
    *, highest_N: float, difference_N: float, maximum_N: float, maximum_difference_N: float, pretension_N: float
) -> str:
    return (
        f"the motion was stopped: the tension reached {highest_N:.1f} N and the difference of the tensions "
        f"{difference_N:.1f} N, but at most {maximum_N:g} N "
        f"and {maximum_difference_N:g} N are permitted for a pretension of {pretension_N:g} N; "
        "repeat the previous steps"
    )


@catalogue_entry
def loop_stopped_in_pretension() -> str:
    return "the control loop stopped while the tensions rose: see the status line"


@catalogue_entry
def pretension_not_reached(*, timeout_s: float) -> str:
    return f"pretension was not reached within {timeout_s:g} s"


# Wiring test ---------------------------------------------------------------------------------------


@catalogue_entry
def invalid_sensor(*, sensor: str, place: str) -> str:
    return f"the {sensor} has no valid reading: check its cable and its amplifier at {place}"


@catalogue_entry
def other_sensor_moved(*, sensor: str, entry: str, other: str, other_entry: str) -> str:
    return f"the {other} moved instead of the {sensor}: swap {entry} and {other_entry} in the wiring file"


@catalogue_entry
def sensor_did_not_move(*, sensor: str, entry: str, place: str) -> str:
    return f"the {sensor} did not move: check its cable and {entry} ({place})"


@catalogue_entry
def sensor_moved_too_little(*, sensor: str, section: str, value: float, minimum: float, unit: str) -> str:
    return (
        f"the {sensor} moved by only {value:.2f} {unit}, but at least {minimum:g} {unit} is required: move it "
        f"further, or correct {section}"
    )


@catalogue_entry
def wrong_sign_of_sensor(*, sensor: str, entry: str) -> str:
    return f"the {sensor} has the wrong sign: change the sign of {entry} in the wiring file"


@catalogue_entry
def two_sensors_moved(*, other: str) -> str:
    return f"the {other} moved too: check whether one cable carries both signals"


# Zero ----------------------------------------------------------------------------------------------


@catalogue_entry
def zero_not_held(*, q: float, position: float) -> str:
    return f"the joint reads {Angle(q):.4f} after it was set to {Angle(position):.4f}: hold it still and try again"


# Sessions ------------------------------------------------------------------------------------------


@catalogue_entry
def abandoned_after_motor_test() -> str:
    return "the step was abandoned after a motor test: repeat it"


@catalogue_entry
def lockout_not_stored(*, state: str, reason: str) -> str:
    return f"The drives are {state} now, but the service could not store this for its next start ({reason})."


@catalogue_entry
def wiring_file_changed() -> str:
    return "the wiring file has changed since the control loop started: repeat the command"


@catalogue_entry
def step_blocked(*, step: str, reason: str) -> str:
    return f"{step}: {reason}"


@catalogue_entry
def no_end_switch_position() -> str:
    return "end_switch.position is missing in the wiring file: set the angle at which the switch closes"


@catalogue_entry
def other_steps_first(*, steps: str) -> str:
    return f"do {steps} first"
