"""The figures of results: from the declarations beside what computes them, with their equations."""

import importlib
import pkgutil
from dataclasses import fields, is_dataclass

from backend import analysis
from backend.glossary.entry import Entry, Kind

_RMS = "√(1/N Σ ({error})²)"
_DB = "20 log₁₀"

EQUATIONS: dict[str, str] = {
    "rise_q_s": "t(90 %) − t(10 %)",
    "rise_S_s": "t(90 %) − t(10 %)",
    "settling_q_s": "last t with |q − q_ref| > 0.02 |Δq_ref|, from the step",
    "settling_S_s": "last t with |S − S_ref| > 0.02 |ΔS_ref|, from the step",
    "reach_q_s": "t(90 %) − t(step), of the largest |Δq_ref| with ΔS_ref = 0",
    "reach_bound_q_s": "T_m θ'' + θ' = K_m u_max, until θ = 0.9 Δθ",
    "reach_ratio_q": "reach_q_s / reach_bound_q_s",
    "overshoot_q_percent": "100 max(q − q_ref)/Δq_ref, along the step",
    "overshoot_S_percent": "100 max(S − S_ref)/ΔS_ref, along the step",
    "deviation_S": "max |S − S_ref|",
    "deviation_q": "max |q − q_ref|",
    "rmse_q": _RMS.format(error="q − q_ref"),
    "rmse_S": _RMS.format(error="S − S_ref"),
    "min_tension_N": "min(F_A, F_B)",
    "max_tension_N": "max(F_A, F_B)",
    "peak_voltage_V": "max(|u_A|, |u_B|)",
    "u_rest_rms_V": _RMS.format(error="u − mean u"),
    "rmse_raw_N": _RMS.format(error="F_A − F_B + S_ref q/r_j"),
    "stiffness_felt": "−r_j d(F_A − F_B)/dq",
    "largest_push_N": "max |F_A − F_B|",
    "deviation_A_rad": "max |θ_A − θ_A,ref|",
    "deviation_B_rad": "max |θ_B − θ_B,ref|",
    "error_integral_A": "∫ (θ_A,ref − θ_A) dt",
    "error_integral_B": "∫ (θ_B,ref − θ_B) dt",
    "bandwidth_q_Hz": "f with |G(f)| = 1/√2, G = q/q_ref",
    "bandwidth_S_Hz": "f with |G(f)| = 1/√2, G = S/S_ref",
    "resonance_q_dB": f"{_DB} max(1, |G|), G = q/q_ref",
    "resonance_S_dB": f"{_DB} max(1, |G|), G = S/S_ref",
    "lag_q_deg": "−arg(q/q_ref) at the bandwidth",
    "lag_S_deg": "−arg(S/S_ref) at the bandwidth",
    "gain_off_q_dB": f"max |{_DB} |G| − {_DB} |G_predicted||",
    "gain_off_S_dB": f"max |{_DB} |G| − {_DB} |G_predicted||",
    "phase_off_q_deg": "max |arg G − arg G_predicted|",
    "phase_off_S_deg": "max |arg G − arg G_predicted|",
    "push_deviation_q": "max |q − q_ref|",
    "push_deviation_S": "max |S − S_ref|",
    "pushed_peak_q": "max |q − q(before)|",
    "pushed_peak_S": "max |S − S(before)|",
    "pushed_off_percent": "100 max |measured/predicted − 1|",
    "pushed_static_ratio": "max |q − q(before)|/(r_j F/S)",
    "held_q_swing_counts": "(max q − min q)/count",
    "held_q_swing": "max q − min q",
    "held_u_swing_V": "max u − min u",
    "held_S_swing": "max S − min S",
    "peak_force_N": "max |F_wall|",
    "impulse_Ns": "max ∫ |F_wall| dt",
    "K_m_A": "θ/U = K_m/(s (T_m s + 1))",
    "K_m_B": "θ/U = K_m/(s (T_m s + 1))",
    "T_m_A": "θ/U = K_m/(s (T_m s + 1))",
    "T_m_B": "θ/U = K_m/(s (T_m s + 1))",
    "rms_A_N": _RMS.format(error="F_A − F(x_A)"),
    "rms_B_N": _RMS.format(error="F_B − F(x_B)"),
    "q_deviation": "max |q|",
}
"""Of figures whose definition is a formula; what needs a sentence has that alone."""


def figures() -> list[Entry]:
    """Return an entry for each figure that a result may hold; where experiments define it apart, each says its own."""
    meanings: dict[str, dict[str, list[str]]] = {}
    head: dict[str, tuple[str, str]] = {}
    for of, name, label, unit, definition in _declared():
        head.setdefault(name, (label, unit))
        meanings.setdefault(name, {}).setdefault(definition, []).append(of)
    return [_entry(name, *head[name], meanings[name]) for name in head]


def _entry(name: str, label: str, unit: str, meanings: dict[str, list[str]]) -> Entry:
    (first, _), *others = sorted(
        meanings.items(), key=lambda meant: -len(meant[1])
    )  # what most of them mean comes first
    more = tuple((", ".join(dict.fromkeys(of)), definition) for definition, of in others)
    shown = "" if unit == "1" else unit
    source = "docs/experiments.md"
    return Entry(Kind.FIGURE, name, label, first, shown, EQUATIONS.get(name, ""), source, more)


def _declared() -> list[tuple[str, str, str, str, str]]:
    """Return what is declared: of which result, name, label, unit, definition."""
    modules = [
        importlib.import_module(f"{analysis.__name__}.{found.name}") for found in pkgutil.iter_modules(analysis.__path__)
    ]
    return [
        (
            module.__name__.rsplit(".", 1)[1].replace("metrics", "steps").replace("_", " ").capitalize(),
            item.name,
            item.metadata["label"],
            item.metadata["unit"],
            item.metadata["definition"],
        )
        for module in modules
        for kind in vars(module).values()
        if isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module.__name__
        for item in fields(kind)
        if "definition" in item.metadata
    ]
