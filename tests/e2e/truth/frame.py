"""Comparison of the frame around every page: plant, mode, timing, link, control, status line, STOP."""

from tests.e2e.page_texts import load_texts
from tests.e2e.truth.findings import Findings
from tests.e2e.truth.moment import Moment, State

TEXTS = load_texts("components")

BADGES = {"simulator": "SIM", "rig": "RIG", "virtual_card": "VIRTUAL CARD", "replay": "REPLAY"}
CALM = {
    "off": TEXTS["statusOff"],
    "pretension": TEXTS["statusPretension"],
    "run": TEXTS["statusRun"],
    "compliance": TEXTS["statusCompliance"],
    "stopping": TEXTS["statusStopping"],
}


def around_the_page(moment: Moment) -> Findings:
    """Compare the elements that every page shows."""
    found, shown, state = Findings(), moment.shown, moment.state
    plant = state["plant"]
    word = BADGES.get(plant["kind"], plant["name"])
    found.same("badge of the plant", shown.all["badge"], [word, plant["name"].capitalize()])
    found.same("badge of a viewer", "Viewer" in shown.all["images"], False)
    found.same("mode", shown.told.get("Mode"), state["mode"])
    found.same("whether the mode is marked as old", shown.all["stale"], "false")
    found.same("link", shown.all["link"], "live")
    _timing(found, moment)
    _control(found, moment)
    _status_line(found, moment)
    _stop(found, moment)
    return found


def _timing(found: Findings, moment: Moment) -> None:
    """Compare rate, lateness and overruns, each with its label."""
    shown = [text.split(" ") for text in moment.shown.all["metrics"]]
    told = (
        ("rate", "kHz", "rate_Hz", 1e-3),
        ("lateness", "ms", "lateness_p99_ms", 1.0),
        ("overruns", "", "overruns", 1.0),
    )
    # The page measures the round-trip time itself.
    found.same("number of figures of the loop", len(shown), len(told) + 1)
    for words, (what, unit, name, factor) in zip(shown, told, strict=False):
        if unit:
            found.same(f"unit of {what}", words[-1], unit)
        found.figure(f"{what} {unit}", words[-2 if unit else -1], moment.timing(name, factor))


def _control(found: Findings, moment: Moment) -> None:
    """Compare the holder of control; each person has one page."""
    holder = moment.state["holder"]
    told = "nobody" if holder is None else "you" if moment.holds else holder["name"]
    names = [one.name for one in moment.shown.buttons if one.name.startswith("Control: ")]
    found.same("holder of control", names, [f"Control: {told}"])
    if TEXTS["controlLost"] in moment.shown.told:
        found.same("whether control is said to be lost", told == "you", False)


def _status_line(found: Findings, moment: Moment) -> None:
    shown, state = moment.shown, moment.state
    fault, task, alive = state["fault"], state["task"], state["link"]["alive"]
    alarm, calm = shown.told.get("Fault"), shown.told.get("Status")
    found.same("whether there is an alarm", alarm is not None, fault is not None or not alive)
    found.same("whether there is a reset", shown.button("Reset") is not None, fault is not None or not alive)
    if fault is not None and alive:
        found.holds("alarm", alarm, fault["message"])
        found.holds("remedy of the alarm", alarm, fault["remedy"])
    elif state["problems"]:
        found.holds("status", calm, state["problems"][0])
    elif task is not None:
        found.holds("status", calm, title_of(task))
    elif alive:
        _calm(found, calm, state)


def _calm(found: Findings, calm: str | None, state: State) -> None:
    mode, run = state["mode"], state["recording_run"]
    if mode == "pretension" and state["pretension_done"]:
        found.holds("status", calm, TEXTS["statusReady"])
        return
    if mode in CALM:
        found.holds("status", calm, CALM[mode])
    recording = "" if run is None else TEXTS["statusRecording"].replace("{run}", str(run))
    found.same("run that is recorded", TEXTS["statusRecording"].split("{")[0] in (calm or ""), run is not None)
    found.holds("run that is recorded", calm, recording)


def _stop(found: Findings, moment: Moment) -> None:
    """Compare the result of a stop: shown while it is latched, and hidden afterwards."""
    state, said = moment.state, moment.shown.told.get("Stop result", "")
    proof = state["stop_proof"]
    if state["mode"] != "tripped" or proof is None:
        found.same("proof of a stop", said, "")
        return
    steps = proof["zero_tick"] - proof["arrived_tick"]
    noun = "control step" if steps == 1 else "control steps"
    found.sentence(
        "proof of the stop", said, f"Zero volts in {{n}} {noun} · {{n}} ms (tick {{n}})", steps, proof["milliseconds"],
        proof["zero_tick"],
    )  # fmt: skip
    found.same("STOP can be pressed", moment.shown.offers("STOP"), True)


def title_of(task: State) -> str:
    """Return the displayed title of a run."""
    kind, number, following = task["kind"].replace("_", " "), task["number"], task["following"]
    several = (following or number > 1) and (task["part"] is None or task["part"]["doing"] is None)
    place = f", {number} of {number + following}" if several else ""
    return f"{kind[0].upper()}{kind[1:]}, run {task['run']}{place}"
