"""Messages about tunings: models and λ without gains, loops that no λ makes robust, and remedies."""

from collections.abc import Sequence

from plant import Quantity, catalogue_entry


@catalogue_entry
def not_positive(*, symbol: str, value: float, unit: str) -> str:
    return f"{symbol} = {value:g} {unit} must be finite and above 0 {unit}"


@catalogue_entry
def motor_loop_too_slow(*, lam_motor: float, maximum_s: float) -> str:
    return f"λ_motor = {lam_motor:g} s must stay below 4 T_m = {maximum_s:g} s"


@catalogue_entry
def weight_out_of_range(*, b: float) -> str:
    return f"b = {b:g} is outside 0 to 1"


@catalogue_entry
def single_loop_too_slow(*, symbol: str, lam: float, motor_lags: float, maximum_s: float) -> str:
    return (
        f"the law single-loop requires {symbol} below {motor_lags:g} T_m = {Quantity(maximum_s, 's'):.4g}; it is "
        f"{lam:g} s: choose a smaller {symbol}"
    )


@catalogue_entry
def remedy_for_k_ext() -> str:
    return "0 leaves external forces to the position loop, 1 compensates the whole estimate"


@catalogue_entry
def no_robust_lambda(*, maximum_s: float, M_s: float) -> str:
    return f"no λ up to {maximum_s:g} s keeps M_s at or below {M_s:g}: identify the actuator again"


@catalogue_entry
def no_lambda_for_both_motors(*, minimum_s: float, maximum_s: float) -> str:
    return (
        f"no λ_motor is robust for both motors: one needs at least {Quantity(minimum_s, 's'):.3g}, the other at most "
        f"{Quantity(maximum_s, 's'):.3g}"
    )


@catalogue_entry
def M_s_not_attainable(*, M_s: float, lowest: float, lam_lowest: float, highest: float, lam_highest: float) -> str:
    return (
        f"M_s = {M_s:g} is not attainable with the motor loop: choose {lowest:.3f} (λ = "
        f"{Quantity(lam_lowest, 's'):.3g}) to {highest:.3f} (λ = {Quantity(lam_highest, 's'):.3g})"
    )


@catalogue_entry
def motor_too_quick(*, T_m: float, minimum_s: float) -> str:
    return f"T_m = {T_m:g} s permits no λ_motor of at least {minimum_s:g} s: it may be at most 3.8 T_m"


@catalogue_entry
def no_robust_motor_loop(*, maximum_s: float, M_s: float) -> str:
    return f"no λ_motor up to {maximum_s:g} s keeps M_s of the motor loop at or below {M_s:g}"


@catalogue_entry
def remedy_for_u_plan() -> str:
    return "the remaining voltage is reserved for load, friction and feedback"


@catalogue_entry
def remedy_for_lambda() -> str:
    return "with a smaller λ the loop's sensitivity peak M_s exceeds 1.7 or a step saturates the motor voltage"


@catalogue_entry
def M_s_needs_smaller_lambda(*, M_s: float, symbol: str, lam: float, minimum_s: float) -> str:
    return (
        f"M_s = {M_s:g} requires {symbol} = {lam:.3f} s, but the smallest accepted value is {minimum_s:.3f} s: choose "
        "a smaller M_s"
    )


@catalogue_entry
def step_saturates(*, maximum_s: float, u_max: float) -> str:
    return f"even with λ = {maximum_s:g} s a step requires at least {u_max:g} V: check K_m, T_m and u_max"


# Coupled models ------------------------------------------------------------------------------------


@catalogue_entry
def polynomial_without_coefficients(*, name: str) -> str:
    return f"the polynomial {name} has no coefficients: give at least one"


@catalogue_entry
def coefficient_not_finite(*, name: str, power: int, value: float) -> str:
    return f"the coefficient of s^{power} in {name} is {value:g}, but must be finite: identify the model again"


@catalogue_entry
def denominator_not_normalized(*, name: str, constant: float) -> str:
    return (
        f"the constant coefficient of {name} is {constant:g}, but must be 1: divide the polynomials of this output by "
        "it; a process that integrates has no static gain, and no dynamic decoupling"
    )


@catalogue_entry
def process_not_strictly_proper(*, name: str, order: int) -> str:
    return (
        f"{name} must have a degree below {order}, the order of its output: the loops need a process without direct "
        "feedthrough"
    )


@catalogue_entry
def covariance_of_wrong_shape(*, shape: tuple[int, ...], count: int) -> str:
    return (
        f"the covariance has the shape {shape}, but the numerators have {count} coefficients: give {count} rows and "
        "columns"
    )


@catalogue_entry
def covariance_not_finite(*, count: int) -> str:
    return f"the covariance has values that are not finite ({count}): identify the model again"


@catalogue_entry
def covariance_not_symmetric() -> str:
    return "the covariance is not symmetric: identify the model again"


@catalogue_entry
def covariance_not_positive(*, eigenvalue: float) -> str:
    return (
        f"the covariance, divided by the standard errors, has the negative eigenvalue {eigenvalue:.3g}: identify the "
        "model again"
    )


# Dynamic decoupling --------------------------------------------------------------------------------


@catalogue_entry
def relative_degree_condition(*, element: str, reference: str, difference: float) -> str:
    return (
        f"the relative degree of {element} minus that of {reference} is {difference:g} and must be at least 0: "
        "otherwise the filter differentiates"
    )


@catalogue_entry
def right_half_plane_condition(*, element: str, real_part: float) -> str:
    return f"the rightmost zero of {element} has the real part {real_part:.4g}/s and must be left of 0"


@catalogue_entry
def fast_zero_condition(*, element: str, modulus: float, maximum: float) -> str:
    return (
        f"the fastest zero of {element} has the modulus {modulus:.4g}/s and may have at most {maximum:.4g}/s: a faster "
        "pole of the sampled filter alternates from sample to sample"
    )


@catalogue_entry
def filter_order_condition(*, element: str, order: int, maximum: int) -> str:
    return f"the filter {element} has the order {order} and may have at most {maximum}: identify a model of lower order"


@catalogue_entry
def high_frequency_gain_condition(*, gain: float) -> str:
    return f"|g_12 g_21/(g_11 g_22)| is {gain:.4g} at high frequency and must be below 1"


@catalogue_entry
def sampled_gain_condition(*, gain: float) -> str:
    return f"|g_12 g_21/(g_11 g_22)| reaches {gain:.4g} in the sampled frequency range and must stay below 1"


@catalogue_entry
def algebraic_loop_condition(*, minor: float) -> str:
    return (
        f"the least principal minor of the algebraic loop of both filters is {minor:.4g} and must be above 0: "
        "otherwise limited inputs have no unique solution"
    )


@catalogue_entry
def interconnection_condition(*, modulus: float) -> str:
    return f"the largest pole of both connected filters has the modulus {modulus:.6g} and must be below 1"


@catalogue_entry
def within_standard_errors(*, condition: str, distance: float) -> str:
    return f"{condition}; this is uncertain: {distance:.2g} standard errors of the model reverse it"


@catalogue_entry
def filters_exist(*, uncertain: Sequence[str]) -> str:
    return "; ".join(["the dynamic decoupling exists", *uncertain])


@catalogue_entry
def static_only(*, reasons: Sequence[str], can_swap: bool) -> str:
    remedy = (
        "the other pairing, q with S_c and S with q_c, satisfies all conditions"
        if can_swap
        else "the other pairing does not satisfy all conditions either"
    )
    return "; ".join(["static decoupling only", *reasons, remedy])


@catalogue_entry
def unstable_schedule(*, active: float, modulus: float, minor: float) -> str:
    return (
        f"at the fractional entry {active:.2f} of the bank the filters of the dynamic decoupler have a pole of modulus "
        f"{modulus:.6g} and an algebraic loop with the minor {minor:.4g}; the modulus must be below 1, the minor above "
        "0: add an entry there, or use static decoupling at one of the nearest entries"
    )


@catalogue_entry
def filter_not_finite(*, entry: int) -> str:
    return f"the filters of entry {entry} have coefficients that are not finite: design them again"


@catalogue_entry
def no_entries() -> str:
    return "the schedule of the dynamic decoupler has no entries: identify at least one operating point"


@catalogue_entry
def output_scale_not_positive(*, symbol: str, scale: float) -> str:
    return f"the scale of {symbol} is {scale:g}, but must be finite and above 0"
