"""Messages about experiments: refused texts and parts, labels of quantities and phases, forecasts and predictions."""

import math

from backend.units import format_count
from plant import Angle, Quantity, catalogue_entry

# Expressions ---------------------------------------------------------------------------------------


@catalogue_entry
def not_a_finite_number(*, expression: float | str, value: object) -> str:
    return f"{expression!r} is {value!r}, which is not a finite number"


@catalogue_entry
def not_a_comparison(*, expression: str, value: object) -> str:
    return f"{expression!r} is {value!r}, which is not a comparison"


@catalogue_entry
def number_too_long() -> str:
    return "a number has more than 308 digits"


@catalogue_entry
def no_value(*, expression: str, reason: str) -> str:
    return f"{expression!r} has no value: {reason}"


@catalogue_entry
def expression_too_long(*, expression: str, maximum: int) -> str:
    return f"{expression[:40]!r}… has {len(expression)} characters, but at most {maximum} are allowed: shorten it"


@catalogue_entry
def not_an_expression(*, expression: str) -> str:
    return f"{expression!r} is not an expression"


@catalogue_entry
def too_many_operations(*, maximum: int) -> str:
    return f"an expression can have at most {maximum} numbers, names and operations: simplify it"


@catalogue_entry
def expression_nested_too_deep(*, maximum: int) -> str:
    return f"an expression can be nested at most {maximum} levels deep: simplify it"


@catalogue_entry
def unknown_name(*, name: str, known: str) -> str:
    return f"{name!r} is not known here; choose one of {known}"


@catalogue_entry
def unsupported_constant(*, value: object) -> str:
    return f"{value!r} is not supported in an expression"


@catalogue_entry
def unsupported_operation(*, operation: str, functions: str) -> str:
    return (
        f"{operation[:60]!r} is not supported; supported are + - * / % **, comparisons, and, or, not, if else, "
        f"{functions}"
    )


@catalogue_entry
def rounding_to_other_digits(*, maximum: int) -> str:
    return f"round takes a whole number of digits from -{maximum} to {maximum}"


@catalogue_entry
def not_evaluated() -> str:
    return "the expression cannot be evaluated"


# Places --------------------------------------------------------------------------------------------


@catalogue_entry
def at_place(*, line: int | None, place: str, reason: str) -> str:
    return ": ".join(part for part in (f"line {line}" if line else "", place, reason) if part)


# Settings ------------------------------------------------------------------------------------------


@catalogue_entry
def setting_name_taken(*, name: str) -> str:
    return f"{name!r} is a reserved name or the name of another setting: choose another name"


@catalogue_entry
def invalid_default(*, name: str, default: object, reason: str) -> str:
    return reason


@catalogue_entry
def unknown_setting(*, known: str) -> str:
    return f"unknown setting; choose one of {known}"


@catalogue_entry
def value_of_setting(*, name: str, value: object) -> str:
    return f"{name} is {value}"


@catalogue_entry
def rule_not_satisfied(*, rule: str, values: str, remedy: str) -> str:
    return f"{rule} is not satisfied ({values}): {remedy}"


@catalogue_entry
def default_not_a_choice(*, default: object) -> str:
    return f"the default {default!r} is not one of its choices"


@catalogue_entry
def setting_without_bounds(*, name: str) -> str:
    return f"{name} needs a minimum and a maximum"


@catalogue_entry
def default_not_whole(*, default: object) -> str:
    return f"the default {default!r} is not a whole number"


# Text ----------------------------------------------------------------------------------------------


@catalogue_entry
def anchor_or_alias() -> str:
    return "anchors and aliases are not supported: write the parts out, or use repeat"


@catalogue_entry
def unsupported_tag(*, tag: str) -> str:
    return f"the tag {tag} is not supported"


@catalogue_entry
def text_too_long(*, characters: int, maximum: int) -> str:
    return f"it has {characters} characters, but at most {maximum} are allowed: shorten it"


@catalogue_entry
def not_yaml_or_json(*, reason: str) -> str:
    return f"it is neither YAML nor JSON: {reason}"


@catalogue_entry
def not_an_experiment() -> str:
    return "an experiment must be a mapping with format, name, title and phases"


@catalogue_entry
def unknown_format(*, value: object, known: int) -> str:
    return f"{value!r} is not a known format: this version of Sinew reads format {known}"


@catalogue_entry
def not_json(*, reason: str) -> str:
    return f"it is not JSON: {reason}"


@catalogue_entry
def text_nested_too_deep(*, maximum: int) -> str:
    return f"it is nested more than {maximum} levels deep"


@catalogue_entry
def key_not_a_text(*, key: object) -> str:
    return f"the key {key!r} is not text"


@catalogue_entry
def key_given_twice() -> str:
    return "the key is given twice"


@catalogue_entry
def too_many_digits(*, number: str) -> str:
    return f"{number[:24]}… has too many digits for a whole number"


@catalogue_entry
def unsupported_scalar(*, value: str, tag: str) -> str:
    return f"{value[:40]!r} with the tag {tag} is not supported"


# Keys ----------------------------------------------------------------------------------------------


@catalogue_entry
def unknown_part(*, name: str, known: str) -> str:
    return f"{name!r} is not a kind of part; choose one of {known}"


@catalogue_entry
def part_without_do() -> str:
    return "a part needs `do`, which names its kind"


@catalogue_entry
def key_missing() -> str:
    return "it is missing"


@catalogue_entry
def unknown_key() -> str:
    return "this key is not allowed here"


@catalogue_entry
def list_is_empty() -> str:
    return "it is empty: add at least one item"


@catalogue_entry
def invalid_name() -> str:
    return "use at most 40 letters, digits and _, a letter first"


@catalogue_entry
def invalid_value(*, error_type: str, reason: str) -> str:
    return reason


# Formulas ------------------------------------------------------------------------------------------


@catalogue_entry
def invalid_formula_name(*, name: str) -> str:
    return (
        f"{name!r} is not a valid name of a formula: use 1 to 20 letters, digits and _, a letter "
        "first, and no keyword or name of a signal, function or constant"
    )


@catalogue_entry
def formula_without_signal(*, expression: str, known: str) -> str:
    return f"{expression!r} contains no signal; choose among {known}"


@catalogue_entry
def wrong_number_of_arguments(*, function: str, minimum: int, maximum: int, count: int) -> str:
    expected = format_count(minimum, "value") if minimum == maximum else f"{minimum} to {maximum} values"
    return f"{function} takes {expected}, but got {count}"


@catalogue_entry
def unsupported_in_formula(*, operation: str, functions: str) -> str:
    return (
        f"{operation[:60]!r} is not supported; supported are + - * / % **, comparisons, and, or, not, if else, "
        f"{functions}"
    )


@catalogue_entry
def unknown_signal(*, name: str, nearest: str) -> str:
    return f"there is no signal {name!r}; the closest name is {nearest}"


# Parts ---------------------------------------------------------------------------------------------


@catalogue_entry
def not_a_whole_number(*, value: float) -> str:
    return f"{value:g} is not a whole number"


@catalogue_entry
def calibration_within_contact() -> str:
    return "parts that a contact ends cannot contain a part `do: learn`: move it before them"


@catalogue_entry
def contact_within_contact() -> str:
    return "parts that a contact ends cannot contain such parts again: remove the inner ones"


@catalogue_entry
def bias_not_calibrated() -> str:
    return (
        "the bias of the external force is not calibrated before this part: add a part `do: "
        "learn` before it, at this stiffness"
    )


@catalogue_entry
def bias_not_calibrated_at(*, S: float, calibrated_S: tuple[float, ...]) -> str:
    known = ", ".join(f"{value:.4g}" for value in calibrated_S)
    return (
        f"at {S:.4g} N·m/rad the bias of the external force is not calibrated, only at "
        f"{known}: add a part `do: learn` at this stiffness"
    )


@catalogue_entry
def too_many_contact_changes(*, maximum: int) -> str:
    return f"at most {maximum} changes of the contact reaction are allowed: split the experiment"


@catalogue_entry
def phase_name_taken() -> str:
    return "another phase has this name: choose a unique one"


@catalogue_entry
def no_motion_after_tuning() -> str:
    return "no motion follows this change of the tuning: remove it"


@catalogue_entry
def no_motion_after_obstacle() -> str:
    return "no motion follows this change of the obstacle: remove it"


@catalogue_entry
def no_motion_after_calibration() -> str:
    return "no motion follows this calibration of the external force: remove the calibration"


@catalogue_entry
def no_motion() -> str:
    return "the experiment contains no motion: add one"


@catalogue_entry
def too_many_parts(*, maximum: int) -> str:
    return f"at most {maximum} parts are allowed, including repetitions: remove some"


@catalogue_entry
def crest_defined_twice() -> str:
    return "amplitude and reference both define the crest: remove one of them"


@catalogue_entry
def fewer_lines_or_longer_period(*, maximum_Hz: float) -> str:
    return f"choose fewer lines or a longer period, so that it is at most {maximum_Hz:g} Hz"


@catalogue_entry
def too_many_tunings(*, maximum: int) -> str:
    return f"at most {maximum} changes of the tuning are allowed: split the experiment"


@catalogue_entry
def reference_beyond_obstacle(*, q_ref: float, q_wall: float) -> str:
    return (
        f"the joint reference is {Angle(q_ref):.4g}, which is not in front of the obstacle "
        f"at {Angle(q_wall):.4g}: move the reference away from the obstacle first"
    )


@catalogue_entry
def too_many_obstacles(*, maximum: int) -> str:
    return f"at most {maximum} changes of the obstacle are allowed: split the experiment"


@catalogue_entry
def setting_without_choices(*, name: str) -> str:
    return f"{name!r} is not a setting with choices"


@catalogue_entry
def choices_without_parts(*, choices: str) -> str:
    return f"define parts for exactly these choices: {choices}"


@catalogue_entry
def index_name_taken(*, name: str) -> str:
    return f"{name!r} is already in use: choose another name for the index"


@catalogue_entry
def push_during_motion(*, measure: str) -> str:
    return f"{measure} measures pushes from rest: use a part `do: push`"


@catalogue_entry
def no_centre() -> str:
    return "the centre of the oscillation is not defined: begin with a step"


@catalogue_entry
def too_many_segments(*, maximum: int) -> str:
    return f"the number of segments exceeds {maximum}, including repetitions: repeat less, or split the experiment"


@catalogue_entry
def remove_some_parts() -> str:
    return "remove some parts"


# Labels of checked quantities ----------------------------------------------------------------------


@catalogue_entry
def amplitude_of_q_ref(*, centre: float) -> str:
    return f"amplitude of q_ref around {Angle(centre):.6g}" if centre else "amplitude of q_ref"


@catalogue_entry
def amplitude_of_S_ref(*, centre: float) -> str:
    return f"amplitude of S_ref around {centre:.6g} N·m/rad"


@catalogue_entry
def duration_of_chips() -> str:
    return "total duration of the chips"


@catalogue_entry
def duration_of_periods() -> str:
    return "total duration of the periods"


@catalogue_entry
def highest_frequency() -> str:
    return "highest frequency"


@catalogue_entry
def duration_of_calibration() -> str:
    return "duration of the calibration at rest"


@catalogue_entry
def contact_threshold() -> str:
    return "contact threshold"


@catalogue_entry
def contact_threshold_or_none() -> str:
    return "contact threshold (0 for none)"


@catalogue_entry
def duration_up_to_part() -> str:
    return "total duration up to this part"


@catalogue_entry
def label_in_segment(*, segment: int, label: str) -> str:
    return f"segment {segment}, {label}"


# Library -------------------------------------------------------------------------------------------


@catalogue_entry
def no_recorded_references() -> str:
    return "the recording contains no references, so nothing can be repeated"


@catalogue_entry
def gap_in_references() -> str:
    return "the recorded references have a gap: the commands within it are unknown"


@catalogue_entry
def too_many_recorded_parts(*, maximum: int) -> str:
    return (
        f"the recorded references need more than {maximum} holds and ramps, the maximum "
        "of an experiment: build the experiment from parts"
    )


@catalogue_entry
def program_in_unknown_form() -> str:
    return "the program of the run is not stored in a known form"


@catalogue_entry
def not_a_list_of_segments(*, meaning: str) -> str:
    return f"it must be a {meaning}"


@catalogue_entry
def unknown_experiment(*, known: str) -> str:
    return f"there is no such experiment; known: {known}"


@catalogue_entry
def own_sequence_title() -> str:
    return "Own sequence"


@catalogue_entry
def own_sequence_description() -> str:
    return "Steps, ramps and sines of both references, one after the other, as a JSON list of segments."


@catalogue_entry
def own_sequence_replacement() -> str:
    return "write an experiment: its parts step, ramp and sine take the same numbers (docs/how-to/experiments.md)"


@catalogue_entry
def actuator_identification_description() -> str:
    return "Response of joint position and stiffness to motor A in closed loop: a binary sequence at a held tension."


@catalogue_entry
def motor_identification_description() -> str:
    return "Gain, time constant and Coulomb friction of both motors: voltage steps up and down with slack tendons."


@catalogue_entry
def spring_identification_description() -> str:
    return "Force versus elongation of both springs: a slow sweep of both tensions up and down."


# Plans ---------------------------------------------------------------------------------------------


@catalogue_entry
def unknown_law(*, law: object, known: str) -> str:
    return f"{law!r} is not a control law; choose one of {known}"


@catalogue_entry
def keep_below_largest_step() -> str:
    return "keep it below the largest voltage step"


@catalogue_entry
def shorter_excitation() -> str:
    return "choose a shorter chip, fewer bits or fewer periods"


@catalogue_entry
def voltage_step(*, voltage_V: float) -> str:
    return f"Step to {voltage_V:g} V"


@catalogue_entry
def hold_at_lowest_tension() -> str:
    return "Hold at the lowest tension"


@catalogue_entry
def tension_sweep(*, direction: str) -> str:
    return f"Tension {direction}"


@catalogue_entry
def hold_without_excitation() -> str:
    return "Hold of the tension without excitation"


@catalogue_entry
def excitation() -> str:
    return "Excitation"


# Forecasts and predictions -------------------------------------------------------------------------


@catalogue_entry
def set_point(*, value: float, unit: str) -> str:
    return f"{value:g} {unit}".replace("-", "−")


@catalogue_entry
def joint_will_move(*, q_start: float, q_low: float, q_high: float, let_slack: bool) -> str:
    at, low, high = (math.degrees(q) for q in (q_start, q_low, q_high))
    within = f"{math.floor(low)} to {math.ceil(high)}°".replace("-", "−")
    words = f"the joint is at {at:.0f}° and will move within {within}, then back to 0°".replace("-", "−")
    return words + ("; it is free while the tendons are slack" if let_slack else "")


@catalogue_entry
def joint_position_during_motion() -> str:
    return "joint position during the motion"


@catalogue_entry
def tension_during_motion() -> str:
    return "tension during the motion"


@catalogue_entry
def lower_tension_or_smaller_amplitude() -> str:
    return "choose a lower tension or a smaller amplitude"


@catalogue_entry
def higher_tension_or_smaller_amplitude() -> str:
    return "choose a higher tension or a smaller amplitude: a tendon would go slack"


@catalogue_entry
def excitation_slackens_tendon() -> str:
    return "a tendon would go slack: use a smaller amplitude or a higher tension"


@catalogue_entry
def excitation_saturates(*, u: float, u_max: float) -> str:
    return (
        f"the motors would need {u:.1f} V, but at most {u_max:g} V is available: use a smaller amplitude or a longer "
        "chip"
    )


@catalogue_entry
def excitation_moves_too_little(*, counts: float, minimum: float) -> str:
    return (
        f"not enough motion: {counts:.1f} encoder counts are expected, but at least {minimum:g} are required: use a "
        "longer chip or a larger amplitude"
    )


@catalogue_entry
def steps_saturate(*, u_high: float, u_max: float) -> str:
    return f"steps to {u_high:g} V saturate at {u_max:g} V: lower u_high"


@catalogue_entry
def step_too_short(*, u_high: float, duration_s: float, lags: float, T_m: float) -> str:
    return (
        f"the step to {u_high:g} V ends after {duration_s:.2f} s, before its speed is steady "
        f"({lags:g} T_m = {lags * T_m:.2f} s): lower u_high, or raise travel_rad and step_s"
    )


@catalogue_entry
def sweep_close_to_trip(*, F_high: float, margin_N: float, F_max: float) -> str:
    return f"F_high = {F_high:g} N is within {margin_N:g} N of the trip at {F_max:g} N: lower it"


@catalogue_entry
def excitation_moves_joint(*, counts: float) -> str:
    return f"the excitation alone moves the joint by {counts:.0f} encoder counts, peak to peak"


@catalogue_entry
def motors_will_turn(*, speed: float, travel_rad: float) -> str:
    return (
        f"both motors will reach {Quantity(speed, 'rad/s'):.4g} with slack tendons, turning by {Angle(travel_rad):g} "
        "per step"
    )


@catalogue_entry
def tensions_will_sweep(*, F_low: float, F_high: float, cycles: int) -> str:
    return f"both tensions will go from {F_low:g} to {F_high:g} N and back, {format_count(cycles, 'time')}"


# Labels of predicted values ------------------------------------------------------------------------


@catalogue_entry
def fastest_speed() -> str:
    return "Fastest speed"


@catalogue_entry
def largest_rotation() -> str:
    return "Largest rotation, slack side"


@catalogue_entry
def largest_step(*, u_max: float) -> str:
    return f"Largest step, limit {u_max:g} V"


@catalogue_entry
def shortest_step() -> str:
    return "Shortest step"


@catalogue_entry
def smallest_elongation() -> str:
    return "Smallest elongation"


@catalogue_entry
def largest_elongation() -> str:
    return "Largest elongation"


@catalogue_entry
def largest_stiffness() -> str:
    return "Largest stiffness"


@catalogue_entry
def mean_rate_of_tension() -> str:
    return "Mean rate of change of the tension"


@catalogue_entry
def obstacles_require_tendons() -> str:
    return "an obstacle requires an actuator with tendons: its largest damping follows from the largest tension"
