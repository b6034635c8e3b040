"""Comparison of Operate with the service: curves, references, tuning, obstacle, push, contact, enabled controls."""

import math
import re
from urllib.parse import urlencode

from backend.banks.tuning_settings import TUNING_NAMES
from backend.models.run import MOTIONS, TIME_OPTIMAL
from backend.sample import UNIT_BY_SIGNAL
from tests.e2e.page_texts import load_texts
from tests.e2e.truth.deeds import VOLTAGE_LIMIT
from tests.e2e.truth.findings import Findings
from tests.e2e.truth.legality import boxes_on_operate, compared, may_move, offered_on_operate
from tests.e2e.truth.moment import Moment, State

OPERATE = load_texts("pages/operate")

_TO_SHOWN = {("rad", "°"): 180.0 / math.pi, ("rad/s", "°/s"): 180.0 / math.pi, ("m", "mm"): 1e3, ("s", "ms"): 1e3}
_ROWS = ("λq", "λS", "λmotor", "b", OPERATE["scheduling"], OPERATE["motionRow"], "Uplan", "kext")
_PARTS = tuple(name for name in TUNING_NAMES if name != "bank")


def operate(moment: Moment) -> Findings:
    """Compare everything that Operate shows."""
    found = Findings()
    _curves(found, moment)
    _references(found, moment)
    _tuning(found, moment)
    _previews(found, moment)
    _changes(found, moment)
    _outside(found, moment)
    compared(found, moment, offered_on_operate(moment))
    _boxes(found, moment)
    return found


def _curves(found: Findings, moment: Moment) -> None:
    """Compare the legends with the newest samples since the last update of the page."""
    figures = moment.shown.all["figures"]
    found.same("whether there are charts", bool(figures), True)
    for title, figure in figures.items():
        for signal, text in figure["values"].items():
            factor = _TO_SHOWN.get((UNIT_BY_SIGNAL[signal], figure["unit"]), 1.0)
            found.same(f"unit of {title}", factor != 1.0 or UNIT_BY_SIGNAL[signal] == figure["unit"], True)
            values, absent = moment.of(signal, factor)
            if text is None:
                found.same(f"{signal} in {title} is not there", absent, True)
            elif values is None:
                found.append(f"{signal} in {title}: shown {text!r}, the samples have none")
            else:
                found.figure(f"{signal} [{figure['unit']}] in {title}", text, values)


def _references(found: Findings, moment: Moment) -> None:
    state, shown, angles = moment.state, moment.shown, angles_of(moment)
    read, factor = ("°", 180.0 / math.pi) if angles == "deg" else ("rad", 1.0)
    references = state["references"]
    for name, unit, scale, column in (("q_ref", read, factor, "q"), ("S_ref", "N·m/rad", 1.0, "S")):
        hint = shown.all["refusals"].get(f"refusal-of-{name}", "")
        box, slider = shown.box(f"{name} value [{unit}]"), shown.slider(name)
        found.same(f"whether {name} has a slider", slider is not None, True)
        found.same(f"whether {name} is said to be slack", "slack" in hint, references[name] is None)
        if references[name] is None:
            found.same(f"box of {name}, slack", box.value if box else None, "")
            found.same(f"slider of {name}, slack", slider.value if slider else None, "slack")
            continue
        told = references[name] * scale
        values, _ = moment.of(column, scale)
        among = (
            (told, told) if references["in_force"] or values is None else (min(told, values[0]), max(told, values[1]))
        )
        found.figure(f"box of {name} [{unit}]", box.value if box else None, among)
        if slider is not None and slider.value is not None:
            said = slider.value.removesuffix(unit).rstrip()
            found.figure(f"slider of {name} [{unit}]", said if "e" not in said else f"{float(said):.6f}", among)
        if re.match(r"[-\u22120-9.]+ (…|to) ", hint):  # the range, not a refusal
            found.same(
                f"whether {name} is said to be only measured",
                OPERATE["measuredOnly"] in hint,
                not references["in_force"],
            )


def _tuning(found: Findings, moment: Moment) -> None:
    shown, tuning, angles = moment.shown, moment.state["tuning"], angles_of(moment)
    bank = tuning["bank"]
    told = OPERATE["geometricGains"] if bank is None else f"{bank['name']} v{bank['version']}, {tuning['entry_name']}"
    found.same("bank", shown.all["asides"].get("Tuning", "").strip(), told)
    margins = moment.get(f"/api/tuning/motor?lam_motor={tuning['lam_motor']!r}")
    words, values = motor_loop(tuning["lam_motor"], margins)
    found.sentence("margins of the motor loop", shown.told.get("Motor loop"), words, *values)
    _motion(found, moment)
    rejects, share = shown.box(OPERATE["rejection"]), shown.box(OPERATE["rejectionGain"])
    found.same("whether pushes are rejected", rejects and rejects.value, str(tuning["k_ext"] > 0.0).lower())
    found.same("whether there is a share", share is not None, tuning["k_ext"] > 0.0)
    if share is not None:
        found.figure("share of pushes", share.value, tuning["k_ext"])
    asked = moment.get(_preview_of(moment))
    step = "60°" if angles == "deg" else "1.0472 rad"
    heads = {OPERATE["forecastOfQ"]: ("step_q", OPERATE["stepOfQ"].format(size=step, S="{n}"))}
    heads[OPERATE["forecastOfS"]] = ("step_S", _template("stepOfS"))
    for name, (key, head) in heads.items():
        told = asked[key]
        trajectory = OPERATE["timeOptimalStep"] if asked["motion"] == "time-optimal" else ""
        times = [told["rise_s"], told["settling_s"]]
        reached, settled = ("–" if time is None else "{n}" for time in times)
        words = (
            f"{head}{trajectory}: 90 % after {reached} s, within 2 % after {settled} s, overshoot {{n}} %, "
            "peak {n} of {n} V, tension ≥ {n} N"
        )
        values = [asked["S"]] if key == "step_q" else [told["start"], told["end"]]
        values += [time for time in times if time is not None]
        values += [told["overshoot_percent"], told["u_peak_V"], moment.state["limits"]["u_max"], told["F_min_N"]]
        found.sentence(f"forecast of a step, {key}", shown.told.get(name), words, *values)


def _motion(found: Findings, moment: Moment) -> None:
    """Compare the chosen motion and its voltage limit with its bounds."""
    shown, tuning = moment.shown, moment.state["tuning"]
    for motion in MOTIONS:
        choice = shown.box(motion, "References")
        found.same(
            f"whether {motion} motion is chosen", choice and choice.value, str(tuning["motion"] == motion).lower()
        )
    limit, is_limited = shown.box(VOLTAGE_LIMIT), tuning["motion"] == TIME_OPTIMAL
    found.same("whether there is a voltage limit", limit is not None, is_limited)
    if limit is not None:
        found.figure("voltage limit of the motion [V]", limit.value, tuning["u_plan"])
    hint = shown.all["refusals"].get("refusal-of-u_plan", "")
    if " V. " in hint:  # not a refusal
        bounds = (tuning["u_plan_min"], tuning["u_plan_max"])
        found.sentence("bounds of the voltage limit", hint.partition(" V. ")[0], "{n} to {n}", *bounds)


def motor_loop(lam_motor: float, told: State) -> tuple[str, list[float]]:
    """Return the margins of the motor loop as a template with its values."""
    up, down, phase = told["gain_margin"], told["gain_reduction_margin"], told["phase_margin_deg"]
    rising = "unlimited" if up is None else "{n} ({n} dB)"
    gain = rising if down is None else f"{{n}} to {rising}"
    margins = f"gain margin {gain}, phase margin {'unlimited' if phase is None else '{n}°'}"
    decibels = None if up is None else 20.0 * math.log10(up)
    values = [lam_motor, told["M_s"], *(value for value in (down, up, decibels, phase) if value is not None)]
    return f"Motor loop at λ_motor {{n}} s: M_s {{n}}, {margins}", values


def _preview_of(moment: Moment) -> str:
    """Return the previewed tuning: the active tuning with the staged λ."""
    wanted = {name: moment.state["tuning"][name] for name in ("lam_q", "lam_S", "motion", "u_plan", "k_ext")}
    wanted |= _staged(moment)
    references, limits = moment.state["references"], moment.state["limits"]
    step = 0.01 if references["in_force"] else 0.5
    S_ref = limits["S_min"] if references["S_ref"] is None else references["S_ref"]
    S = min(max(round(round(S_ref / step) * step, 2), limits["S_min"]), limits["S_max"])
    return f"/api/tuning/preview?{urlencode({**wanted, 'S': S})}"


def _staged(moment: Moment) -> dict[str, float]:
    """Return the staged λ, which only the page has; the table shows three decimals."""
    kept: dict[str, float] = moment.shown.all["staged"]
    return {name: float(value) for name, value in kept.items()}


def _previews(found: Findings, moment: Moment) -> None:
    asked = moment.get(_preview_of(moment))
    for symbol, loop in (("λ_q", "position"), ("λ_S", "stiffness")):
        told, said = asked[loop], moment.shown.told.get(f"group {OPERATE['preview'].format(symbol=symbol)}", "")
        if told["M_s"] is not None:
            words = said.partition(OPERATE["sensitivityPeak"])[2].split()
            found.figure(f"M_s of {symbol}", words[0] if words else None, told["M_s"])


def _changes(found: Findings, moment: Moment) -> None:
    """Compare the boxes of λ, and the table of saved, active and staged values."""
    shown, state = moment.shown, moment.state
    tuning, saved, trial = state["tuning"], moment.get("/api/tuning/saved"), state["trial"]
    table = shown.tables.get(OPERATE["tuningTable"], [])
    found.same("names of the table of the tuning", [row[0] for row in table], list(_ROWS))
    for row, name in zip(table, _PARTS, strict=False):
        for column, told in ((1, saved), (2, tuning)):
            _part(found, f"{name} {'saved' if column == 1 else 'in force'}", row[column], name, told[name])
    staged = {name: row[3] for row, name in zip(table, _PARTS, strict=False) if row[3] != "–"}
    found.same("staged λ", staged, {name: f"{value:.3f} s" for name, value in _staged(moment).items()})
    for symbol, name in (("λ_q", "lam_q"), ("λ_S", "lam_S")):
        box, slider = shown.box(f"{symbol} value [s]"), shown.slider(symbol)
        texts = {"box": box.value if box else None, "slider": slider.value if slider else None}
        for what, text in ((what, (said or "").removesuffix(" s")) for what, said in texts.items()):
            if name in staged:
                found.same(f"{what} of {symbol}, staged", text, staged[name].removesuffix(" s"))
            else:
                found.figure(f"{what} of {symbol} [s]", text, tuning[name])
    found.same("whether a trial is told", OPERATE["trial"] in shown.told, trial is not None)
    if trial is not None and OPERATE["trial"] in shown.told:
        left = moment.counting(trial["remaining_s"] + 0.5, down=True)
        words = shown.told[OPERATE["trial"]].rsplit(" in ", 1)
        found.sentence("time of the trial [s]", words[-1], "{n} s", (left[0] - 0.5, left[1] + 0.5))
        found.sentence(
            "what comes back",
            " s".join(words[0].split(" s")[:2]),
            " s".join(_template("trialReverts").split(" s")[:2]),
            trial["lam_q"],
            trial["lam_S"],
        )


def _part(found: Findings, what: str, text: str, name: str, told: float | bool | str) -> None:
    if name == "interpolate":
        found.same(what, text, OPERATE["interpolated" if told else "switched"])
    elif name == "u_plan":
        found.sentence(what, text, "{n} V", float(told))
    elif name.startswith("lam_"):
        found.sentence(what, text, "{n} s", float(told))
    elif name == "motion":
        found.same(what, text, told)
    elif name == "k_ext" and told == 0:
        found.same(what, text, OPERATE["noRejection"])
    else:
        found.figure(what, text, float(told))


def _outside(found: Findings, moment: Moment) -> None:
    """Compare the external force on its cards."""
    state, said, angles = moment.state, moment.shown.all["refusals"], angles_of(moment)
    wall, touch = state["wall"], state["touch"]
    told = said.get("told-of-wall", "")
    found.same(
        "whether a wall is said to stand", told.startswith(OPERATE["wallAbove"].partition("{")[0]), wall is not None
    )
    if wall is not None:
        angle = wall["q_wall"] * (180.0 / math.pi if angles == "deg" else 1.0)
        template = OPERATE["wallAbove" if wall["side"] == "above" else "wallBelow"]
        found.sentence("wall", told, template.format(angle="{n}°" if angles == "deg" else "{n} rad"), angle)
    pushed, _ = moment.of("F_push")
    told, pushing = said.get("refusal-of-push", ""), OPERATE["pushing"].partition("{")[0]
    if pushed is not None and pushed[0] == pushed[1] == 0.0:
        found.same("whether a push is told", told.startswith(pushing), False)
    if told.startswith(pushing) and pushed is not None:
        found.sentence("push", told, _template("pushing"), pushed)
    told, sweep = said.get("told-of-touch", ""), touch["sweep"]
    if touch["felt"]:
        found.sentence("contact", told, _template("contact"), touch["felt"]["F_ext_hat"])
    elif touch["contact_N"] > 0.0:
        found.sentence("threshold of contacts", told, _template("reactionEnabled"), touch["contact_N"])
    elif sweep and sweep["under_way"]:
        found.sentence(
            "calibration over S", told, _template("sweepRunning"), sweep["point"], sweep["points"], sweep["S_ref"]
        )
    rows = moment.shown.tables.get(OPERATE["calibration"], [])
    found.same("number of points that were learned", len(rows), len(touch["learned"]))
    for row, point in zip(rows, touch["learned"], strict=False):
        for text, name in zip(row, ("S", "F", "std_N"), strict=True):
            found.figure(f"{name} that was learned", text, point[name])


def _boxes(found: Findings, moment: Moment) -> None:
    wanted = boxes_on_operate(moment.state)
    controls = [*moment.shown.boxes, *moment.shown.sliders]
    for start, should_be in wanted.items():
        for one in controls:
            if one.name == start or one.name.startswith(f"{start} "):
                found.same(f"whether {one.name!r} can be used", one.enabled, should_be)
    send = moment.shown.button(OPERATE["sendTarget"])
    if send is not None:
        found.same("whether a target can be sent", send.enabled, may_move(moment.state))


def _template(name: str) -> str:
    """Return a text of the page with a number for each of its fields."""
    return re.sub(r"\{\w+\}", "{n}", OPERATE[name])


def angles_of(moment: Moment) -> str:
    """Return the unit of angles that the signed-in person has stored."""
    return str(moment.preferences()["angles"])
