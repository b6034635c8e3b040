"""Messages about tunings: models and λ without gains, loops that no λ makes robust, and remedies."""

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
