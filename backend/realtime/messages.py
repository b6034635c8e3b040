"""Messages of the control loop: rejected commands, observed faults, invalid packets, ended loop processes."""

import math
from collections.abc import Callable, Mapping

from plant import Angle, Quantity, catalogue_entry

# Packets -------------------------------------------------------------------------------------------
# Messages between service and loop process.


@catalogue_entry
def packet_too_long(*, message_type: str, size_bytes: int, maximum_bytes: int) -> str:
    return f"{message_type} takes {size_bytes} bytes, but at most {maximum_bytes} can be sent: shorten it"


@catalogue_entry
def packet_not_valid(*, problems: str) -> str:
    return problems


@catalogue_entry
def program_parts_missing(*, parts: str, arrived: int, expected: int) -> str:
    return f"{arrived} of the program's {expected} {parts} arrived: send the program again"


# Modes ---------------------------------------------------------------------------------------------
# Transitions, and motions that start from a mode.


@catalogue_entry
def drives_switched_off() -> str:
    return (
        "the drives are switched off, because people may be working at the rig: keep clear of the rig, then "
        "switch the drives on in the bring-up"
    )


@catalogue_entry
def commissioning_motion_in_progress() -> str:
    return "a commissioning motion is in progress: wait for its end or stop it"


@catalogue_entry
def mode_requires_program(*, mode: str) -> str:
    return f"{mode} requires a program"


@catalogue_entry
def law_requires_tendons(*, law: str) -> str:
    return f"a {law} program requires tendons with load cells, which this actuator does not have"


@catalogue_entry
def trial_requires_load_cells() -> str:
    return "the test of the safety module requires load cells, which this actuator does not have"


@catalogue_entry
def deflection_too_large(*, deflection: float, maximum: float) -> str:
    return (
        f"the deflection of the springs is {Quantity(deflection, 'rad'):g}; the largest permitted one is "
        f"{Quantity(maximum, 'rad'):g}"
    )


@catalogue_entry
def law_requires_pretension(*, law: str) -> str:
    return f"a {law} program starts only from mode pretension, where the joint is moved to 0 first"


@catalogue_entry
def safety_module_requires_pretension() -> str:
    return "the safety module can be tested only while both tendons are at the pretension"


@catalogue_entry
def baseline_gains_fixed() -> str:
    return "the gains of a baseline law are fixed while its program runs: wait for its end or abort it"


@catalogue_entry
def references_not_in_mode(*, mode: str) -> str:
    return f"the operator can set references only in modes run and compliance; the mode is {mode}"


@catalogue_entry
def mode_change_not_legal(*, current: str, wanted: str, legal: tuple[str, ...]) -> str:
    names = ", ".join(legal) or "none: wait for the end of the stop, then reset the fault if there is one"
    return f"{current} cannot change directly to {wanted}; legal now: {names}"


@catalogue_entry
def mode_requires_taut_tendons(*, mode: str, tension_N: float) -> str:
    return f"{mode} is possible only after both tendons have reached {tension_N:g} N"


# Contact -------------------------------------------------------------------------------------------
# Contact detection, pushes and obstacles.


@catalogue_entry
def bias_not_increasing() -> str:
    return "the points of the external-force bias must be finite and have increasing S: the bias is unchanged"


@catalogue_entry
def bias_in_use() -> str:
    return "disturbance rejection uses the bias of the external force: set k_ext to 0 before you clear the bias"


@catalogue_entry
def unknown_contact_detection(*, number: int, count: int) -> str:
    return f"a segment refers to contact detection {number}, but the program has {count}"


@catalogue_entry
def law_without_contact_reaction(*, law: str) -> str:
    return f"a {law} program has no contact reaction: run it with the cascade"


@catalogue_entry
def contact_reaction_armed(*, threshold_N: float) -> str:
    return (
        f"contact reaction is armed at {threshold_N:g} N and would end this program at its "
        "first contact. Disable it first; the program enables its own contact reaction"
    )


@catalogue_entry
def compliant_after_contact() -> str:
    return "the joint is compliant after a contact: choose a mode first, then move the joint"


@catalogue_entry
def push_not_in_mode(*, mode: str, push_modes: tuple[str, ...]) -> str:
    return (
        f"a push is accepted only while the operator controls the joint, in {' and '.join(push_modes)}; "
        f"the mode is {mode}"
    )


@catalogue_entry
def program_sets_obstacles() -> str:
    return "the program sets its own obstacles: wait for its end or abort it"


@catalogue_entry
def law_without_obstacle(*, law: str) -> str:
    return f"a {law} program does not support an obstacle: remove the obstacle"


@catalogue_entry
def unknown_obstacle(*, number: int, count: int) -> str:
    return f"a segment refers to obstacle {number}, but the program has {count}"


@catalogue_entry
def number_of_bias_points() -> str:
    return "number of points of the bias"


@catalogue_entry
def number_of_reaction_changes() -> str:
    return "number of changes of the contact reaction"


@catalogue_entry
def zero_disables_reaction() -> str:
    return "0 N disables the contact reaction"


@catalogue_entry
def repeat_push() -> str:
    return "repeat the command to push for longer"


@catalogue_entry
def push_duration_elapsed() -> str:
    return "its duration has elapsed"


@catalogue_entry
def push_ended_by_mode(*, mode: str) -> str:
    return f"the mode is {mode}"


@catalogue_entry
def number_of_obstacle_changes() -> str:
    return "number of changes of the obstacle"


# Programs ------------------------------------------------------------------------------------------
# Programs and tunings that no plant, or not this one, can execute.


@catalogue_entry
def plant_without_obstacles() -> str:
    return "this plant does not support obstacles: simulate the program as a dry run"


@catalogue_entry
def plant_without_push() -> str:
    return "this plant cannot push the joint: push by hand, or simulate the program as a dry run"


@catalogue_entry
def plant_without_shaft_load() -> str:
    return "this plant cannot load its motors' shafts: simulate the program as a dry run"


@catalogue_entry
def no_excitation() -> str:
    return "a force-hold program requires an excitation"


@catalogue_entry
def no_voltage_steps() -> str:
    return "a program of voltage steps requires at least one step"


@catalogue_entry
def no_tension_legs() -> str:
    return "a tension sweep requires at least one leg"


@catalogue_entry
def no_bank_entries() -> str:
    return "a bank requires at least one entry: no gain was changed"


@catalogue_entry
def gain_not_finite() -> str:
    return "a gain is not a finite number: no gain was changed"


@catalogue_entry
def bias_not_calibrated() -> str:
    return (
        "disturbance rejection requires a calibrated external-force bias: hold the joint at rest and "
        "calibrate it first, or set k_ext to 0"
    )


@catalogue_entry
def program_sets_tuning() -> str:
    return "the program changes the tuning: wait for its end or abort it"


@catalogue_entry
def law_with_fixed_gains(*, law: str) -> str:
    return f"gains are fixed while a {law} program runs: remove the tuning changes from the program"


@catalogue_entry
def unknown_tuning(*, number: int, count: int) -> str:
    return f"a segment refers to tuning {number}, but the program has {count}"


@catalogue_entry
def number_of_segments() -> str:
    return "number of segments"


@catalogue_entry
def split_program() -> str:
    return "split the program"


@catalogue_entry
def number_of_tuning_changes() -> str:
    return "number of changes of the tuning"


@catalogue_entry
def load_pulls_tendon() -> str:
    return "a load pulls in the direction of the tendon"


@catalogue_entry
def tendons_slack_at_zero() -> str:
    return "the tendons become slack at 0"


@catalogue_entry
def state_not_reached(*, timeout_s: float) -> str:
    return f"the awaited state was not reached within {timeout_s:g} s of loop time"


@catalogue_entry
def state_not_reached_in_mode(*, timeout_s: float, mode: str) -> str:
    return f"the awaited state was not reached within {timeout_s:g} s of loop time; the mode is {mode}"


# Commissioning -------------------------------------------------------------------------------------
# Commands of commissioning.


@catalogue_entry
def plant_without_manual_input() -> str:
    return "this plant does not support simulated manual input: move the rig by hand"


@catalogue_entry
def plant_without_drive_switch() -> str:
    return "this plant has no drives to switch off"


@catalogue_entry
def plant_without_end_switch() -> str:
    return "this plant has no end switch: homing is not possible"


@catalogue_entry
def tendons_too_taut(*, F_A: float, F_B: float, maximum_N: float) -> str:
    return f"the tensions are {F_A:.1f} N and {F_B:.1f} N, but at most {maximum_N:g} N is safe: slacken the tendons"


@catalogue_entry
def only_in_off(*, action: str, mode: str) -> str:
    return f"{action} only in mode off; the mode is {mode}"


@catalogue_entry
def zero_can_be_set() -> str:
    return "a zero can be set"


@catalogue_entry
def motor_can_be_tested() -> str:
    return "a motor can be tested"


@catalogue_entry
def homing_can_be_started() -> str:
    return "homing can be started"


@catalogue_entry
def directions_can_be_confirmed() -> str:
    return "motor directions can be confirmed"


@catalogue_entry
def drives_can_be_switched_on() -> str:
    return "the drives can be switched on"


@catalogue_entry
def stopped_by_switching_off() -> str:
    return "the drives were switched off"


@catalogue_entry
def travel_to_switch() -> str:
    return "travel to the end switch"


# Control loop --------------------------------------------------------------------------------------
# Commands in general, and the reset.


@catalogue_entry
def unknown_command(*, command: str) -> str:
    return f"unknown command {command}"


@catalogue_entry
def command_failed(*, command: str, reason: str) -> str:
    return f"{command} failed: {reason}"


@catalogue_entry
def no_recording_replayed() -> str:
    return "no recording is replayed: play, pause and position do not apply"


@catalogue_entry
def no_fault_to_reset(*, mode: str) -> str:
    return f"there is no fault to reset; the mode is {mode}"


@catalogue_entry
def loop_failed_in_own_code() -> str:
    return "this control loop failed because of an error in its own code: start a new control loop"


@catalogue_entry
def cause_of_fault_persists(*, reason: str) -> str:
    return f"the cause of the fault persists: {reason}"


# Faults --------------------------------------------------------------------------------------------
# What the control loop has observed when it stops.


@catalogue_entry
def sensor_jumped(*, sensor: str, before: float, after: float, unit: str) -> str:
    return f"{sensor} went from {Quantity(before, unit, after):.3f}"


@catalogue_entry
def motor_reversed(*, encoder: str, u: float) -> str:
    return f"{encoder} accelerates against the voltage of {u:.1f} V"


@catalogue_entry
def motor_encoder_stuck(*, encoder: str, angle: float, u: float) -> str:
    return f"{encoder} stays at {Angle(angle):.3f} although the motor voltage is {u:.1f} V"


@catalogue_entry
def load_cell_stuck(*, load_cell: str, F: float, turned: float) -> str:
    return f"{load_cell} stays at {F:.2f} N although its motor turned by {Angle(turned):g}"


@catalogue_entry
def tension_unlike_encoders(*, load_cell: str, F: float, F_encoders: float) -> str:
    return f"{load_cell} = {F:.1f} N, but according to the encoders the force of this spring is {F_encoders:.1f} N"


@catalogue_entry
def sensor_unchanged(*, sensor: str, difference: str) -> str:
    return f"{sensor} does not change; {difference}"


@catalogue_entry
def readings_at_trip(*, F_A: float, F_B: float, q: float) -> str:
    return (
        f"at the trip, {_format_reading('F_A', F_A, '.1f', 'N')}, {_format_reading('F_B', F_B, '.1f', 'N')}, "
        f"{_format_reading('q', q, '', 'rad')}"
    )


@catalogue_entry
def deflection_at_trip(*, deflection: float, q: float) -> str:
    return f"at the trip, {_format_reading('deflection', deflection, '', 'rad')}, {_format_reading('q', q, '', 'rad')}"


@catalogue_entry
def tendons_slack(*, F_A: float, F_B: float, minimum_N: float, duration_s: float) -> str:
    slack, taut = _format_tensions(F_A, F_B, lambda F: minimum_N > F)
    return f"{slack} below the limit of {minimum_N:g} N for more than {duration_s:g} s{taut}"


@catalogue_entry
def tension_too_high(*, F_A: float, F_B: float, maximum_N: float) -> str:
    beyond, within = _format_tensions(F_A, F_B, lambda F: maximum_N < F)
    return f"{beyond} above the limit of {maximum_N:g} N{within}"


@catalogue_entry
def joint_out_of_range(*, q: float, maximum: float) -> str:
    # six digits, so that a conversion to degrees gives 90
    return f"q = {Angle(q)}; the limit is {Angle(maximum)} in either direction"


@catalogue_entry
def load_cells_saturated(*, voltages: Mapping[str, float]) -> str:
    readings = ", ".join(f"{load_cell} reads {V:.2f} V" for load_cell, V in voltages.items())
    return f"{readings}: the limit of its input range, or of its calibration"


@catalogue_entry
def sensors_without_reading(*, sensors: tuple[str, ...]) -> str:
    return f"no valid reading from {', '.join(sensors)}"


@catalogue_entry
def deadlines_missed(*, count: int) -> str:
    return f"{count} consecutive periods of 1 ms missed"


def _format_reading(name: str, value: float, digits: str, unit: str) -> str:
    """Return a reading as text; one that is not finite has no unit."""
    if not math.isfinite(value):
        return f"no valid reading from {name}"
    return f"{name} = {Quantity(value, unit):{digits}}"


def _format_tensions(F_A: float, F_B: float, is_beyond: Callable[[float], bool]) -> tuple[str, str]:
    """Return the tensions beyond a limit as text, and after a semicolon the other one."""
    tensions = {"F_A": F_A, "F_B": F_B}
    beyond = [f"{name} = {F:.2f} N" for name, F in tensions.items() if is_beyond(F)]
    within = [f"; {_format_reading(name, F, '.2f', 'N')}" for name, F in tensions.items() if not is_beyond(F)]
    return " and ".join(beyond), "".join(within)


# Replay --------------------------------------------------------------------------------------------
# Commands to a replayed recording.


@catalogue_entry
def replay_without_modes() -> str:
    return "the service replays a recording: no actuator moves, and no mode can start"


@catalogue_entry
def not_a_replay_command() -> str:
    return (
        "the service replays a recording: no actuator moves, and only the commands play, pause, speed "
        "and position are accepted"
    )


@catalogue_entry
def sample_outside_recording(*, sample: int, last: int) -> str:
    return f"sample {sample} is outside the recording: choose a sample from 0 to {last}"


@catalogue_entry
def speed_out_of_range(*, speed: float, minimum: float, maximum: float) -> str:
    return f"a speed of {speed:g} is outside {minimum:g} to {maximum:g}"


# Loop process --------------------------------------------------------------------------------------
# Start of the loop process and its rehearsal on the simulator.


@catalogue_entry
def rehearsed_command_rejected(*, command: str, reason: str) -> str:
    return f"{command} rejected in the rehearsal on the simulator: {reason}"


@catalogue_entry
def rehearsal_without_pretension(*, ticks: int, mode: str) -> str:
    return f"pretension was not reached within {ticks} control steps; the mode is {mode}"


@catalogue_entry
def set_up_already() -> str:
    return "the control loop is set up only once, at its start"


@catalogue_entry
def woken_without_message() -> str:
    return "the channel became readable, but contained no message"


@catalogue_entry
def first_message_not_setup(*, message_type: str) -> str:
    return f"the first message must be Setup, not {message_type}"


@catalogue_entry
def not_a_ring_buffer(*, fd: int) -> str:
    return f"file descriptor {fd} does not refer to a ring buffer"


@catalogue_entry
def ring_buffer_of_other_version(*, width: int, expected: int) -> str:
    return (
        f"the ring buffer has rows of {width} values, but the samples of this version have {expected}: both "
        "processes must run the same version"
    )


@catalogue_entry
def priority_not_granted(*, priority: int, reason: str | None) -> str:
    return f"FIFO priority {priority}: {reason}; raise rtprio in limits.conf or grant CAP_SYS_NICE"


@catalogue_entry
def memory_not_locked(*, reason: str) -> str:
    return f"locked memory: {reason}; raise memlock in limits.conf or grant CAP_IPC_LOCK"


# Supervisor ----------------------------------------------------------------------------------------
# Loop processes that are not running, and why.


@catalogue_entry
def loop_not_running(*, reason: str) -> str:
    return f"the control loop is not running: {reason}"


@catalogue_entry
def loop_never_started() -> str:
    return "it has not been started"


@catalogue_entry
def loop_already_started() -> str:
    return "the control loop has already been started: stop it first"


@catalogue_entry
def loop_still_starting() -> str:
    return "it is still starting"


@catalogue_entry
def loop_not_ready_in_time(*, timeout_s: float) -> str:
    return f"it was not ready within {timeout_s:g} s"


@catalogue_entry
def loop_did_not_end() -> str:
    return "it did not end on request"


@catalogue_entry
def loop_accepts_no_commands() -> str:
    return "it no longer accepts commands"


@catalogue_entry
def loop_did_not_answer(*, timeout_s: float) -> str:
    return f"it did not answer within {timeout_s:g} s"


@catalogue_entry
def loop_hangs(*, duration_s: float) -> str:
    return f"it has executed no control step for {duration_s:.1f} s"


@catalogue_entry
def loop_killed(*, signal_name: str) -> str:
    return f"killed by {signal_name}"


@catalogue_entry
def loop_ended(*, status: int) -> str:
    return f"ended with status {status}"


@catalogue_entry
def loop_ended_for_reason(*, reason: str, ending: str) -> str:
    return f"{reason} ({ending})"


@catalogue_entry
def loop_restarted() -> str:
    return "the control loop is restarted"


@catalogue_entry
def service_ended() -> str:
    return "service ended"


# Monitoring ----------------------------------------------------------------------------------------
# Background parts of the service: what does not work without them, and what they find.


@catalogue_entry
def loop_monitor() -> str:
    return "The monitor of the control loop"


@catalogue_entry
def end_detected_late() -> str:
    return "If the control loop ends now, the service detects it late."


@catalogue_entry
def liveness_signal() -> str:
    return "The liveness signal to the control loop"


@catalogue_entry
def loop_stops_without_signal() -> str:
    return "Without this signal the control loop stops within 4 s."


@catalogue_entry
def heartbeat() -> str:
    return "The heartbeat to the control loop"


@catalogue_entry
def loop_stops_without_heartbeat() -> str:
    return "The control loop stops after 0.34 s without a heartbeat."


@catalogue_entry
def watchdog_monitor() -> str:
    return "The monitor of the card's watchdog"


@catalogue_entry
def watchdog_death_unnoticed() -> str:
    return "If the watchdog dies now, only the control loop detects it."


@catalogue_entry
def watchdog_dead() -> str:
    return "the card's watchdog is dead: Reset starts a new control loop with a new watchdog"


@catalogue_entry
def loop_died_with_mirror(*, watchdog_s: float) -> str:
    return (
        "the control loop has died: the watchdog of the rig's card disables the drives "
        f"{watchdog_s:g} s after the last write, which the service cannot observe; "
        "check the rig, then reset"
    )


@catalogue_entry
def loop_and_watchdog_died() -> str:
    return (
        "the control loop and the card's watchdog had both died: the service set the outputs to zero; "
        "check the rig, then reset"
    )
