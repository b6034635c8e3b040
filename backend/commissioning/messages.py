"""Messages about the commissioning: instructions, findings, states, and steps that cannot start."""

from datetime import datetime

from backend.realtime import HomingEnd
from backend.units import format_count
from plant import Angle, catalogue_entry

# Steps ---------------------------------------------------------------------------------------------


@catalogue_entry
def instruction_wiring_test() -> str:
    return (
        "Drives off, tendons slack. Turn the joint, then each motor, and pull on each tendon, as "
        "prompted: each time, the expected sensor must change in the expected direction."
    )


@catalogue_entry
def instruction_tare() -> str:
    return (
        "Slacken both tendons and remove all load from the load cells: the mean voltage over 1 s becomes their "
        "zero. The control loop restarts and the encoder zeros are lost: repeat Zero afterwards."
    )


@catalogue_entry
def instruction_calibrate() -> str:
    return (
        "Hang two known weights on each load cell, one after the other: they determine slope and offset. "
        "The control loop restarts and the encoder zeros are lost: repeat Zero afterwards."
    )


@catalogue_entry
def instruction_zero() -> str:
    return (
        "Move the joint to a known position, its zero mark or the end switch: the encoders count from "
        "there. Each start of the control loop clears this zero."
    )


@catalogue_entry
def instruction_direction() -> str:
    return (
        "Keep clear of the rig. Each motor turns slightly and back, with at most 1 V: its encoder count "
        "and its tension must increase, and the joint must move to its side."
    )


@catalogue_entry
def instruction_home() -> str:
    return (
        "Keep clear of the rig. Both motors hold the tendons at 4 N and drive the joint to its end "
        "switch, slowly and with at most 1.5 V, and back to its middle. The switch sets the zero of the joint. "
        "Any unexpected reading stops the homing at zero volts."
    )


@catalogue_entry
def instruction_pretension() -> str:
    return (
        "Keep clear of the rig. Both motors apply the pretension: both tensions must rise together "
        "without exceeding their limit."
    )


@catalogue_entry
def instruction_safety_module() -> str:
    return (
        "With pretension applied, lower the limit at the safety module until it trips. The control loop drives "
        "both motors for another 0.3 s, with at most 1 V: they must turn back, because the module has "
        "disabled the drives."
    )


@catalogue_entry
def lighter_weight() -> str:
    return "lighter weight"


@catalogue_entry
def heavier_weight() -> str:
    return "heavier weight"


@catalogue_entry
def further_weight() -> str:
    return "further weight"


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


@catalogue_entry
def turn_motors_to_tension(*, F: float) -> str:
    return (
        f"Turn both motors by hand until both load cells read about {F:g} N, keep clear of the rig, "
        "and confirm: the drives will be enabled"
    )


@catalogue_entry
def testing_motor(*, motor: str) -> str:
    return f"motor {motor}"


@catalogue_entry
def rotation_of_motor(*, motor: str) -> str:
    return f"rotation of motor {motor}"


@catalogue_entry
def joint_motion_by_motor(*, motor: str) -> str:
    return f"joint motion caused by motor {motor}"


@catalogue_entry
def tension_increase_by_motor(*, motor: str) -> str:
    return f"tension increase caused by motor {motor}"


@catalogue_entry
def directions_as_wired() -> str:
    return "both motors turn as the wiring file defines"


# Homing --------------------------------------------------------------------------------------------


@catalogue_entry
def loop_stopped_in_homing(*, cause: str) -> str:
    return (
        f"the control loop stopped during the motion ({cause.replace('_', ' ')}): see the status line; reset the "
        "control loop, and try again"
    )


@catalogue_entry
def not_homed(*, cause: str, remedy: str) -> str:
    return f"{cause}: {remedy}"


@catalogue_entry
def tension_in_homing(*, cause: str, maximum_N: float, remedy: str) -> str:
    return f"{cause} (at most {maximum_N:g} N is permitted): {remedy}"


HOMING_REMEDIES = {
    HomingEnd.NOT_REACHED: "turn the joint to its middle, check end_switch.line, its cable and end_switch.position",
    HomingEnd.STUCK_CLOSED: "check the switch, end_switch.line and end_switch.active",
    HomingEnd.WRONG_WAY: "repeat the wiring test and the direction step",
    HomingEnd.JOINT_HELD: "check whether something blocks the joint, and check encoder_q",
    HomingEnd.MOTOR_OFF: "repeat the direction step",
    HomingEnd.TENSION: "check whether something blocks the joint, and calibrate the load cells",
    HomingEnd.SLACK: "check the tendons on their reels, and the load cells",
    HomingEnd.TOO_LONG: "turn the joint to its middle and try again",
}


@catalogue_entry
def turn_joint_to_middle(*, voltage: float, position: float, travel: float) -> str:
    return (
        "Turn the joint by hand close to its middle, slacken the tendons, keep clear of the rig, and "
        f"confirm: the drives will be enabled, and the motors will drive the joint with at most {voltage:g} V to its "
        f"end switch at {Angle(position):.4g}, by at most {Angle(travel):.4g}"
    )


@catalogue_entry
def motion_of_joint() -> str:
    return "motion of the joint"


@catalogue_entry
def highest_tension() -> str:
    return "highest tension"


@catalogue_entry
def largest_voltage() -> str:
    return "largest voltage"


@catalogue_entry
def current_joint_position() -> str:
    return "current joint position"


@catalogue_entry
def joint_homed(*, position: float) -> str:
    return f"the joint encoder is zeroed at the end switch ({Angle(position):.4g})"


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
        f"load cell {tendon} deviates from the fitted line by {deviation_N:.2f} N, but at most {maximum_N:g} N is "
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


@catalogue_entry
def remove_load() -> str:
    return (
        "Remove all weights from the load cells, and confirm: the control loop restarts with the "
        "new calibration, the drives stay off, and the encoders lose their zero"
    )


@catalogue_entry
def unload_load_cells() -> str:
    return "Slacken both tendons, remove all load from the load cells, and confirm"


@catalogue_entry
def hang_weight(*, weight_N: float, tendon: str) -> str:
    return f"Hang {weight_N:g} N on load cell {tendon}, let it come to rest, and confirm"


@catalogue_entry
def measuring_weight(*, tendon: str, weight_N: float) -> str:
    return f"load cell {tendon}, {weight_N:g} N"


@catalogue_entry
def zero_of_load_cell(*, tendon: str) -> str:
    return f"zero of load cell {tendon}"


@catalogue_entry
def noise_of_load_cell(*, tendon: str) -> str:
    return f"noise of load cell {tendon}"


@catalogue_entry
def slope_of_load_cell(*, tendon: str) -> str:
    return f"slope of load cell {tendon}"


@catalogue_entry
def offset_of_load_cell(*, tendon: str) -> str:
    return f"offset of load cell {tendon}"


@catalogue_entry
def deviation_of_load_cell(*, tendon: str) -> str:
    return f"load cell {tendon}: largest deviation from the fitted line"


@catalogue_entry
def tared(*, at: datetime) -> str:
    return f"tared on {at:%Y-%m-%d}"


@catalogue_entry
def calibrated(*, weights: int, at: datetime) -> str:
    return f"calibrated with {weights} weights on {at:%Y-%m-%d}"


@catalogue_entry
def calibrated_by(*, source: str, who: str) -> str:
    return f"{source} by {who}"


@catalogue_entry
def load_cells_tared(*, tendons: str) -> str:
    return f"the zero of {_name_load_cells(tendons)} is set"


@catalogue_entry
def load_cells_calibrated(*, tendons: str) -> str:
    return f"slope and offset of {_name_load_cells(tendons)} are measured"


def _name_load_cells(tendons: str) -> str:
    return "both load cells" if len(tendons) == 2 else f"load cell {tendons}"


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


@catalogue_entry
def keep_clear_of_pretension() -> str:
    return "Keep clear of the rig: the motors apply pretension. Confirm to begin"


@catalogue_entry
def applying_pretension() -> str:
    return "applying pretension"


@catalogue_entry
def pretension_failed() -> str:
    return "the pretension failed"


@catalogue_entry
def tension_of_tendon(*, tendon: str) -> str:
    return f"tension of tendon {tendon}"


@catalogue_entry
def highest_tension_in_motion() -> str:
    return "highest tension during the motion"


@catalogue_entry
def largest_difference_of_tensions() -> str:
    return "largest difference of the tensions"


@catalogue_entry
def pretension_reached(*, pretension_N: float) -> str:
    return f"both tensions rose together to {pretension_N:g} N"


@catalogue_entry
def lower_limit_of_module(*, pretension_N: float) -> str:
    return f"Lower the tension limit at the safety module below {pretension_N:g} N: the module must trip; then confirm"


@catalogue_entry
def waiting_for_trip() -> str:
    return "waiting for the trip"


@catalogue_entry
def tension_before_trip() -> str:
    return "tension before the trip"


@catalogue_entry
def voltage_still_applied(*, motor: str) -> str:
    return f"voltage still applied to motor {motor}"


@catalogue_entry
def rotation_under_voltage(*, motor: str) -> str:
    return f"rotation of motor {motor} under this voltage"


@catalogue_entry
def tension_1_s_after_trip() -> str:
    return "tension 1 s after the trip"


@catalogue_entry
def restore_limit_of_module() -> str:
    return "Restore the limit of the module, acknowledge the trip there, and confirm"


@catalogue_entry
def module_disabled_motors() -> str:
    return "the module tripped and disabled both motors while voltage was still applied"


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


@catalogue_entry
def joint_encoder() -> str:
    return "joint encoder"


@catalogue_entry
def motor_encoder(*, motor: str) -> str:
    return f"encoder of motor {motor}"


@catalogue_entry
def load_cell(*, tendon: str) -> str:
    return f"load cell {tendon}"


@catalogue_entry
def turn_joint(*, angle: float) -> str:
    return f"Turn the joint by hand towards +q by {Angle(angle):g} or more, and confirm"


@catalogue_entry
def wind_tendon(*, motor: str, angle: float) -> str:
    return f"Turn motor {motor} by hand by {Angle(angle):g} or more so that it winds its tendon, and confirm"


@catalogue_entry
def pull_at_load_cell(*, tendon: str, F: float) -> str:
    return f"Pull on load cell {tendon} with about {F:g} N, and confirm"


@catalogue_entry
def turn_back() -> str:
    return "Turn it back to its initial position, and confirm"


@catalogue_entry
def change_of_sensor(*, sensor: str) -> str:
    return f"{sensor}, change"


@catalogue_entry
def sensors_respond() -> str:
    return "every sensor responds correctly"


# Zero ----------------------------------------------------------------------------------------------


@catalogue_entry
def zero_not_held(*, q: float, position: float) -> str:
    return f"the joint reads {Angle(q):.4f} after it was set to {Angle(position):.4f}: hold it still and try again"


@catalogue_entry
def hold_joint_at_switch(*, position: float) -> str:
    return (
        f"Slacken both tendons, turn the joint slowly by hand onto its end switch at {Angle(position):.4g}, hold "
        "it there, and confirm"
    )


@catalogue_entry
def hold_joint_at_mark() -> str:
    return "Turn the joint by hand to its zero mark, hold it there, and confirm"


@catalogue_entry
def setting_encoders() -> str:
    return "setting the encoders"


@catalogue_entry
def turn_joint_back() -> str:
    return "Turn the joint back to its middle, and confirm"


@catalogue_entry
def zeroed_at_switch() -> str:
    return "the joint encoder is zeroed at the end switch"


@catalogue_entry
def zeroed_at_mark() -> str:
    return "the joint encoder is zeroed at its zero mark"


@catalogue_entry
def position_set() -> str:
    return "joint position that was set"


# Status --------------------------------------------------------------------------------------------


@catalogue_entry
def step_never_executed() -> str:
    return "this step has never been executed"


@catalogue_entry
def last_execution_failed() -> str:
    return "the last execution failed"


@catalogue_entry
def wiring_changed_since() -> str:
    return "the wiring file has changed since"


@catalogue_entry
def encoders_lost_zero() -> str:
    return "the control loop has been restarted since: the encoders have lost their zero"


@catalogue_entry
def load_cell_not_calibrated(*, tendon: str) -> str:
    return f"load cell {tendon} has not been calibrated with this wiring"


@catalogue_entry
def validity_elapsed(*, days: float) -> str:
    return f"the result is older than {format_count(days, 'day')}"


@catalogue_entry
def valid_after_execution(*, days: float) -> str:
    return f"the result is valid for {format_count(days, 'day')} after the execution of the step"


@catalogue_entry
def wiring_test_failed_since() -> str:
    return "a wiring test has failed since"


@catalogue_entry
def calibrated_by_tables() -> str:
    return "both load cells are calibrated by tables of the wiring file"


@catalogue_entry
def zero_set_by(*, step: str) -> str:
    return f"{step} has set the zero"


@catalogue_entry
def either_step(*, step: str, other: str) -> str:
    return f"{step} or {other}"


@catalogue_entry
def finding_of_step(*, step: str, finding: str) -> str:
    return f"{step}: {finding}"


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


@catalogue_entry
def unknown_inputs(*, step: str, unknown: str, known: str) -> str:
    return f"{step} has no input {unknown}; its inputs: {known or 'none'}"


@catalogue_entry
def restarting_with_measured_values() -> str:
    return "restarting the control loop with the measured values"


@catalogue_entry
def restarted_with_measured_values() -> str:
    return "with the measured values of the step"


@catalogue_entry
def bring_up_ended() -> str:
    return "the bring-up has ended"
