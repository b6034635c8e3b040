"""Messages of the evaluation: unmeasured metrics, runs without a result, rejected comparisons, verdicts, methods."""

from backend.faults import Limit
from backend.units import format_count
from plant import Angle, Quantity, catalogue_entry

# Predictions ---------------------------------------------------------------------------------------


@catalogue_entry
def law_without_prediction(*, law: str) -> str:
    return f"there is no prediction for the law {law}"


@catalogue_entry
def bank_changed_during_run() -> str:
    return "the bank was changed during the run"


@catalogue_entry
def bank_not_readable() -> str:
    return "the active bank is not stored with the run or cannot be read"


# Compliance ----------------------------------------------------------------------------------------


@catalogue_entry
def no_rest_before_push(*, start_s: float, rest_s: float) -> str:
    return f"the first push starts at {start_s:g} s: the offset of the forces requires {rest_s:g} s of rest before it"


@catalogue_entry
def ended_before_push(*, start_s: float) -> str:
    return f"the run ended before or too soon after the first push at {start_s:g} s"


@catalogue_entry
def no_estimated_force() -> str:
    return "this recording has no complete estimate of the external force"


@catalogue_entry
def push_too_weak(*, largest_N: float, minimum_N: float, error_bound_N: float) -> str:
    return (
        f"the largest push was {largest_N:.1f} N: below {minimum_N:g} N, any stiffness meets the bound of "
        f"{error_bound_N:g} N"
    )


@catalogue_entry
def delay_at_search_limit(*, limit_s: float) -> str:
    return f"the RMSE is smallest at {1000 * limit_s:.0f} ms, the upper limit of the search"


# Disturbance and pushes ----------------------------------------------------------------------------


@catalogue_entry
def pushes_not_completed() -> str:
    return "the run ended before the pushes were completed"


@catalogue_entry
def no_push() -> str:
    return "the experiment contains no push"


@catalogue_entry
def no_hold_after_push(*, end_s: float) -> str:
    return f"no hold followed the push that ended at {end_s:g} s"


@catalogue_entry
def not_back_after_push(*, end_s: float, deviation_rad: float, hold_s: float) -> str:
    return (
        f"after the push that ended at {end_s:g} s the joint was still "
        f"{Angle(deviation_rad):.3g} from its reference when the hold ended after {hold_s:g} s"
    )


@catalogue_entry
def all_pushes_impulses() -> str:
    return "all pushes were impulses"


# Holds ---------------------------------------------------------------------------------------------


@catalogue_entry
def no_hold_completed() -> str:
    return "no hold was completed"


# Impact --------------------------------------------------------------------------------------------


@catalogue_entry
def no_hit() -> str:
    return "the joint did not hit an obstacle"


@catalogue_entry
def hits_without_reaction(*, missed: int, hits: int) -> str:
    verb = "was" if missed == 1 else "were"
    return f"{missed} of {hits} hits {verb} not detected or caused no contact reaction"


@catalogue_entry
def contact_reaction_not_enabled() -> str:
    return "the contact reaction was not enabled for any hit"


@catalogue_entry
def hit_without_counterpart(*, S_ref: float, speed: float) -> str:
    return (
        f"the hit at {S_ref:.4g} N·m/rad and {Quantity(speed, 'rad/s'):.3g} has no counterpart without contact reaction"
    )


@catalogue_entry
def hits_of_equal_stiffness(*, S_ref: float) -> str:
    return f"all hits have the same S_ref, {S_ref:.4g} N·m/rad"


@catalogue_entry
def unequal_numbers_of_hits(*, soft: int, stiff: int) -> str:
    return (
        "the comparison needs equal numbers of hits at the lowest and at the highest stiffness, but these are "
        f"{soft} and {stiff}"
    )


@catalogue_entry
def unequal_speeds_of_hits(*, soft: float, stiff: float) -> str:
    return (
        f"hits at {Quantity(soft, 'rad/s'):.3g} and {Quantity(stiff, 'rad/s'):.3g} "
        "cannot be compared: their speeds differ too much"
    )


# Robustness ----------------------------------------------------------------------------------------


@catalogue_entry
def loads_not_completed() -> str:
    return "the run ended before both motors were loaded and released"


@catalogue_entry
def no_motor_angle(*, side: str) -> str:
    return f"a sample of the angle of motor {side} has no valid value"


@catalogue_entry
def motor_moved_too_little(*, side: str, minimum_counts: float) -> str:
    return f"motor {side} moved by less than {minimum_counts:g} encoder counts: increase its load"


@catalogue_entry
def motor_in_limit_cycle(*, side: str, duration_s: float, error_percent: float) -> str:
    return (
        f"motor {side} had not returned to its reference when the load changed again after "
        f"{duration_s:g} s: in the second half of that time the error was up to {error_percent:.0f} % of "
        "its largest deviation, in both directions: a limit cycle, caused by Coulomb friction and integral action"
    )


@catalogue_entry
def motor_not_back(*, side: str, duration_s: float, error_percent: float) -> str:
    return (
        f"motor {side} had not returned to its reference when the load changed again after "
        f"{duration_s:g} s: in the second half of that time the error was up to {error_percent:.0f} % of "
        "its largest deviation, in one direction: hold the load longer, or check whether something blocks the motor"
    )


# Evaluation ----------------------------------------------------------------------------------------
# Criteria, results and runs without one.


@catalogue_entry
def stored_experiment_invalid(*, run_id: int) -> str:
    return f"run {run_id}: its stored experiment cannot be read"


@catalogue_entry
def metric_not_measured(*, metric: str, measures: str, known: str) -> str:
    return f"{metric!r} is not a metric that this experiment measures ({measures}); choose one of {known}"


@catalogue_entry
def not_exactly_one_bound() -> str:
    return "a criterion requires exactly one bound: below or above"


@catalogue_entry
def bound_not_evaluated(*, reason: str) -> str:
    return f"the bound cannot be evaluated: {reason}"


@catalogue_entry
def no_samples_of_program() -> str:
    return "the run contains no samples of its program"


@catalogue_entry
def incomplete_run_without_model(*, end_state: str) -> str:
    return f"no model was estimated: the run ended early ({end_state.replace('_', ' ')})"


@catalogue_entry
def no_model_estimated(*, reason: str) -> str:
    return f"no model was estimated: {reason}"


@catalogue_entry
def session_without_result(*, run: int) -> str:
    return f"run {run} is a session: it has samples but no result"


@catalogue_entry
def run_not_ended(*, run: int) -> str:
    return f"run {run} has not ended: the service evaluates it at its end"


@catalogue_entry
def evaluation_failed(*, error: str, reason: str) -> str:
    return f"{error}: {reason}"


# Frequency responses -------------------------------------------------------------------------------


@catalogue_entry
def no_excitation_completed() -> str:
    return "no excitation of a single reference was completed"


@catalogue_entry
def reference_not_excited(*, signal: str) -> str:
    return f"no excitation of the reference of {signal} alone was completed"


@catalogue_entry
def reference_not_followed(*, signal: str, minimum_gain: float) -> str:
    return f"{signal} did not follow its reference at the lowest frequency line: the gain was below {minimum_gain}"


@catalogue_entry
def bandwidth_above_lines(*, highest_Hz: float) -> str:
    return f"the gain is still above −3 dB at {highest_Hz:.3g} Hz, the highest line: excite higher frequencies"


@catalogue_entry
def bandwidth_below_lines(*, gain: float, lowest_Hz: float) -> str:
    return f"the gain is {gain:.2g} at {lowest_Hz:.3g} Hz, the lowest line: choose a longer period"


@catalogue_entry
def excitation_above_voltage_limit(*, needed_V: float, limit_V: float) -> str:
    return (
        f"the excitation needs a feed-forward voltage of {needed_V:.1f} V, but the limit is {limit_V:g} V: choose a "
        "smaller amplitude"
    )


@catalogue_entry
def predicted_bandwidth_out_of_range() -> str:
    return "the predicted gain stays above −3 dB over the whole frequency range of the prediction"


@catalogue_entry
def no_line_below_predicted_bandwidth(*, lowest_Hz: float) -> str:
    return f"no line lies below the predicted bandwidth: the lowest is {lowest_Hz:.3g} Hz; choose a longer period"


@catalogue_entry
def fewer_than_three_periods() -> str:
    return "the excitation requires at least three periods: the first one contains the initial transient"


@catalogue_entry
def sweep_without_lines() -> str:
    return "a sweep has no lines"


@catalogue_entry
def line_not_periodic(*, variation_percent: float) -> str:
    return f"the response varies by {variation_percent:.0f} % between periods or within its band"


LIMITS = {
    Limit.VOLTAGE_A: "the voltage of motor A was clipped",
    Limit.VOLTAGE_B: "the voltage of motor B was clipped",
    Limit.GOVERNOR: "the reference governor limited the reference",
    Limit.TENSION_FLOOR: "the lower tension limit was active",
    Limit.TENSION_CEILING: "the upper tension limit was active",
    Limit.JOINT_RANGE: "the limit of the joint range was active",
}


@catalogue_entry
def limit_was_active(*, limit: Limit, duration_s: float) -> str:
    return f"{LIMITS[limit]} for {Quantity(duration_s, 's'):.3g}: choose a smaller amplitude"


# Identification ------------------------------------------------------------------------------------


@catalogue_entry
def fewer_samples_than_excitation(*, samples: int, needed: int) -> str:
    return f"the run contains too few samples ({samples}; its excitation has {needed})"


@catalogue_entry
def no_voltage_step() -> str:
    return "the run contains no voltage step"


@catalogue_entry
def motor_not_identified(*, side: str, reason: str, unusable_steps: tuple[str, ...]) -> str:
    return "; ".join([f"motor {side}: {reason}", *unusable_steps])


@catalogue_entry
def name_of_table() -> str:
    return "name of the table"


@catalogue_entry
def content_of_table() -> str:
    return "the table"


@catalogue_entry
def invalid_text(*, part: str, reason: str) -> str:
    return f"{part}: {reason}"


@catalogue_entry
def fewer_samples_than_sweep(*, samples: int, needed: int) -> str:
    return f"the run contains too few samples ({samples}; its sweep has {needed})"


@catalogue_entry
def run_without_excitation() -> str:
    return "the run has no excitation"


@catalogue_entry
def run_not_completed(*, end_state: str) -> str:
    return f"the run was not completed ({end_state.replace('_', ' ')})"


@catalogue_entry
def excitation_samples_missing() -> str:
    return "samples of the excitation are missing"


# Stored identifications ----------------------------------------------------------------------------


@catalogue_entry
def least_squares_on_position() -> str:
    return "least squares on position"


@catalogue_entry
def least_squares_polynomials() -> str:
    return "least-squares polynomials"


@catalogue_entry
def verdict_of_motor(*, side: str, verdict: str) -> str:
    return f"Motor {side}: {verdict}"


@catalogue_entry
def spring_of_side(*, side: str) -> str:
    return f"Spring {side}"


@catalogue_entry
def spring_of_table() -> str:
    return "The table"


@catalogue_entry
def verdict_of_spring(*, name: str, verdict: str) -> str:
    return f"{name}: {verdict}"


@catalogue_entry
def polynomial_decreases(*, order: int) -> str:
    return f"not usable: the polynomial of order {order} decreases between the measured elongations."


@catalogue_entry
def polynomial_deviates(*, order: int, error_N: float, maximum_N: float) -> str:
    return (
        f"not usable: the polynomial of order {order} deviates from a measured pair by {error_N:.2f} N, more than "
        f"{maximum_N:g} N."
    )


@catalogue_entry
def polynomial_usable(*, order: int, error_N: float, hysteresis_N: float | None) -> str:
    hysteresis = "" if hysteresis_N is None else f", loading and unloading differ by {hysteresis_N:.2f} N"
    return f"usable with a polynomial of order {order}, largest error {error_N:.2f} N{hysteresis}."


@catalogue_entry
def friction_of_motor_B_not_measured() -> str:
    return "motor B is held at rest in this experiment, so its friction is not measured"


@catalogue_entry
def run_with_other_plant(*, run: int, newest: int) -> str:
    return f"run {run}: its plant, station or parameters differ from those of run {newest}"


# Curves of identifications -------------------------------------------------------------------------


@catalogue_entry
def kind_without_curves(*, identification: int, kind: str) -> str:
    return f"identification {identification} has the unknown kind {kind!r}: it has no curves"


@catalogue_entry
def voltage_of_step(*, voltage_V: float) -> str:
    return f"{voltage_V:.3g} V"


# Comparison with records ---------------------------------------------------------------------------


@catalogue_entry
def different_kinds(*, estimate_run: int, estimate_kind: str, run: int, run_kind: str) -> str:
    return (
        f"identification {estimate_run} is of kind {estimate_kind}, run {run} of kind {run_kind}: a "
        "model can only be compared with an actuator or motor identification of the same kind"
    )


@catalogue_entry
def compared_run_without_excitation(*, run: int) -> str:
    return f"run {run} has no excitation"


@catalogue_entry
def motor_not_estimated(*, side: str) -> str:
    return f"K_m, T_m or u_c of motor {side} was not estimated: evaluate that run again"


@catalogue_entry
def nothing_to_compare_with() -> str:
    return "the recording contains no data to compare with"


@catalogue_entry
def run_left_out(*, run: int, reason: str) -> str:
    return f"run {run}: {reason}"


@catalogue_entry
def motor_lambda_not_stored() -> str:
    return "λ of the motor loops is not stored with the identification, so no time constant can be predicted"


# Reference steps -----------------------------------------------------------------------------------


@catalogue_entry
def run_ended_early(*, played_s: float, planned_s: float) -> str:
    return f"the run ended after {played_s:.1f} s of {planned_s:.1f} s"


@catalogue_entry
def samples_missing(*, missed: int) -> str:
    return f"the recording lacks {format_count(missed, 'sample')}"


@catalogue_entry
def signal_without_value() -> str:
    return "the signal has no valid value"


@catalogue_entry
def sample_without_value() -> str:
    return "a sample of the signal has no valid value"


@catalogue_entry
def not_settled() -> str:
    return "the signal was not within ±2 % of the step size around its reference at the end of the step's duration"


@catalogue_entry
def still_moving_at_end() -> str:
    return "the signal was still moving at the end of the step's duration"


@catalogue_entry
def both_references_step() -> str:
    return "both references step at once"


@catalogue_entry
def began_away_from_start(*, share: float) -> str:
    percent = f"{100.0 * share:.0f} %".replace("-", "−")
    return f"the signal started at {percent} of the step: the previous motion had not ended"


@catalogue_entry
def moved_at_start(*, share: float) -> str:
    percent = f"{100.0 * share:.0f} %".replace("-", "−")
    return f"just before the step the signal was at {percent} of the step: the previous motion had not ended"


@catalogue_entry
def step_not_reached(*, share: float) -> str:
    percent = f"{100.0 * share:.0f} %".replace("-", "−")
    return f"the signal reached {percent} of the step within its duration"


@catalogue_entry
def other_signal_moved(*, signal: str, deviation: float, unit: str) -> str:
    return (
        f"{signal} was {Quantity(deviation, unit):.2f} from its reference when this step started: "
        "the previous motion had not ended"
    )


@catalogue_entry
def steps_not_measured(*, missing: int, steps: int, start_s: float, reason: str) -> str:
    verb = "was" if missing == 1 else "were"
    return f"{missing} of {steps} steps {verb} not measured; the one at {start_s:g} s: {reason}"


@catalogue_entry
def no_step_completed() -> str:
    return "no such step was completed"


@catalogue_entry
def no_lower_bound_known() -> str:
    return "no lower bound is known for these motors"


@catalogue_entry
def no_rest_after_step(*, rest_s: float, delay_s: float) -> str:
    return f"no step was followed by {rest_s:g} s of rest that began {delay_s:g} s after it settled"
