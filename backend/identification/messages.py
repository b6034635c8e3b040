"""Messages about identifications: refused records, files and models, methods, verdicts, and notes on a file."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from backend.units import format_percent
from plant import Quantity, catalogue_entry

# Records -------------------------------------------------------------------------------------------


@catalogue_entry
def columns_of_unequal_length(*, name: str, length: int, expected: int) -> str:
    return f"{name} has {length} samples, but u has {expected}: give columns of equal length"


@catalogue_entry
def record_too_short(*, length: int, minimum: int) -> str:
    return f"the record has too few samples ({length}, at least {minimum} are required): record for longer"


@catalogue_entry
def signal_is_not_one_column(*, name: str, dimensions: int) -> str:
    return f"{name} has {dimensions} dimensions, but must have one: give one column per signal"


@catalogue_entry
def samples_not_finite(*, name: str, count: int, first: int) -> str:
    return (
        f"{name} has samples that are not finite ({count}, the first at index {first}): cut the record before or "
        "after them"
    )


@catalogue_entry
def sample_time_out_of_bounds(*, period_s: float, minimum_s: float, maximum_s: float) -> str:
    return (
        f"the sample time is {Quantity(period_s, 's')}, but must be {Quantity(minimum_s, 's', maximum_s)}: give the "
        "sample time in seconds"
    )


@catalogue_entry
def time_does_not_increase(*, duration_s: float, minimum_s: float) -> str:
    return (
        f"the time column does not increase: it spans {Quantity(duration_s, 's')}, but must span at least "
        f"{Quantity(minimum_s, 's')}; give the sample time with --period and set --time none"
    )


@catalogue_entry
def time_step_not_positive(*, sample: int, step_s: float, minimum_s: float, maximum_s: float) -> str:
    return (
        f"the time step after sample {sample} is {Quantity(step_s, 's')}, but must be "
        f"{Quantity(minimum_s, 's', maximum_s)}: the time must increase from row to row; if the resolution of the "
        "time column is too coarse, use --time none with --period"
    )


@catalogue_entry
def samples_missing(
    *, sample: int, gap_s: float, maximum_s: float, start_s: float, before_s: float, after_s: float
) -> str:
    return (
        f"samples are missing: the gap after sample {sample} is {Quantity(gap_s, 's')}, but may be at most "
        f"{Quantity(maximum_s, 's')}; use the part before the gap (--range {start_s:.6g}:{before_s:.6g}) or after it "
        f"(--range {after_s:.6g}:), or use --resample if the gap is short"
    )


@catalogue_entry
def sample_time_differs(*, sample_time_s: float, minimum_s: float, maximum_s: float) -> str:
    return (
        f"the sample time of the time column is {Quantity(sample_time_s, 's')}, but must be "
        f"{Quantity(minimum_s, 's', maximum_s)}: give the sample time of the record, or use --resample"
    )


@catalogue_entry
def signal_is_constant(*, name: str, peak_to_peak: float, minimum: float) -> str:
    return (
        f"{name} is constant: its peak-to-peak value is {peak_to_peak:.6g}, but must be at least {minimum:g}; excite "
        "the input and record again"
    )


@catalogue_entry
def output_is_saturated(*, limit: float, moving_percent: float, maximum_percent: float) -> str:
    return (
        f"the output is saturated: y is at its limit of {limit:.6g} for {Quantity(moving_percent, '%')} of the record "
        f"while u changes, but at most {Quantity(maximum_percent, '%')} is accepted; excite with a smaller amplitude"
    )


# Records of two channels ---------------------------------------------------------------------------


@catalogue_entry
def signal_is_not_two_columns(*, name: str, shape: tuple[int, ...]) -> str:
    return f"{name} has the shape {shape}, but must have two columns, one per channel: give an array of shape (n, 2)"


@catalogue_entry
def inputs_correlated(*, first: str, second: str, correlation: float, lag_s: float, maximum: float) -> str:
    return (
        f"{first} and {second} are not independent: their correlation is {correlation:.2f} at a lag of "
        f"{Quantity(lag_s, 's'):.3g}, but may be at most {maximum:g} in magnitude; excite both channels with different "
        "signals, such as a sequence and the same one half a period later"
    )


@catalogue_entry
def half_period_too_short(*, length: int, memory: int) -> str:
    return (
        f"half a period of the sequence has {length} samples, but must be longer than the memory of the loop of "
        f"{memory} samples: use more bits or longer chips"
    )


@catalogue_entry
def lines_not_resolved(*, lines: int, maximum: int) -> str:
    return f"the multisines have {lines} lines, but the number must be 2 to {maximum}: use fewer lines"


# Models --------------------------------------------------------------------------------------------


@catalogue_entry
def poles_not_stable(*, poles: NDArray[np.complex128]) -> str:
    return f"poles {np.array2string(poles, precision=4)} rad/s are not all in the left half-plane"


@catalogue_entry
def poles_not_resolved(*, poles: NDArray[np.complex128]) -> str:
    return f"poles {np.array2string(poles, precision=4)} rad/s are outside the range that the sample time can resolve"


@catalogue_entry
def unknown_structure(*, name: str, known: str) -> str:
    return f"structure '{name}' does not exist: choose one of {known}"


@catalogue_entry
def coefficients_overflow() -> str:
    return "the coefficients are outside the floating-point range"


@catalogue_entry
def better_structure(
    *, structure: str, dead_time: bool, fit_percent: float, fit_percent_before: float, BIC_gain: float, F: float
) -> str:
    return (
        f"{'a dead time' if dead_time else 'a higher order'} would help: {structure} has a fit of "
        f"{format_percent(fit_percent)} % on the record, while this structure has "
        f"{format_percent(fit_percent_before)} % (BIC lower by {BIC_gain:.3g}, F = {F:.3g})"
    )


@catalogue_entry
def dead_time_with_two_inputs(*, structure: str) -> str:
    return f"{structure} has a dead time, which a model of two inputs cannot have: use a structure without"


@catalogue_entry
def numerator_degree_out_of_range(*, structure: str, degree: int, maximum: int) -> str:
    return f"a numerator of {structure} cannot have the degree {degree}: choose 0 to {maximum}"


# Fits ----------------------------------------------------------------------------------------------


@catalogue_entry
def dead_time_too_long(*, dead_time_s: float) -> str:
    return f"a dead time of {Quantity(dead_time_s, 's'):.3g} exceeds the longest dead time that the search covers"


@catalogue_entry
def simulation_overflows() -> str:
    return "the simulation exceeds the floating-point range"


@catalogue_entry
def equations_overflow() -> str:
    return "the equations exceed the floating-point range"


@catalogue_entry
def no_stable_start(*, structure: str) -> str:
    return f"no stable model of structure {structure} describes the record"


@catalogue_entry
def no_response_to_input() -> str:
    return "the output does not respond to the input"


@catalogue_entry
def closed_loop_unstable() -> str:
    return "the closed loop of model and controller is unstable"


@catalogue_entry
def arx_not_continuous(*, poles: NDArray[np.complex128]) -> str:
    return (
        f"the ARX poles z = {np.array2string(poles, precision=4)} have no stable continuous-time equivalent: filter "
        "more strongly or choose another estimator"
    )


@catalogue_entry
def no_minimum_within(*, structure: str, iterations: int) -> str:
    return f"{structure}: no minimum within {iterations} iterations; try a simpler structure"


@catalogue_entry
def refined_iv_not_converged(*, structure: str, iterations: int) -> str:
    return f"{structure}: refined IV did not converge within {iterations} iterations"


@catalogue_entry
def refined_iv_unstable(*, structure: str) -> str:
    return f"{structure}: refined IV leads to an unstable model"


@catalogue_entry
def dead_time_with_arx(*, structure: str) -> str:
    return f"{structure} has a dead time, which this method cannot estimate: use another method"


@catalogue_entry
def dead_time_with_controller(*, structure: str) -> str:
    return f"{structure} has a dead time, which this method cannot estimate: use --setpoint instead of --controller"


@catalogue_entry
def no_minimum_found(*, structure: str) -> str:
    return f"{structure}: no minimum found; try a simpler structure"


@catalogue_entry
def method_for_one_input_only(*, method: str) -> str:
    return f"the method {method} estimates models of one input only: choose default, srivc, rivc or output_error"


# Methods -------------------------------------------------------------------------------------------


def _name_noise_and_weighting(noise_order: int, is_low_pass: bool) -> str:
    noise = f", AR({noise_order}) noise" if noise_order else ""
    return noise + (", low frequencies weighted" if is_low_pass else "")


@catalogue_entry
def arx_with_prefilter() -> str:
    return "ARX with low-pass prefilter"


@catalogue_entry
def output_error(*, noise_order: int, is_low_pass: bool) -> str:
    return f"output error{_name_noise_and_weighting(noise_order, is_low_pass)}"


@catalogue_entry
def refined_iv_in_closed_loop(*, noise_order: int, is_low_pass: bool) -> str:
    return f"closed-loop {'RIVC' if noise_order else 'SRIVC'}{_name_noise_and_weighting(noise_order, is_low_pass)}"


@catalogue_entry
def least_squares_on_angle() -> str:
    return "least squares on the angle"


@catalogue_entry
def methods_of_channels(*, methods: Mapping[str, str]) -> str:
    return "; ".join(f"{channel}: {method}" for channel, method in methods.items())


# Friction ------------------------------------------------------------------------------------------


@catalogue_entry
def no_friction_model_fits() -> str:
    return "no motor model with Coulomb friction describes the record"


@catalogue_entry
def friction_not_separable() -> str:
    return "gain, time constant and Coulomb friction cannot be separated in this record"


@catalogue_entry
def run_left_out(*, run: int, reason: str) -> str:
    return f"run {run}: {reason}"


@catalogue_entry
def load_friction_without_errors() -> str:
    return "the standard errors could not be computed; record again"


@catalogue_entry
def motor_turned_one_way() -> str:
    return "the motor did not turn in both directions; increase the excitation"


@catalogue_entry
def load_friction_not_separable() -> str:
    return "friction, inertia and load cannot be separated in these records; use a richer excitation"


@catalogue_entry
def voltage_does_not_follow_force() -> str:
    return "the voltage does not increase with the force of the load cell; check the load cell of tendon A"


@catalogue_entry
def too_few_tensions(*, tensions_N: Sequence[float], minimum_distance_N: float) -> str:
    found = ", ".join(f"{one:.3g} N" for one in sorted(tensions_N))
    present = f"the only tensions are {found}" if len(tensions_N) > 1 else f"the only tension is {found}"
    return (
        f"usable runs are required at two tensions at least {minimum_distance_N:g} N apart, but "
        f"{present if tensions_N else 'there are none'}; identify at more tensions"
    )


@catalogue_entry
def run_without_columns(*, missing: Sequence[str]) -> str:
    return f"its record has no {', '.join(missing)}"


@catalogue_entry
def run_not_finite() -> str:
    return "its record has non-finite samples"


@catalogue_entry
def run_too_short(*, length: int, minimum: int) -> str:
    return f"its record has too few samples ({length}, at least {minimum} are required)"


@catalogue_entry
def run_reverses_too_often(*, count: int, minimum: int) -> str:
    return f"motor A turns without reversal in too few samples ({count}, at least {minimum} are required)"


def with_error(value: float, std: float) -> str:
    """Return a value and its standard error as text, to the error's second digit."""
    digits = 1 - int(np.floor(np.log10(std))) if std > 0.0 else 6
    digits = min(max(digits, 0), 9)
    return f"{value:.{digits}f} ± {std:.{digits}f}".replace("-", "−")


@catalogue_entry
def load_friction(*, c0: float, c0_std: float, c1: float, c1_std: float, tensions_N: Sequence[float]) -> str:
    tensions = ", ".join(f"{one:.3g}" for one in tensions_N)
    return (
        f"Coulomb friction of motor A as a function of the load: c0 = {with_error(c0, c0_std)} N·m, c1 = "
        f"{with_error(c1, c1_std)} (c0 + c1 r_m F, ± standard error; runs at {tensions} N)"
    )


@catalogue_entry
def load_friction_not_measured(*, reason: str) -> str:
    return f"Coulomb friction of motor A as a function of the load: not measured, {reason}"


# Verdict of a model --------------------------------------------------------------------------------


@catalogue_entry
def std_errors_within(*, spread_percent: float) -> str:
    return f"standard errors of K and T within ±{spread_percent:.2g} %"


@catalogue_entry
def std_errors_within_with_friction(*, spread_percent: float, friction_percent: float) -> str:
    return (
        f"standard errors of K and T within ±{spread_percent:.2g} %, ±{friction_percent:.2g} % if there is Coulomb "
        "friction below the detection limit of this record"
    )


@catalogue_entry
def fit_on_validation_data(*, fit_percent: float) -> str:
    return f"fit of {format_percent(fit_percent)} % on validation data"


@catalogue_entry
def gain_unlike_geometry(*, error_percent: float) -> str:
    return f"gain deviates by {error_percent:+.1f} % from the geometric gain"


@catalogue_entry
def output_wraps(*, jump: float) -> str:
    return f"the output jumps by {jump:.4g} and back, as a wrapped angle does: unwrap it (numpy.unwrap)"


@catalogue_entry
def output_follows_at_once(*, gain: float, period_s: float) -> str:
    return (
        f"the output follows the input within the same sample (y = {gain:.4g} u + offset), without a time constant "
        f"that the sample time of {period_s:.3g} s could resolve: check that the columns are two different signals, or "
        "sample faster"
    )


@catalogue_entry
def input_of_one_step() -> str:
    return (
        "the input contains only one step, so the record does not show whether the model holds in both directions and "
        "at other amplitudes"
    )


@catalogue_entry
def input_at_limit(*, time_percent: float) -> str:
    return (
        f"the input is at its limit for {time_percent:.1f} % of the time, where the controller does not determine it: "
        "give --setpoint instead of --controller"
    )


@catalogue_entry
def noise_fed_back(*, misfit_percent: float) -> str:
    return (
        "the record comes from a closed loop: the input reacts to the noise of the output, which is not white, so K "
        f"and T may be biased by as much as the share of this noise in the motion, {misfit_percent:.2g} %, regardless "
        "of their standard errors: give --setpoint or --controller"
    )


@catalogue_entry
def output_stops_at_limit(*, limit: float, time_percent: float) -> str:
    return (
        f"the output stops abruptly at its extreme value {limit:.6g}, where it stays for {time_percent:.1f} % of the "
        "time: it is saturated (excite with a smaller amplitude)"
    )


@catalogue_entry
def output_rests_at_limit(*, limit: float, moving_percent: float) -> str:
    return (
        f"the output rests at its extreme value {limit:.6g} for {moving_percent:.1f} % of the time while the input "
        "moves: it is saturated or stuck, or there is a dead time"
    )


@catalogue_entry
def too_little_motion(*, counts: float, minimum: float) -> str:
    return (
        f"too little motion: the output moved by {counts:.1f} counts, but at least {minimum:.0f} are required (use "
        "longer chips or a larger amplitude)"
    )


@catalogue_entry
def friction_in_record(
    *,
    u_c: float,
    K: float,
    K_std: float,
    T: float,
    T_std: float,
    t_d: float,
    K_error_percent: float,
    T_error_percent: float,
) -> str:
    return (
        f"Coulomb friction accounts for {u_c:.3g} (unit of u): with friction in the model, the record gives K = "
        f"{K:.4g} ± {K_std:.2g} and T = {T:.4g} ± {T_std:.2g} s{f' with a dead time of {t_d:.3g} s' if t_d else ''}; "
        f"K and T of this linear model deviate from these values by {K_error_percent:+.1f} % and "
        f"{T_error_percent:+.1f} %"
    )


@catalogue_entry
def output_at_rest(*, fit_all_percent: float) -> str:
    return (
        "fit on validation data not measured, because the output is at rest in the first two thirds or the last third "
        f"of the record; the fit on the whole record is {format_percent(fit_all_percent)} %"
    )


@catalogue_entry
def too_little_motion_for_validation() -> str:
    return (
        "fit on validation data not measured, because the first two thirds or the last third of the record contain too "
        "little motion for a separate model"
    )


@catalogue_entry
def fit_too_low(*, fit_percent: float, minimum_percent: float) -> str:
    return (
        f"fit of {format_percent(fit_percent)} % on validation data, but at least {minimum_percent:.0f} % is required"
    )


@catalogue_entry
def parameter_uncertain(*, parameter: str, std_percent: float) -> str:
    return f"{parameter} has a standard error of ±{std_percent:.3g} %"


@catalogue_entry
def parameter_undetermined(*, parameter: str) -> str:
    return f"standard error of {parameter} not measured: the record does not determine it"


@catalogue_entry
def structure_parameter_uncertain(*, parameter: str, std_percent: float) -> str:
    return f"{parameter} has a standard error of ±{std_percent:.3g} % (choose a simpler structure)"


@catalogue_entry
def structure_parameter_undetermined(*, parameter: str) -> str:
    return f"standard error of {parameter} not measured: the record does not determine it (choose a simpler structure)"


@catalogue_entry
def motion_unexplained(*, misfit_percent: float) -> str:
    return (
        f"{misfit_percent:.1f} % of the motion is explained by neither the model nor the sensor (friction or missing "
        "dynamics), so the model is local: it holds only near this amplitude and operating point"
    )


@catalogue_entry
def residuals_follow_input(*, misfit_percent: float) -> str:
    return (
        f"the residuals ({misfit_percent:.2g} % of the motion) correlate with the input: the model omits an effect "
        "that the standard errors do not cover"
    )


@catalogue_entry
def residuals_not_white(*, misfit_percent: float) -> str:
    return (
        f"the residuals ({misfit_percent:.2g} % of the motion) are not white: the model omits an effect that the "
        "standard errors do not cover"
    )


@catalogue_entry
def entry_not_distinguishable_from_zero(
    *, input: str, output: str, gain: float, gain_std: float, statistic: float, bound: float
) -> str:
    return (
        f"the effect of {input} on {output} is not distinguishable from zero: static gain {gain:.3g} ± {gain_std:.2g}, "
        f"statistic {statistic:.3g} of all coefficients, bound {bound:.3g} at the 1 % level"
    )


@catalogue_entry
def entry_described(*, gain: float, gain_std: float, motion_percent: float, output: str) -> str:
    return f"static gain {gain:.4g} ± {gain_std:.2g}, which causes {motion_percent:.2g} % of the motion of {output}"


@catalogue_entry
def coupling_uncertain(*, output: str, std_percent: float) -> str:
    return f"the standard error of the coupling corresponds to {std_percent:.3g} % of the motion of {output}"


@catalogue_entry
def noise_fed_back_to_input(*, input: str, output: str, misfit_percent: float) -> str:
    return (
        f"the record comes from a closed loop: {input} reacts to the noise of {output}, which is not white, so the "
        f"gains may be biased by as much as the share of this noise in the motion, {misfit_percent:.2g} %, regardless "
        "of their standard errors: give the setpoints or the excitation of the loop"
    )


@catalogue_entry
def pairing_interacts(*, value: float, std: float) -> str:
    return f"the relative gain is {value:.3g} ± {std:.2g}, below 0.5: control each output with the other input"


@catalogue_entry
def pairing_uncertain(*, value: float, std: float) -> str:
    return (
        f"the relative gain is {value:.3g} ± {std:.2g} and may be below 0.5, where the other pairing interacts less: "
        "record for longer"
    )


@catalogue_entry
def reason_of_channel(*, channel: str, reason: str) -> str:
    return f"{channel}: {reason}"


@catalogue_entry
def verdict(*, grade: str, reasons: Sequence[str]) -> str:
    return f"{grade.capitalize()} for tuning: {'; '.join(reasons)}."


@catalogue_entry
def largest_correlation(*, lags: int, deviations: float, critical: float, level_percent: float) -> str:
    return (
        f"largest of {lags} correlations {deviations:.1f} standard deviations, bound {critical:.1f} at the "
        f"{level_percent:g} % level for all lags together"
    )


# Estimation ----------------------------------------------------------------------------------------


@catalogue_entry
def comparison_output_constant() -> str:
    return "the output of the comparison record is constant, so no fit can be computed: use a record with motion"


@catalogue_entry
def structure_not_determined(*, structure: str) -> str:
    return f"{structure}: the record does not determine it; try a simpler structure"


@catalogue_entry
def no_model_of_wrapped_angle(*, structure: str, jump: float, sample: int) -> str:
    return (
        f"{structure}: no model found: the output jumps by {jump:.4g} and back after sample {sample}, as a wrapped "
        "angle does; unwrap it first (numpy.unwrap)"
    )


@catalogue_entry
def no_time_constant(*, structure: str, gain: float) -> str:
    return (
        f"{structure}: no time constant found: the output follows the input within the same sample (y = {gain:.3g} u + "
        "offset): check that the columns are two different signals, or sample faster"
    )


@catalogue_entry
def no_structure_fits(*, reasons: Sequence[str]) -> str:
    return "; ".join(reasons)


# Motor from voltage steps --------------------------------------------------------------------------


@catalogue_entry
def step_too_short(*, length: int, minimum: int) -> str:
    return f"u and theta of the run must have equal length and at least {minimum} samples, but u has {length}"


@catalogue_entry
def step_not_finite(*, name: str, count: int) -> str:
    return f"{name} has samples that are not finite ({count}): repeat the run"


@catalogue_entry
def step_saturates(*, voltage_V: float, maximum_V: float) -> str:
    return (
        f"the voltage is {Quantity(voltage_V, 'V')}, but must stay below {Quantity(maximum_V, 'V')}, where it "
        "saturates: use a smaller step"
    )


@catalogue_entry
def voltage_changes_after_step(*, change_V: float, maximum_V: float) -> str:
    return (
        f"the voltage must step to a constant value other than 0 V, but changes by {Quantity(change_V, 'V')} after "
        f"the step (at most {Quantity(maximum_V, 'V')} is accepted): hold it constant"
    )


@catalogue_entry
def motor_is_loaded(*, force_N: float, maximum_N: float) -> str:
    return (
        f"the tendon loads the motor: its tension is {Quantity(force_N, 'N')}, but must be at most "
        f"{Quantity(maximum_N, 'N')}; step in the direction that slackens the tendon, or detach the tendon"
    )


@catalogue_entry
def motor_hardly_moves(*, counts: float, minimum: float) -> str:
    return (
        f"the motor moves by {Quantity(counts, 'counts')}, but must move by at least {Quantity(minimum, 'counts')}: "
        "use a larger voltage or record for longer"
    )


@catalogue_entry
def too_few_voltages(*, count: int, minimum: int) -> str:
    return (
        f"gain and Coulomb friction cannot be separated: the number of different voltage magnitudes is {count}, "
        f"but must be at least {minimum}; apply steps of several magnitudes"
    )


@catalogue_entry
def no_motor_fits_steps() -> str:
    return "no motor model K_m/(s (T_m s + 1)) fits these runs: check that they are steps from rest"


@catalogue_entry
def step_ends_early(*, duration_s: float, minimum_s: float) -> str:
    return (
        f"the time recorded after the step is {Quantity(duration_s, 's')}, but must be at least "
        f"{Quantity(minimum_s, 's')}: record until the speed is steady"
    )


@catalogue_entry
def motor_turns_backwards() -> str:
    return "the motor turns opposite to its voltage (check the wiring)"


@catalogue_entry
def steps_give_std_errors(*, spread_percent: float) -> str:
    return f"K_m and T_m have standard errors within ±{spread_percent:.2g} %"


@catalogue_entry
def steps_give_no_std_errors() -> str:
    return "K_m and T_m have no measured standard errors"


@catalogue_entry
def steps_give_friction(*, u_c: float) -> str:
    return f"Coulomb friction accounts for {u_c:.3f} V"


@catalogue_entry
def no_friction_found() -> str:
    return "no Coulomb friction found"


@catalogue_entry
def position_fitted(*, counts: float, misfit_percent: float) -> str:
    return f"RMS position error of {counts:.1f} counts, {misfit_percent:.2g} % of the rotation"


# Motor from a record -------------------------------------------------------------------------------


@catalogue_entry
def angle_wraps(*, sample: int, jump: float, maximum: float) -> str:
    return (
        f"the angle wraps: it jumps by {jump:.6g} after sample {sample}, but may change by at most "
        f"{Quantity(maximum, '(unit of y)')}; unwrap it first (numpy.unwrap)"
    )


@catalogue_entry
def angle_at_rest(*, fit_all_percent: float) -> str:
    return (
        "fit on validation data not measured, because the angle is at rest in the first two thirds or the last third "
        f"of the record; the fit on the whole record is {fit_all_percent:.1f} %"
    )


@catalogue_entry
def motor_std_errors_within(*, spread_percent: float) -> str:
    return f"standard errors of K_m and T_m within ±{spread_percent:.2g} %"


@catalogue_entry
def motor_std_errors_not_measured() -> str:
    return "standard errors of K_m and T_m not measured"


@catalogue_entry
def friction_found(*, u_c: float) -> str:
    return f"Coulomb friction accounts for {Quantity(u_c, 'V'):.3g}"


@catalogue_entry
def dead_time_found(*, t_d: float) -> str:
    return f"dead time of {1e3 * t_d:.3g} ms"


@catalogue_entry
def no_dead_time_found() -> str:
    return "no dead time found"


@catalogue_entry
def input_offset_found(*, u_0: float, u_0_std: float) -> str:
    return f"input offset of {Quantity(u_0, 'V'):.3g} ± {Quantity(u_0_std, 'V'):.2g}"


@catalogue_entry
def fit_not_measured() -> str:
    return "fit on validation data not measured"


@catalogue_entry
def weakly_determined(*, quantity: str, std_percent: float, reference: str) -> str:
    return f"the record determines the {quantity} only to ±{std_percent:.2g} % of the {reference}"


@catalogue_entry
def not_separable(*, quantity: str) -> str:
    return (
        f"the {quantity} cannot be separated from gain and time constant in this record: drive the motor with several "
        "voltages"
    )


@catalogue_entry
def motor_residuals_not_white() -> str:
    return "the residuals are not white: this model does not describe all dynamics of the motor"


@catalogue_entry
def no_motor_fits_record() -> str:
    return "no motor model K_m/(s (T_m s + 1)) fits this record: check that its columns are voltage and angle"


# Spring --------------------------------------------------------------------------------------------


@catalogue_entry
def unit_of_load_sweep(*, name: str, unit: str) -> str:
    return (
        f"the unit of '{name}' is '{unit}': the table needs the columns 'x [m]' or 'x [mm]', and 'F [N]', with units "
        "in the heading"
    )


@catalogue_entry
def forces_unlike_elongations(*, forces: int, elongations: int) -> str:
    return (
        f"the number of forces is {forces}, but the number of elongations is {elongations}: give one force per "
        "elongation"
    )


@catalogue_entry
def points_not_finite(*, count: int) -> str:
    return f"some points are not finite ({count}): remove these points"


@catalogue_entry
def too_few_elongations(*, count: int, minimum: int) -> str:
    return f"the number of different elongations is {count}, but must be at least {minimum}: measure more points"


@catalogue_entry
def tendon_pushes(*, force_N: float, minimum_N: float) -> str:
    return (
        f"the smallest force is {Quantity(force_N, 'N')}, but must be at least {Quantity(minimum_N, 'N')}: a tendon "
        "cannot push; check the force sensor"
    )


@catalogue_entry
def lowest_order_suffices(*, order: int, improvement_percent: float, errors_N: Mapping[int, float]) -> str:
    errors = ", ".join(f"{Quantity(error, 'N'):.3g} (order {one})" for one, error in errors_N.items())
    return (
        f"order {order}: no monotonic fit of higher order reduces the cross-validation error by more than "
        f"{improvement_percent:.0f} % ({errors}), and order 2 keeps the decoupler analytic"
    )


@catalogue_entry
def higher_order_is_better(*, order: int, errors_N: Mapping[int, float]) -> str:
    errors = ", ".join(f"{Quantity(error, 'N'):.3g} (order {one})" for one, error in errors_N.items())
    return f"order {order}: its cross-validation error is clearly smaller, {errors}"


# Tables of text ------------------------------------------------------------------------------------


@catalogue_entry
def dates_with_and_without_zone(*, name: str, date: str) -> str:
    return (
        f"some dates of the time column '{name}' have an offset from UTC and some have none, for example '{date}': "
        "write all dates in one time zone"
    )


@catalogue_entry
def not_a_date(*, name: str, cell: str, row: int) -> str:
    return (
        f"the time column '{name}' contains '{cell}' in row {row}: write numbers, or dates in one format such as "
        "2026-03-04T10:20:30.125"
    )


@catalogue_entry
def ambiguous_date(*, name: str, date: str) -> str:
    return (
        f"in '{date}' of the time column '{name}' day and month cannot be distinguished: choose which comes first with "
        "--time-unit dmy or mdy"
    )


@catalogue_entry
def two_decimal_marks(
    *, point: str, point_cell: str, point_line: int, comma: str, comma_cell: str, comma_line: int
) -> str:
    return (
        f"column '{point}' has a decimal point, as '{point_cell}' in line {point_line}, and column '{comma}' a decimal "
        f"comma, as '{comma_cell}' in line {comma_line}: use one decimal mark throughout, or select the columns to "
        "read with --decimal point or --decimal comma"
    )


@catalogue_entry
def ambiguous_decimal_mark(*, name: str, cell: str, line: int, values: Mapping[str, float | None]) -> str:
    readings = " or ".join(f"{value:.10g} with a decimal {mark}" for mark, value in values.items())
    return (
        f"column '{name}' contains '{cell}' in line {line}, which is {readings}: choose with --decimal point or "
        "--decimal comma"
    )


@catalogue_entry
def column_missing(*, name: str, known: Sequence[str], heading_line: int | str | None, notes: Sequence[str]) -> str:
    heading = (
        f" (names in line {heading_line}; --header LINE takes the names from another line)" if heading_line else ""
    )
    return (
        f"there is no column '{name}'; the file has {', '.join(known) or 'no column of numbers'}{heading}"
        f"{''.join(f'; {note}' for note in notes)}"
    )


@catalogue_entry
def no_heading() -> str:
    return "the file contains no heading line with rows of numbers below it"


@catalogue_entry
def ambiguous_heading(*, lines: Sequence[int]) -> str:
    options = " or ".join(f"--header {line}" for line in lines)
    return f"each of the lines {lines[0]} to {lines[-1]} may be the heading: choose one with {options}"


@catalogue_entry
def no_names_above_numbers(*, line: int, columns: int, text: str) -> str:
    return (
        f"line {line}, above the first row of numbers, does not name {columns} columns: '{text}'; give the heading "
        "with --header LINE"
    )


@catalogue_entry
def first_line_holds_numbers() -> str:
    return "the first line contains numbers: insert a line with the column names above it"


@catalogue_entry
def heading_is_empty(*, line: int) -> str:
    return f"line {line} is empty or beyond the end of the file: --header takes the line that names the columns"


@catalogue_entry
def too_many_rows(*, rows: int, maximum: int) -> str:
    return f"the file has {rows} rows, but at most {maximum} are read: shorten it"


@catalogue_entry
def row_of_other_width(*, line: int, columns: int, heading_line: int, expected: int) -> str:
    return (
        f"line {line} has a different number of columns ({columns}) than the heading in line {heading_line} "
        f"({expected}); choose another line as the heading with --header LINE"
    )


@catalogue_entry
def other_decimal_mark(*, name: str, cell: str, line: int, mark: str) -> str:
    return (
        f"column '{name}' contains '{cell}' in line {line}, whose decimal mark differs from that of the table, a {mark}"
    )


@catalogue_entry
def two_columns_of_table(*, name: str) -> str:
    return f"two columns are called '{name}': give one of them another name"


@catalogue_entry
def not_a_number(*, name: str, cell: str, line: int) -> str:
    return f"column '{name}' contains '{cell}' in line {line}, which is not a number"


@catalogue_entry
def heading_repeated(*, name: str, cell: str, line: int) -> str:
    return (
        f"column '{name}' contains '{cell}' in line {line}, which is not a number: the heading is repeated there; "
        "split the file"
    )


@catalogue_entry
def table_of_text() -> str:
    return "text table"


@catalogue_entry
def column_not_selected() -> str:
    return "not selected"


@catalogue_entry
def column_without_name(*, position: int) -> str:
    return f"column {position} has no name and is not read"


@catalogue_entry
def thousands_separated(*, name: str, separator: str) -> str:
    return f"thousands of '{name}' are separated by '{separator}'"


@catalogue_entry
def empty_lines(*, count: int) -> str:
    return f"empty lines between rows: {count}"


@catalogue_entry
def comment_lines_with_numbers(*, count: int) -> str:
    return f"comment lines between rows that contain numbers like a row and are not read: {count}"


@catalogue_entry
def rows_without_value(*, count: int) -> str:
    return f"rows without a value at the end of the file, not read: {count}"


@catalogue_entry
def lines_below_heading(*, count: int) -> str:
    return f"lines between the heading and the first row of numbers, not read: {count}"


# Time of a file ------------------------------------------------------------------------------------


@catalogue_entry
def unknown_time_unit(*, unit: str, known: str) -> str:
    return f"--time-unit {unit}: give one of {known}; for dates dmy or mdy"


@catalogue_entry
def several_time_columns(*, names: Sequence[str]) -> str:
    return f"each of the columns {', '.join(names)} may be the time: choose one with --time COLUMN"


@catalogue_entry
def doubtful_time_column(*, name: str) -> str:
    return (
        f"column '{name}' may or may not be the time: --time {name} uses it as the time; otherwise give the sample "
        "time with --period"
    )


@catalogue_entry
def time_unit_of_dates(*, name: str, cell: str) -> str:
    return f"the time column '{name}' contains '{cell}', which is not a number and has no unit: omit --time-unit"


@catalogue_entry
def date_order_of_numbers(*, name: str, known: str) -> str:
    return f"the time column '{name}' contains numbers, not dates: choose one of {known} for --time-unit"


@catalogue_entry
def rows_without_time(*, name: str, count: int, first_row: int) -> str:
    return (
        f"the time column '{name}' has rows without a time ({count}, the first in row {first_row}): shorten the "
        "file, or give the sample time with --period and set --time none"
    )


@catalogue_entry
def unknown_unit_of_time_column(*, name: str, unit: str, known: str) -> str:
    return f"the time column '{name}' is in '{unit}': this unit is unknown; choose one of {known} with --time-unit"


@catalogue_entry
def no_unit_of_time_column(*, name: str, step: float, known: str, period_s: float | None) -> str:
    other = "; if it is not a time, use --time none with --period" if period_s else ""
    return (
        f"the unit of the time column '{name}', whose values differ by {step:.6g} from row to row, is unknown: give it "
        f"with --time-unit, one of {known}{other}"
    )


@catalogue_entry
def rows_in_reverse_order(*, largest_step_s: float) -> str:
    return f"the rows are in reverse order: the largest time step is {Quantity(largest_step_s, 's')}; reverse the rows"


@catalogue_entry
def time_decreases_after_row(*, row: int, time_s: float, step_s: float, cause: str, skipped: int, rows: int) -> str:
    return (
        f"the time decreases by {Quantity(-step_s, 's')} after row {row} (at {time_s:.6g} s){cause}; use the rows "
        f"before it (--skip {skipped} --take {rows}) or after it (--skip {row})"
    )


@catalogue_entry
def time_decreases(*, sample: int, step_s: float) -> str:
    return f"the time decreases by {Quantity(-step_s, 's')} after sample {sample}, but must not decrease"


@catalogue_entry
def gap_too_long(
    *, sample: int, gap_s: float, maximum_s: float, start_s: float, before_s: float, after_s: float
) -> str:
    return (
        f"the gap after sample {sample} is {Quantity(gap_s, 's')}, but may be at most {Quantity(maximum_s, 's')}: "
        f"use the part before the gap (--range {start_s:.6g}:{before_s:.6g}) or after it (--range {after_s:.6g}:)"
    )


@catalogue_entry
def too_many_resampled(*, count: float, maximum: int) -> str:
    return (
        f"the number of samples after resampling is {Quantity(count, '1')}, but may be at most {maximum}: give a "
        "longer sample time or a --range"
    )


@catalogue_entry
def dates_of_form(*, form: str, has_zone: bool) -> str:
    return f"dates, {form}, with {'an offset from UTC' if has_zone else 'no zone'}"


@catalogue_entry
def time_unit_from_magnitude() -> str:
    return "magnitude of its values, a time since 1970"


@catalogue_entry
def time_unit_assumed() -> str:
    return "assumed, because neither header row nor option states it"


@catalogue_entry
def step_of_time_column(*, is_resampled: bool) -> str:
    return f"{'median' if is_resampled else 'mean'} step of the time column"


@catalogue_entry
def counter_overflows(*, bits: int) -> str:
    return f", as in an overflow of a counter of {bits} bits"


@catalogue_entry
def daylight_saving_ends() -> str:
    return ", as local time does at the end of daylight saving"


@catalogue_entry
def day_begins() -> str:
    return ", as a time of day does at midnight"


# Import --------------------------------------------------------------------------------------------


@catalogue_entry
def not_utf_8(*, file: str) -> str:
    return f"{file} is not text in UTF-8: save it as CSV in UTF-8"


@catalogue_entry
def control_character(*, file: str, line: int, character: str) -> str:
    return f"{file} is not a text table: line {line} contains the control character U+{ord(character):04X}"


@catalogue_entry
def parquet_file() -> str:
    return "Parquet file"


@catalogue_entry
def not_parquet() -> str:
    return "the file is damaged or not a Parquet file"


@catalogue_entry
def two_columns_of_parquet(*, name: str) -> str:
    return f"two columns are called '{name}'"


@catalogue_entry
def unreadable_values(*, name: str, kind: str) -> str:
    return f"column '{name}' contains values of type {kind}, which Sinew does not read"


@catalogue_entry
def dates_not_numbers(*, name: str) -> str:
    return f"column '{name}' contains dates, not numbers"


@catalogue_entry
def values_not_numbers(*, name: str, kind: str) -> str:
    return f"column '{name}' contains values of type {kind}, which are not numbers"


@catalogue_entry
def time_is_a_signal(*, name: str) -> str:
    return f"--time {name}: this column is already used as a signal: name another column"


@catalogue_entry
def time_unit_without_time() -> str:
    return "--time-unit needs a time column: name it with --time COLUMN"


@catalogue_entry
def no_time_column() -> str:
    return (
        "the file has no time column (t, time, timestamp, ...): name it with --time COLUMN, or give the sample time "
        "with --period"
    )


@catalogue_entry
def lines_may_be_missing(*, lines: int) -> str:
    return (
        f"some lines between rows are empty or commented out ({lines}): they may be missing samples, which cannot be "
        "detected without a time column. Delete those lines, or name the time column with --time COLUMN"
    )


@catalogue_entry
def columns_of_file_of_unequal_length(*, name: str, length: int, other: str, expected: int) -> str:
    return f"{name} has {length} samples, but {other} has {expected}: give columns of equal length"


@catalogue_entry
def no_row_selected(*, rows: int, end_s: float) -> str:
    return f"the selection contains no row: the file has {rows} rows from 0 to {end_s:.6g} s"


@catalogue_entry
def rows_not_contiguous(*, row: int) -> str:
    return (
        f"--range selects rows that are not contiguous, because the time decreases after row {row}: choose rows with "
        "--skip and --take"
    )


@catalogue_entry
def resampled_not_finite(*, name: str, count: int, first: int) -> str:
    return (
        f"'{name}' has samples that are not finite ({count}, the first at index {first}): cut the record before or "
        "after them"
    )


# MATLAB file ---------------------------------------------------------------------------------------


_SAVE_COMMANDS = {
    "table": "u = {0}.u; y = {0}.y; save('new.mat', 'u', 'y', '-v7')",
    "timetable": "t = seconds({0}.Properties.RowTimes - {0}.Properties.RowTimes(1)); u = {0}.u; y = {0}.y;"
    " save('new.mat', 't', 'u', 'y', '-v7')",
    "timeseries": "t = {0}.Time; y = {0}.Data; save('new.mat', 't', 'y', '-v7')",
    "Simulink.SimulationOutput": "t = {0}.tout; y = {0}.yout.getElement(1).Values.Data;"
    " save('new.mat', 't', 'y', '-v7')",
    "Simulink.SimulationData.Dataset": "y = {0}.getElement(1).Values.Data; t = {0}.getElement(1).Values.Time;"
    " save('new.mat', 't', 'y', '-v7')",
    "datetime": "t = seconds({0} - {0}(1)); save('new.mat', 't', '-v7', '-append')",
    "duration": "t = seconds({0}); save('new.mat', 't', '-v7', '-append')",
}


@catalogue_entry
def save_command(*, name: str, kind: str) -> str:
    return _SAVE_COMMANDS.get(kind, "u = {0}.u; y = {0}.y; save('new.mat', 'u', 'y', '-v7')").format(name)


@catalogue_entry
def matlab_file() -> str:
    return "MATLAB file"


@catalogue_entry
def matlab_of_version_7_3() -> str:
    return (
        "the file is of MATLAB version 7.3 (HDF5), which Sinew does not read: load it in MATLAB or Octave and save it "
        "again with save('new.mat', 'u', 'y', '-v7'), with the names of its variables in place of u and y"
    )


@catalogue_entry
def not_matlab() -> str:
    return "the file is damaged or not a MATLAB file"


@catalogue_entry
def only_matlab_objects(*, objects: Mapping[str, str], command: str) -> str:
    listed = ", ".join(f"{name} ({kind})" for name, kind in objects.items())
    return (
        f"the MATLAB file contains objects, {listed}, and no numeric vectors: save the columns as vectors in MATLAB, "
        f"as in {command}"
    )


@catalogue_entry
def no_vectors_in_matlab(*, others: Sequence[str]) -> str:
    listed = "; it has " + ", ".join(others) if others else ""
    return f"the MATLAB file contains no numeric vectors{listed}"


@catalogue_entry
def two_values_in_matlab(*, name: str) -> str:
    return f"two values of the file are called '{name}'"


@catalogue_entry
def several_fields(*, name: str, paths: Sequence[str]) -> str:
    return f"'{name}' of the file may be {' or '.join(paths)}: choose one"


@catalogue_entry
def matlab_object_with_columns(*, name: str, kind: str, command: str) -> str:
    return f"'{name}' is a MATLAB object ({kind}): save its columns as vectors, as in {command}"


@catalogue_entry
def matlab_object(*, name: str) -> str:
    return f"'{name}' of the file is a MATLAB object"


@catalogue_entry
def matlab_sparse_matrix(*, name: str) -> str:
    return f"'{name}' of the file is a sparse matrix: save it as full(x)"


@catalogue_entry
def matlab_not_numeric(*, name: str) -> str:
    return f"'{name}' of the file is not a numeric array"


@catalogue_entry
def matlab_text(*, name: str) -> str:
    return f"'{name}' of the file is text"


@catalogue_entry
def matlab_complex(*, name: str) -> str:
    return f"'{name}' of the file is complex: save the real and imaginary parts as separate vectors"


@catalogue_entry
def matlab_nested(*, name: str) -> str:
    return f"'{name}' of the file is a cell array or struct array: save its columns as vectors"


@catalogue_entry
def matlab_scalar(*, name: str) -> str:
    return f"'{name}' of the file is one number, not a column"


@catalogue_entry
def matlab_array(*, name: str, dimensions: int) -> str:
    return f"'{name}' of the file is {'empty' if dimensions == 1 else f'an array of {dimensions} dimensions'}"


@catalogue_entry
def matlab_vector_too_long(*, name: str, length: int, maximum: int) -> str:
    return f"'{name}' of the file is a vector of {length} values, but at most {maximum} are read: shorten it"
