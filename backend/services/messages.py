"""Messages about commands and runs in progress: refusals, and why something cannot be done now."""

from collections.abc import Sequence

from backend.realtime import Mode
from backend.units import format_number
from plant import Quantity, catalogue_entry

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
