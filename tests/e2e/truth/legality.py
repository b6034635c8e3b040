"""Controls that the page may offer: the mode changes and commands that the service accepts in its state."""

from collections.abc import Mapping

from backend.banks.tuning_settings import TUNING_NAMES
from backend.realtime.contact import PUSH_MODES
from backend.realtime.modes import LEGAL, MOVING, Mode
from backend.tuning.gains import DEVIATIONS, UNSEEN_F
from tests.e2e.page_texts import load_texts
from tests.e2e.truth.findings import Findings
from tests.e2e.truth.moment import MINE, Moment, State

OPERATE = load_texts("pages/operate")

MOVES = {"Pretension": "pretension", "Run": "run", "Compliance": "compliance", "Soft stop": "stopping", "Off": "off"}


def may_command(state: State) -> bool:
    """Return whether the person has control, or obtains it with the first command because it is free."""
    return bool(state[MINE])


def legal_modes(state: State) -> list[str]:
    """Return the modes to which an operator may change from the current mode."""
    mode = Mode(state["mode"])
    if not may_command(state) or not state["link"]["alive"] or (mode is Mode.OFF and state["unready"]):
        return []
    if mode is Mode.PRETENSION and not state["pretension_done"]:
        return ["stopping", "off"]
    paused = state["task"] is not None and state["task"]["phase"] == "paused"
    return [str(one) for one in LEGAL[mode] if not paused or one not in MOVING]


def may_start(state: State, mode: str) -> bool:
    """Return whether a run may start: ``JobManager._require_free`` and the table of modes."""
    return mode in legal_modes(state) and state["task"] is None and state["trial"] is None


def may_retune(state: State) -> bool:
    """Return whether the operator may change the tuning: ``TuningService._require_own``."""
    return may_command(state) and state["own_tuning"] is None


def may_move(state: State) -> bool:
    """Return whether references may be set: ``ModeManager.set_references``."""
    return may_command(state) and state["mode"] in PUSH_MODES and state["touch"]["felt"] is None


def may_reject(state: State) -> bool:
    """Return whether disturbance rejection may be enabled: ``TuningService._require_felt``."""
    points = state["touch"]["learned"]
    return bool(points) and max(point["std_N"] for point in points) <= UNSEEN_F / DEVIATIONS


def offered_on_operate(moment: Moment) -> dict[tuple[str, str], bool]:
    """Return the expected buttons of Operate by region and name, and whether they are enabled."""
    state, saved = moment.state, moment.get("/api/tuning/saved")
    touch, trial, tuning = state["touch"], state["trial"], state["tuning"]
    sweeping = bool(touch["sweep"] and touch["sweep"]["under_way"])
    learned, armed = bool(touch["learned"]), touch["contact_N"] > 0.0
    run, own, mine = state["mode"] == "run", may_retune(state), may_command(state)
    differs = any(saved[name] != tuning[name] for name in TUNING_NAMES if name != "bank")
    changes = OPERATE["tuningChanges"]
    offered = {("Mode", name): mode in legal_modes(state) for name, mode in MOVES.items()}
    offered |= {
        ("Push", "Push"): mine and state["mode"] in PUSH_MODES,
        ("Push", OPERATE["release"]): mine,
        ("Wall", OPERATE["addWall"]): mine,
        ("Wall", OPERATE["removeWall"]): mine,
        ("Touch", OPERATE["updateThreshold" if armed else "enableReaction"]): mine and learned and not sweeping,
        ("Touch", OPERATE["disableReaction"]): mine and armed,
        ("Touch", OPERATE["calibrate"]): mine and run and not sweeping,
        ("Touch", OPERATE["stopCalibration" if sweeping else "calibrateOverS"]): mine
        and (sweeping or (run and not armed and state["task"] is None)),
        ("Touch", OPERATE["clearBias"]): mine and learned and not armed and not sweeping and tuning["k_ext"] == 0.0,
    }
    if trial is None:
        brought_back = saved["k_ext"] == 0.0 or may_reject(state)
        offered[changes, "Revert to saved"] = differs and own and brought_back
        offered[changes, "Save"] = differs
        offered[changes, "Undo change"] = may_step(state, state["earlier"])
        offered[changes, "Redo change"] = may_step(state, state["later"])
    else:
        offered |= {(changes, "Keep"): mine, (changes, "Revert now"): mine}
    for symbol in ("λ_q", "λ_S"):
        offered |= {("Tuning", f"{verb} {symbol}"): own for verb in ("Decrease", "Increase", "Reset")}
    return offered


def may_step(state: State, tuning: State | None) -> bool:
    """Return whether undo or redo to ``tuning`` is possible: ``TuningService.undo`` and ``redo``."""
    if tuning is None or state["trial"] is not None or not may_retune(state):
        return False
    return bool(tuning["k_ext"] == 0.0 or may_reject(state))


def boxes_on_operate(state: State) -> dict[str, bool]:
    """Return the expected state of the boxes, sliders and switches of Operate, by prefix of their names."""
    own = may_retune(state)
    rejects = state["tuning"]["k_ext"] > 0.0
    return {
        "q_ref": may_move(state),
        "S_ref": may_move(state),
        "λ_q": own,
        "λ_S": own,
        "lambda": own,
        "time-optimal": own,
        "Voltage limit": own,
        OPERATE["rejection"]: own and (rejects or may_reject(state)),
        OPERATE["rejectionGain"]: own,
    }


def compared(found: Findings, moment: Moment, offered: Mapping[tuple[str, str], bool]) -> None:
    """Compare each of these buttons with its expected state."""
    for (region, name), should_be in offered.items():
        button = moment.shown.button(name, region)
        if button is None:
            found.append(f"button {name!r} in {region!r}: it is not there, the service would take it: {should_be}")
        else:
            found.same(f"whether {name!r} in {region!r} can be pressed", button.enabled, should_be)
