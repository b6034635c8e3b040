"""Messages about commands, runs in progress and the state of the service: refusals, reasons, and events."""

from collections.abc import Sequence

from backend.realtime import Mode
from backend.units import format_count, format_number
from plant import Angle, Obstacle, Quantity, catalogue_entry

# Actuator ------------------------------------------------------------------------------------------


@catalogue_entry
def illegal_mode(*, reason: str, legal: Sequence[str]) -> str:
    return f"{reason}; legal now: {', '.join(legal) or 'none'}"


@catalogue_entry
def fault_is_latched() -> str:
    return "a fault is latched: reset it first"


@catalogue_entry
def request_is_paused() -> str:
    return (
        "the current request is paused, and its next run starts from pretension: continue the "
        "request, or abort it softly"
    )


@catalogue_entry
def mode_needs_pretension(*, mode: Mode) -> str:
    return f"{mode} requires pretension in both tendons: wait until it is reached"


@catalogue_entry
def no_direct_change_of_mode(*, before: Mode, after: Mode) -> str:
    return f"{before} cannot change directly to {after}"


@catalogue_entry
def zero_volts_not_confirmed() -> str:
    return "the control loop has not confirmed zero volts: press the e-stop at the rig"


@catalogue_entry
def change_needs_mode_off(*, change: str, mode: Mode) -> str:
    return f"the mode is {mode}, but must be off to apply {change}"


@catalogue_entry
def change_takes_effect_at_next_start(*, change: str, reason: str) -> str:
    return f"{reason}; its next start applies {change}"


@catalogue_entry
def rig_is_occupied(*, reason: str) -> str:
    return f"{reason}: wait until it ends, or cancel it"


@catalogue_entry
def push_needs_simulated_plant(*, plant: str, is_rig: bool) -> str:
    by_hand = ": push it by hand" if is_rig else ""
    return f"a commanded push requires a simulated plant, but the plant is the {plant}{by_hand}"


@catalogue_entry
def obstacle_needs_simulated_plant(*, plant: str) -> str:
    return f"an obstacle requires a simulated plant, but the plant is the {plant}"


@catalogue_entry
def mode_refused_before_run() -> str:
    return "the control loop refused the mode before the run began"


@catalogue_entry
def playback_paused_by_stop() -> str:
    return "STOP was pressed: playback paused"


@catalogue_entry
def control_lost() -> str:
    return "control lost"


@catalogue_entry
def fault_reset() -> str:
    return "reset"


@catalogue_entry
def loop_restarted() -> str:
    return "control loop restarted"


@catalogue_entry
def restarted_after_failure() -> str:
    return "after it failed or ended"


@catalogue_entry
def restarted_with_change(*, change: str) -> str:
    return f"with {change}"


@catalogue_entry
def loop_started_with(*, change: str) -> str:
    return f"control loop started with {change}"


@catalogue_entry
def loop_not_started_with(*, change: str) -> str:
    return f"the control loop did not start with {change}"


@catalogue_entry
def drives_switched(*, on: bool) -> str:
    return f"drives switched {'on' if on else 'off'}"


@catalogue_entry
def references_set(*, q_ref: float, S_ref: float) -> str:
    return f"q_ref {Angle(q_ref)}, S_ref {format_number(S_ref, 4)} N·m/rad"


@catalogue_entry
def push_started(*, F_push: float, duration_s: float) -> str:
    return f"push of {F_push:.1f} N for {duration_s:.1f} s"


@catalogue_entry
def push_released() -> str:
    return "push released"


@catalogue_entry
def push_without_operator() -> str:
    return "push released: the operator lost control"


@catalogue_entry
def injected_fault_cleared() -> str:
    return "injected fault cleared"


@catalogue_entry
def fault_injected(*, fault: str) -> str:
    return f"fault injected: {fault}"


@catalogue_entry
def heartbeat_suspended() -> str:
    return "heartbeat of the service suspended for a test"


@catalogue_entry
def obstacle(*, wall: Obstacle | None) -> str:
    if wall is None:
        return "no obstacle"
    side = "above" if wall.side > 0.0 else "below"
    return f"obstacle {side} {Angle(wall.q_wall):.4g}, {wall.k_wall:.4g} N/m, {wall.c_wall:.4g} s/m"


@catalogue_entry
def push_again() -> str:
    return "send it again to push for longer"


@catalogue_entry
def larger_value_not_resolved() -> str:
    return "the integration steps of the simulator do not resolve a larger value"


# Background work -----------------------------------------------------------------------------------


@catalogue_entry
def computation_cancelled() -> str:
    return "the client disconnected: the computation was cancelled"


@catalogue_entry
def own_work_at_limit(*, work: str, works: str, count: int, maximum: int) -> str:
    number = f"{work} of yours is" if maximum == 1 else f"{count} {works} of yours are"
    return f"{number} running or waiting, and the limit is {maximum}: wait until one ends, or cancel one"


@catalogue_entry
def work_at_limit(*, works: str, count: int) -> str:
    return f"too many {works} are running or waiting ({count}): try again later"


@catalogue_entry
def computation_not_started() -> str:
    return "the client disconnected: the computation was not started"


# Commissioning -------------------------------------------------------------------------------------


@catalogue_entry
def plant_is_not_a_rig(*, plant: str) -> str:
    return f"the bring-up requires a rig, but the plant is the {plant}"


@catalogue_entry
def wiring_has_changed() -> str:
    return "the wiring file has changed since the control loop started: restart the service"


@catalogue_entry
def no_step_waits_for_confirmation() -> str:
    return "no step of the bring-up is waiting for a confirmation"


@catalogue_entry
def no_step_in_progress() -> str:
    return "no step of the bring-up is in progress"


@catalogue_entry
def step_is_being_stored(*, title: str) -> str:
    return f"{title} has ended, and the service is storing its result: wait a moment"


@catalogue_entry
def step_occupies_rig(*, title: str) -> str:
    return f"{title} of the bring-up is in progress"


@catalogue_entry
def other_step_in_progress(*, title: str) -> str:
    return f"{title} is in progress"


@catalogue_entry
def run_in_progress(*, run: int) -> str:
    return f"run {run} is in progress"


@catalogue_entry
def mode_is_not_off(*, mode: Mode) -> str:
    return f"the mode is {mode}: switch to off first"


@catalogue_entry
def calibration_of_bring_up() -> str:
    return "the calibration of the bring-up"


@catalogue_entry
def storing_result() -> str:
    return "storing the result"


@catalogue_entry
def loop_disproved_directions(*, detail: str) -> str:
    return f"the control loop stopped: {detail}"


@catalogue_entry
def step_failed(*, title: str, reason: str) -> str:
    return f"{title} of the bring-up failed and must be repeated: {reason}"


@catalogue_entry
def wrong_directions_not_stored(*, title: str, reason: str) -> str:
    return f"Repeat {title}: the service could not store that the directions are wrong ({reason})."


_NOT_YET = "takes effect at the next start of the control loop: repeat the step in mode off, or restart the service"


@catalogue_entry
def result_not_active(*, title: str, reason: str) -> str:
    return f"The result of {title} of the bring-up {_NOT_YET} ({reason})."


@catalogue_entry
def calibration_not_active() -> str:
    return f"the calibration {_NOT_YET}"


# Contact -------------------------------------------------------------------------------------------


@catalogue_entry
def external_force_not_available() -> str:
    return "the external force is not available yet: start pretension, which sets the motors' zeros"


@catalogue_entry
def not_held_in_mode_run(*, duration_s: float) -> str:
    return f"the joint must be held in mode run for {duration_s:g} s"


@catalogue_entry
def bias_or_references_changed(*, duration_s: float) -> str:
    return f"the bias or the references changed less than {duration_s:g} s ago"


@catalogue_entry
def joint_not_at_rest(*, duration_s: float) -> str:
    return f"joint position and stiffness must be at rest for {duration_s:g} s"


@catalogue_entry
def joint_is_pushed() -> str:
    return "a push acts on the joint"


@catalogue_entry
def joint_presses_obstacle() -> str:
    return "the joint presses against an obstacle"


@catalogue_entry
def sweep_not_possible(*, reason: str) -> str:
    return f"the external-force bias cannot be calibrated over S: {reason}"


@catalogue_entry
def no_sweep_to_stop() -> str:
    return "no calibration over S is in progress: there is nothing to stop"


@catalogue_entry
def no_rest_in_sweep(*, S_ref: float, duration_s: float, reason: str) -> str:
    return f"at {format_number(S_ref)} N·m/rad the bias could not be calibrated within {duration_s:g} s: {reason}"


@catalogue_entry
def sweep_in_progress_already() -> str:
    return "the calibration is already in progress"


@catalogue_entry
def run_prevents_sweep(*, run: int, kind: str) -> str:
    return f"run {run} ({kind}) is in progress: wait for its end or abort it"


@catalogue_entry
def sweep_needs_mode_run(*, mode: Mode) -> str:
    return f"the joint must be held in mode run, but the mode is {mode}"


@catalogue_entry
def contact_reaction_is_armed() -> str:
    return "contact reaction is armed: disable it first"


@catalogue_entry
def stiffness_not_reached(*, S: float) -> str:
    return f"the stiffness remains at {S:.2f} N·m/rad and does not reach S_ref"


@catalogue_entry
def estimate_drifts(*, drift_N: float, maximum_N: float) -> str:
    return f"the estimate drifts by {drift_N:.2f} N in half a second, more than the {maximum_N:g} N permitted at rest"


@catalogue_entry
def sweep_in_progress() -> str:
    return "the external-force bias is being calibrated over S: wait until it ends, or stop it"


@catalogue_entry
def sweep_with_other_field() -> str:
    return "sweep cannot be combined with another field: nothing was changed"


@catalogue_entry
def bias_not_measured(*, reason: str) -> str:
    return f"the bias was not calibrated: {reason}"


@catalogue_entry
def contact_reaction_needs_bias() -> str:
    return "contact reaction requires a calibrated external-force bias: hold the joint at rest and calibrate it first"


@catalogue_entry
def contact_threshold_within_noise(*, contact_N: float, std_N: float, factor: float) -> str:
    return (
        f"a contact threshold of {contact_N:g} N is refused: the estimate varies by {Quantity(std_N, 'N'):.4g} "
        f"(standard deviation), and the threshold must be at least {factor:g} times that"
    )


@catalogue_entry
def sweep_stopped_on_request() -> str:
    return "stopped on request"


@catalogue_entry
def sweep_task_cancelled() -> str:
    return "its task was cancelled"


@catalogue_entry
def other_references_set() -> str:
    return "other references were set"


@catalogue_entry
def sweep_without_operator() -> str:
    return "the operator who started it no longer holds control"


@catalogue_entry
def mode_changed_in_sweep(*, mode: Mode) -> str:
    return f"the mode is {mode} now"


@catalogue_entry
def sweep_failed(*, cause: str) -> str:
    return f"The calibration over S failed ({cause}): the points calibrated so far remain. Start it again."


@catalogue_entry
def end_of_failed_sweep(*, cause: str) -> str:
    return f"it failed ({cause})"


@catalogue_entry
def stiffness_of_sweep(*, S_ref: float, restored: bool) -> str:
    purpose = "restored after the calibration" if restored else "to calibrate the external-force bias"
    return f"S_ref {format_number(S_ref, 4)} N·m/rad, {purpose}"


@catalogue_entry
def sweep_ended(*, point: int, points: int, S_ref: float, reason: str) -> str:
    return f"calibration over S ended at point {point} of {points}, {format_number(S_ref)} N·m/rad: {reason}"


@catalogue_entry
def bias_calibrated_over_S(*, points: int) -> str:
    return f"external-force bias calibrated over S at {points} points"


@catalogue_entry
def bias_calibrated(*, points: Sequence[tuple[float, float]]) -> str:
    known = ", ".join(f"{format_number(F)} N at {format_number(S)} N·m/rad" for S, F in points)
    return f"external-force bias calibrated: {known}"


@catalogue_entry
def bias_discarded() -> str:
    return "external-force bias discarded"


@catalogue_entry
def bias_lost_by_restart() -> str:
    return "the control loop was restarted"


@catalogue_entry
def bias_lost_by_zeros() -> str:
    return "the zeros were set again"


@catalogue_entry
def bias_lost_with_loop() -> str:
    return "the control loop died"


@catalogue_entry
def contact_reaction_set(*, contact_N: float) -> str:
    return f"contact reaction armed at {contact_N:g} N" if contact_N else "contact reaction disabled"


@catalogue_entry
def zero_disables_contact_reaction() -> str:
    return "0 N disables contact reaction"


# Event log -----------------------------------------------------------------------------------------


@catalogue_entry
def events_not_stored(*, reason: str, waiting: int, lost: int) -> str:
    and_lost = f", lost: {lost}" if lost else ""
    return f"events cannot be stored: {reason}; waiting in memory: {waiting}{and_lost}"


@catalogue_entry
def later_events_lost(*, count: int) -> str:
    return f"{format_count(count, 'later event')} could not be stored"


@catalogue_entry
def command_refused(*, command: str, reason: str) -> str:
    return f"{command} refused: {reason}"


@catalogue_entry
def refusal_repeated(*, refusal: str, count: int, window_s: float) -> str:
    times = "once" if count == 1 else f"{count} times"
    return f"{refusal} ({times} more in {window_s:g} s)"


@catalogue_entry
def further_commands_refused(*, count: int, window_s: float) -> str:
    commands = "command was" if count == 1 else "commands were"
    return f"{count} further {commands} refused in {window_s:g} s"


# Fault injection -----------------------------------------------------------------------------------


@catalogue_entry
def only_with_virtual_card() -> str:
    return "this fault requires the virtual card: start with --plant rig --virtual-card"


@catalogue_entry
def fault_injection_needs_simulated_plant(*, plant: str) -> str:
    return f"fault injection requires a simulated plant, but the plant is the {plant}"


@catalogue_entry
def fault_needs_virtual_card(*, fault: str) -> str:
    return f"{fault}: {only_with_virtual_card()}"


@catalogue_entry
def press_stop() -> str:
    return "press STOP"


@catalogue_entry
def end_service() -> str:
    return "end the service with Ctrl+C or a signal"


@catalogue_entry
def error_in_program() -> str:
    return "cannot be injected: it is an error in the program"


# Jobs ----------------------------------------------------------------------------------------------


_PAUSE_REMEDY = "an identification with several tensions can be paused between two tensions"


@catalogue_entry
def no_run_to_pause() -> str:
    return f"no run is in progress: {_PAUSE_REMEDY}"


@catalogue_entry
def no_further_run_to_pause() -> str:
    return f"no further run of this request follows: {_PAUSE_REMEDY}"


@catalogue_entry
def motors_switched_off_in_pause() -> str:
    return "the motors were switched off during the pause"


@catalogue_entry
def stopped_softly_in_pause() -> str:
    return "the actuator was stopped softly during the pause"


@catalogue_entry
def tripped_in_pause() -> str:
    return "a fault or STOP stopped the motors during the pause"


@catalogue_entry
def run_prevents_start(*, run: int, kind: str) -> str:
    return f"run {run} ({kind}) is in progress: wait for its end or abort it"


@catalogue_entry
def seed_of_another_simulator(*, seed: int) -> str:
    return f"the simulator of this service runs with seed {seed}; sinew experiment accepts any seed"


@catalogue_entry
def runs_not_started(*, run: int, reason: str, count: int) -> str:
    runs, them = ("1 run was", "it") if count == 1 else (f"{count} runs were", "them")
    return f"The request ended after run {run}: {reason.rstrip('.')}; {runs} not started. Request {them} again."


@catalogue_entry
def run_without_result(*, run: int, reason: str) -> str:
    return f"Run {run} is complete, but {reason}. Evaluate it again."


@catalogue_entry
def run_failed(*, run: int, error: str) -> str:
    return f"Run {run} failed ({error}): any motion of the run was stopped."


@catalogue_entry
def run_without_monitoring(*, run: int) -> str:
    return f"The monitoring of run {run} ended before the run did: any motion of the run was stopped."


@catalogue_entry
def service_ended() -> str:
    return "service ended"


@catalogue_entry
def checked_without_dry_run() -> str:
    return "the experiment was only checked, without a dry run"


@catalogue_entry
def joint_motion_of_excitation() -> str:
    return "Peak-to-peak joint motion caused by the excitation alone"


@catalogue_entry
def peak_voltage_with_limit(*, u_max: float) -> str:
    return f"Peak voltage, limit {u_max:g} V"


@catalogue_entry
def forecast_with_excitation(*, forecast: str, excitation: str) -> str:
    return f"{forecast}; {excitation}"


# Live stream ---------------------------------------------------------------------------------------


@catalogue_entry
def mode_changed(*, before: str, after: str) -> str:
    return f"{before} → {after}"


@catalogue_entry
def pretension_reached() -> str:
    return "pretension reached"


@catalogue_entry
def contact_detected(*, F_ext_hat: float, contact_N: float) -> str:
    return f"contact: {F_ext_hat:.1f} N, threshold of the contact reaction {contact_N:g} N"


@catalogue_entry
def zeros_set_again() -> str:
    return "encoder zeros set again: recalibrate the external-force bias"


@catalogue_entry
def push_released_by_loop(*, reason: str) -> str:
    return f"push released: {reason}"


@catalogue_entry
def tuning_by_program(*, lam_q: float, lam_S: float) -> str:
    return f"by the program: λ_q {lam_q:g} s, λ_S {lam_S:g} s"


@catalogue_entry
def tuning_after_program(*, lam_q: float, lam_S: float) -> str:
    return f"as before the program: λ_q {lam_q:g} s, λ_S {lam_S:g} s"


@catalogue_entry
def obstacle_by_program(*, wall: Obstacle | None) -> str:
    return f"by the program: {obstacle(wall=wall)}"


@catalogue_entry
def plant_answers() -> str:
    return "the plant can be read and written again"


@catalogue_entry
def loop_died(*, reason: str) -> str:
    return f"The control loop died: {reason}"


# Parameters ----------------------------------------------------------------------------------------


@catalogue_entry
def actuator_identification(*, identification: str, kind: str) -> str:
    return f"{identification} is of kind {kind}: build a bank from it"


@catalogue_entry
def identification_not_usable(*, identification: str, verdict: str) -> str:
    return f"{identification} is not usable: {verdict}"


@catalogue_entry
def values_are_active_already(*, identification: str) -> str:
    return f"the values of {identification} are already active: nothing would change"


@catalogue_entry
def no_parameters_to_undo() -> str:
    return "no identified values are applied to the parameter file: there is nothing to undo"


@catalogue_entry
def identification_without_motor(*, run: int | None, side: str) -> str:
    named = "this identification" if run is None else f"run {run}"
    return f"{named} has no K_m and T_m of motor {side}: evaluate it again"


@catalogue_entry
def estimate_without_spring(*, estimate: int, side: str) -> str:
    return f"estimate {estimate} has no spring {side}"


@catalogue_entry
def applied_version_not_accepted(*, reason: str) -> str:
    return f"an applied version of the parameters is no longer accepted: {reason}"


@catalogue_entry
def parameter_file_has_changed() -> str:
    return "the parameter file has changed: restart the service first"


@catalogue_entry
def parameters_not_applicable(*, reason: str) -> str:
    return f"the change cannot be applied: {reason}"


@catalogue_entry
def loop_is_not_running() -> str:
    return "the control loop is not running: press Reset to start it"


@catalogue_entry
def run_prevents_change_of_parameters() -> str:
    return "a run is in progress: change the parameters after its end"


@catalogue_entry
def parameters_need_mode_off(*, mode: Mode) -> str:
    return f"parameters can be applied only in mode off; the mode is {mode}: switch to off first"


@catalogue_entry
def tuning_changed_meanwhile() -> str:
    return "the tuning has changed in the meantime: check it, then try again"


@catalogue_entry
def other_version_is_active(*, active: int, version: int) -> str:
    return f"version {active} is now active, not {version}: check its changes"


@catalogue_entry
def source_of_values(*, kind: str, identification: str) -> str:
    return f"{kind} identification of {identification}"


@catalogue_entry
def applied_parameters(*, undone: bool, run: int, tuning: str) -> str:
    applied = f"the identification of run {run}" if run else "an imported spring table"
    if undone:
        applied = "the previous parameters, because the last identification was undone"
    return f"{applied}{f' (tuning: {tuning})' if tuning else ''}"


# Player --------------------------------------------------------------------------------------------


@catalogue_entry
def plant_is_not_a_replay() -> str:
    return "the plant is not a replay: start one with sinew serve --plant replay --recording FILE"


@catalogue_entry
def replay_takes_no_commands() -> str:
    return (
        "the plant is a replay, which accepts no commands: "
        "use the player on Operate for play, pause, speed and position"
    )


@catalogue_entry
def unknown_mode(*, code: float) -> str:
    return f"mode {code:g}"


# Queue ---------------------------------------------------------------------------------------------


@catalogue_entry
def queue_is_empty() -> str:
    return "the queue is empty: add an experiment first"


@catalogue_entry
def not_in_the_queue(*, item: int) -> str:
    return f"experiment {item} is not in the queue"


@catalogue_entry
def queue_is_full(*, maximum: int) -> str:
    return f"the queue is full: it holds {maximum} experiments; remove one first"


@catalogue_entry
def queue_paused(*, cause: str, waiting: int) -> str:
    remedy = "the queue is empty" if waiting == 0 else "start the queue again to continue with the next experiment"
    return f"paused because {cause}; {remedy}"


@catalogue_entry
def run_not_completed(*, run: int, end_state: str | None) -> str:
    ended = "failed" if end_state is None else f"ended as {end_state.replace('_', ' ')}"
    return f"run {run} {ended}"


@catalogue_entry
def next_experiment_refused(*, reason: str) -> str:
    return f"the next experiment was refused: {reason}"


@catalogue_entry
def removed_experiment_refused(*, reason: str) -> str:
    return f"an experiment that a person has removed meanwhile was refused: {reason}"


@catalogue_entry
def service_was_restarted() -> str:
    return "the service was restarted"


@catalogue_entry
def stored_queue_not_readable(*, reason: str) -> str:
    return f"paused because the stored queue cannot be read: {reason}"


@catalogue_entry
def run_on_command_line() -> str:
    return "run it with `sinew experiment` on the command line"


# State ---------------------------------------------------------------------------------------------


# Links of the safety chain, with the time since their last message, and faults.


@catalogue_entry
def last_heartbeat() -> str:
    return "last heartbeat"


@catalogue_entry
def no_heartbeats() -> str:
    return "no heartbeats: the control loop is not running"


@catalogue_entry
def last_sample() -> str:
    return "last sample"


@catalogue_entry
def no_new_samples() -> str:
    return "no new samples; last sample"


@catalogue_entry
def waiting_for_loop() -> str:
    return "waiting for the control loop"


@catalogue_entry
def loop_restarting(*, purpose: str) -> str:
    return f"restarting {purpose}"


@catalogue_entry
def not_needed_in_replay() -> str:
    return "not needed: the plant is a replay, nothing moves"


@catalogue_entry
def not_monitored(*, plant: str) -> str:
    return f"not monitored by Sinew: {plant} must provide its own"


@catalogue_entry
def no_user_holds_control() -> str:
    return "no user holds control"


@catalogue_entry
def script_holds_control(*, name: str) -> str:
    return f"a script holds control ({name})"


@catalogue_entry
def page_lost(*, name: str) -> str:
    return f"{name} sends no heartbeats: references are held; last message"


@catalogue_entry
def page_holds_control(*, name: str) -> str:
    return f"{name} holds control; last message"


def _describe_drive_enable(enabled: bool) -> str:
    return "drive-enable on" if enabled else "drive-enable off, zero volts"


@catalogue_entry
def watchdog_dead(*, silent_s: float, drives_enabled: bool) -> str:
    return f"dead, no response for {silent_s:.1f} s: {_describe_drive_enable(drives_enabled)}; Reset starts a new one"


@catalogue_entry
def watchdog_expired(*, timeout_s: float, drives_enabled: bool) -> str:
    return f"expired after {timeout_s:g} s without a write: {_describe_drive_enable(drives_enabled)}"


@catalogue_entry
def watchdog_armed(*, drives_enabled: bool) -> str:
    return f"armed, {_describe_drive_enable(drives_enabled)}"


@catalogue_entry
def watchdog_disarmed(*, drives_enabled: bool) -> str:
    return f"disarmed, {_describe_drive_enable(drives_enabled)}"


@catalogue_entry
def safety_module_tripped() -> str:
    return "tripped: motor power is cut"


@catalogue_entry
def safety_module_monitoring() -> str:
    return "monitoring"


@catalogue_entry
def unknown_since_loop_ended(*, state: str) -> str:
    return f"unknown since the control loop ended; last state: {state}"


@catalogue_entry
def unknown_without_loop() -> str:
    return "unknown: no control loop has run yet"


@catalogue_entry
def plant_failing(*, reason: str) -> str:
    return f"the plant cannot be read or written: {reason}"


@catalogue_entry
def trip_of_bring_up(*, fault: str) -> str:
    return f"The bring-up caused this trip: {fault}"


@catalogue_entry
def remedy_for_simulated_safety_module() -> str:
    return (
        "Remove the obstacle or the push that caused the trip, then reset: Reset also "
        "acknowledges the simulated safety module."
    )


# Triggers ------------------------------------------------------------------------------------------


@catalogue_entry
def trigger_is_armed(*, who: str, condition: str) -> str:
    return f"{who} has armed the trigger ({condition}): disarm it first"


@catalogue_entry
def unknown_signal(*, signal: str, nearest: str) -> str:
    return f"there is no signal {signal!r}; the closest name is {nearest}"


@catalogue_entry
def window_without_width() -> str:
    return "the upper end of the window must be above its lower end"


@catalogue_entry
def upper_end_without_window(*, condition: str) -> str:
    return f"a condition {condition} has only one level: omit the upper end"


@catalogue_entry
def trigger_armed(*, condition: str, before_s: float, after_s: float, captures: int) -> str:
    times = "once" if captures == 1 else f"{captures} times"
    return f"trigger armed: {condition}; {before_s:g} s before and {after_s:g} s after, {times}"


@catalogue_entry
def trigger_disarmed() -> str:
    return "trigger disarmed"


@catalogue_entry
def trigger_disarmed_by(*, who: str) -> str:
    return f"{who} disarmed it"


@catalogue_entry
def trigger_disarmed_by_restart(*, condition: str, who: str) -> str:
    return f"trigger disarmed, because the service was restarted: {condition}, armed by {who}"


@catalogue_entry
def trigger_not_stored() -> str:
    return "the service could not store the armed trigger"


# Tuning --------------------------------------------------------------------------------------------


@catalogue_entry
def no_trial_is_active() -> str:
    return "no trial is active: the active tuning is unchanged"


@catalogue_entry
def trial_in_progress() -> str:
    return "a trial is in progress: keep or revert its tuning first"


@catalogue_entry
def nothing_to_undo() -> str:
    return "there is no change of the tuning to undo"


@catalogue_entry
def nothing_to_redo() -> str:
    return "there is no undone change of the tuning to redo"


@catalogue_entry
def rejection_within_noise(*, std_N: float, threshold_N: float, factor: float) -> str:
    return (
        "disturbance rejection is refused: "
        f"the estimate varies by {Quantity(std_N, 'N'):.4g} (standard deviation), "
        f"and the threshold of the rejection, {threshold_N:g} N, must be at least {factor:g} times that"
    )


@catalogue_entry
def starting_run_contains_tuning() -> str:
    return "a run is being started and its record contains the tuning: abort it first"


@catalogue_entry
def run_contains_tuning(*, kind: str) -> str:
    return f"a run of kind {kind} is in progress and its record contains the tuning: abort it first"


@catalogue_entry
def models_in_use(*, bank: tuple[str, int] | None) -> str:
    if bank is None:
        return "geometric gains"
    name, version = bank
    return f"bank {name}, version {version}"


@catalogue_entry
def no_change_of_tuning() -> str:
    return "no change of the tuning"


@catalogue_entry
def tuning_undone(*, difference: str) -> str:
    return f"undone: {difference}"


@catalogue_entry
def tuning_redone(*, difference: str) -> str:
    return f"redone: {difference}"


@catalogue_entry
def tuning_for_run(*, difference: str) -> str:
    return f"for the run: {difference}"


@catalogue_entry
def tuning_after_run(*, difference: str) -> str:
    return f"after the run: {difference}"


@catalogue_entry
def rejection_disabled() -> str:
    return "disturbance rejection disabled: the external-force bias was discarded"


@catalogue_entry
def trial_kept() -> str:
    return "trial kept"


@catalogue_entry
def trial_ended(*, cause: str, difference: str) -> str:
    return f"trial ended {cause}: {difference}" if cause else f"trial ended: {difference}"


@catalogue_entry
def trial_ended_by_mode(*, mode: Mode) -> str:
    return f"because the mode is {mode}"


@catalogue_entry
def trial_ended_by_loop() -> str:
    return "because the control loop ended"


@catalogue_entry
def tuning_of_operator() -> str:
    return "The operator's tuning"


@catalogue_entry
def tuning_before_trial() -> str:
    return "The tuning before the trial"


@catalogue_entry
def tuning_not_restored(*, tuning: str, difference: str, reason: str, retry_s: float) -> str:
    return (
        f"{tuning} ({difference}) could not be restored yet: {reason}. The service retries every "
        f"{retry_s:g} s. If this persists, abort softly and restart the service: it starts with the "
        "operator's tuning."
    )


@catalogue_entry
def tuning_restored(*, who: str, models: str, settings: str) -> str:
    return f"restored as last set by {who}: {models}, {settings}"


@catalogue_entry
def defaults_active(*, reason: str, moved: str) -> str:
    return f"defaults active: {reason}" + (f"; {moved}" if moved else "")


@catalogue_entry
def tuning_of_other_parameters() -> str:
    return "the last tuning belongs to other parameters"


@catalogue_entry
def last_tuning_rejected(*, reason: str) -> str:
    return f"the last tuning is rejected: {reason}"
