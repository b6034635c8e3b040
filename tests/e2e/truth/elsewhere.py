"""Comparison of the other pages with the service: current run, queue, identifications, banks, runs, log, chain."""

import math
from datetime import datetime

from tests.e2e.page_texts import load_texts
from tests.e2e.truth.findings import Findings
from tests.e2e.truth.frame import title_of
from tests.e2e.truth.legality import compared, legal_modes, may_command, may_retune, may_start, may_step
from tests.e2e.truth.moment import Moment, State
from tests.e2e.truth.operate import angles_of

LOG = load_texts("pages/log")
IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
QUEUE = EXPERIMENT_TEXTS["queue"]
BANKS = load_texts("pages/banks")
RUNS = load_texts("pages/runs")
OPERATE = load_texts("pages/operate")
_SYSTEM = load_texts("pages/system")

_ANGLE_FACTORS = {"mrad": 0.18 / math.pi} | dict.fromkeys(("rad", "rad/s", "rad·s"), 180.0 / math.pi)


def running(moment: Moment) -> Findings:
    """Compare the card of the current run: number, part, remaining time, and whether it can be aborted."""
    found, shown, state = Findings(), moment.shown, moment.state
    task = state["task"]
    found.same("whether something is said to run", OPERATE["currentRun"] in shown.told, task is not None)
    if task is None or OPERATE["currentRun"] not in shown.told:
        return found
    part, told = task["part"], shown.told[OPERATE["currentRun"]]
    if part is None:
        found.same("what runs", told, f"{title_of(task)}: {task['phase'].replace('_', ' ')}")
    elif part["doing"] is not None:
        words = f"{title_of(task)}: {part['number']} of {part['of']}: {part['title']}, {part['doing']}, {{d}} left"
        found.sentence("what runs", told, words, moment.counting(part["left_s"], down=True))
    elif part["of"] > 1:
        words = f"{title_of(task)}: part {part['number']} of {part['of']}, {part['title']}, {{d}} left"
        found.sentence("what runs", told, words, moment.counting(part["left_s"], down=True))
    else:
        found.same("what runs", told, f"{title_of(task)}: {part['title']}")
    left_s, left = task["duration_s"] - task["elapsed_s"], shown.told.get(OPERATE["timeLeft"])
    following = task["following"]
    more = f", then {following} more run{'s' if following > 1 else ''}" if following else ""
    if task["phase"] == "evaluation":
        found.same("time left", left, "computing the result")
    elif left is not None and "longer than expected" in left:
        found.sentence("time left", left, f"{{d}} longer than expected{more}", moment.counting(-left_s))
    else:
        whole = task["duration_s"]
        found.sentence(
            "time left",
            left,
            f"{{d}} left of {{d}}{more}",
            moment.counting(left_s, down=True),
            (whole - 0.1, whole + 0.1),
        )
    compared(found, moment, {(OPERATE["running"], OPERATE["softAbort"]): "stopping" in legal_modes(state)})
    return found


def experiments(moment: Moment) -> Findings:
    found, shown, state = running(moment), moment.shown, moment.state
    queue = moment.get("/api/experiments/queue")
    waiting = shown.all["lists"].get(QUEUE, [])
    found.same("number of experiments that wait", len(waiting), len(queue["items"]))
    for line, item in zip(waiting, queue["items"], strict=False):
        found.holds("who queued an experiment", line, EXPERIMENT_TEXTS["queuedBy"].format(person=item["who"]))
    aside = shown.all["asides"].get(QUEUE, "").strip()
    found.same(
        "whether the queue goes on", aside, EXPERIMENT_TEXTS["queueRunning" if queue["running"] else "queueIdle"]
    )
    free = may_start(state, "experiment")
    if not queue["running"]:
        name = EXPERIMENT_TEXTS["startQueueAgain" if queue["problem"] else "startQueue"]
        compared(found, moment, {(QUEUE, name): bool(queue["items"]) and free})
    else:
        compared(found, moment, {(QUEUE, EXPERIMENT_TEXTS["pauseQueue"]): True})
    for place, item in enumerate(queue["items"]):
        compared(found, moment, {
            (QUEUE, EXPERIMENT_TEXTS["moveUpInQueue"].format(id=item["id"])): place > 0,
            (QUEUE, EXPERIMENT_TEXTS["removeFromQueue"].format(id=item["id"])): True,
        })  # fmt: skip
    _dry_run(found, moment)
    start = next((one for one in shown.buttons if one.name.startswith("Start ") and one.region != QUEUE), None)
    found.same("whether an experiment can be started", start and start.enabled, free)
    return found


def _dry_run(found: Findings, moment: Moment) -> None:
    """Compare the result of a dry run with the response of the service."""
    shown, told = moment.shown, moment.dry_run
    text = shown.all["dry_run"]
    if text is None or EXPERIMENT_TEXTS["simulating"].split("}")[1].strip(": ") in text:
        return
    if told is None:
        found.append(f"dry run: shown {text[:80]!r}, none was answered")
        return
    factors = _ANGLE_FACTORS if angles_of(moment) == "deg" else {}
    found.holds("end of the dry run", text, _end(told["status"]))
    if not any(unit in told["verdict"] for unit in (" rad", "°")):
        found.holds("verdict of the dry run", text, told["verdict"])
    for names in ("criteria", "metrics"):
        rows, figures = (
            shown.tables.get(EXPERIMENT_TEXTS[f"{names}Of"].format(source=EXPERIMENT_TEXTS["dryRunSource"]), []),
            told[names],
        )
        found.same(f"number of {names} of the dry run", len(rows), len(figures))
        for row, one in zip(rows, figures, strict=False):
            what = f"{one['name']} of the dry run"
            if one["value"] is None:
                found.same(what, row[1], "not measured")
            else:
                found.figure(what, row[1], one["value"] * factors.get(one["unit"], 1.0))
            if names == "criteria":
                word = {True: "pass", False: "fail", None: "not measured"}[one["passed"]]
                found.same(f"result of {what}", row[3].startswith(word), True)


def _parameters(found: Findings, moment: Moment) -> None:
    """Compare the versions of the parameters, and the changes by applying the shown identification."""
    told, tables = moment.get("/api/parameters"), moment.shown.tables
    rows = tables.get(IDENTIFY_TEXTS["versions"], [])
    for place, name in ((0, "number"), (2, "who"), (4, "digest")):
        words = [str(one[name] or "–") if name == "who" else str(one[name])[:12] for one in told["versions"]]
        found.same(f"{name} of the versions of the parameters", [row[place] for row in rows], words)
    newest = told["versions"][0]
    _parameter_changes(
        found, tables.get(IDENTIFY_TEXTS["changedParameters"], []), newest["changes"] if newest["number"] else []
    )
    estimate = _shown_estimate(moment)
    if estimate is not None:
        proposal = moment.get(f"/api/parameters?estimate={estimate}")["proposal"]
        changes = [] if proposal["problem"] else proposal["changes"]
        _parameter_changes(found, tables.get(IDENTIFY_TEXTS["proposedChanges"], []), changes)
        offered = moment.shown.button(IDENTIFY_TEXTS["applyParameters"]) is not None
        found.same("whether the identification is offered to be applied", offered, not proposal["problem"])
    off = may_command(moment.state) and moment.state["mode"] == "off"
    undo = IDENTIFY_TEXTS["undo"].split("{")[0]
    for button in moment.shown.buttons:
        if button.name == IDENTIFY_TEXTS["applyParameters"] or button.name.startswith(undo):
            found.same(f"whether {button.name!r} can be pressed", button.enabled, off)


def _parameter_changes(found: Findings, rows: list[list[str]], changes: list[State]) -> None:
    found.same("number of parameters that change", len(rows), len(changes))
    for row, one in zip(rows, changes, strict=False):
        for place, name in ((1, "before"), (2, "after")):
            if one[name] is not None:
                found.figure(f"{one['name']} {one['side']} {name}", row[place], one[name])


def _shown_estimate(moment: Moment) -> int | None:
    """Return the applicable estimate of the shown identification: from the address, else the newest."""
    told = moment.get("/api/identifications")["identifications"]
    address = moment.shown.all["hash"].rpartition("/")[2]
    number = int(address) if address.isdigit() else told[0]["id"] if told else None
    one = next((one for one in told if one["id"] == number), None)
    is_applicable = one is not None and one["kind"] != "actuator" and one["status"] != "running"
    return one["estimate"] if one is not None and is_applicable else None


def identify(moment: Moment) -> Findings:
    found, shown, state = running(moment), moment.shown, moment.state
    told = moment.get("/api/identifications")["identifications"]
    rows = shown.tables.get(IDENTIFY_TEXTS["runs"], [])
    found.same(
        "identifications", [row[1] for row in rows], [IDENTIFY_TEXTS["runLink"].format(run=one["id"]) for one in told]
    )
    found.same("ends of identifications", [row[-1] for row in rows], [_end(one["status"]) for one in told])
    for one in told:
        box = shown.box(IDENTIFY_TEXTS["useRun"].format(run=one["id"]))
        may = one["kind"] == "actuator" and one["usable"]
        found.same(f"whether run {one['id']} can be used for a bank", bool(box and box.enabled), may)
    _parameters(found, moment)
    start = shown.button(IDENTIFY_TEXTS["start"])
    leaves = IDENTIFY_TEXTS["leavesRange"] in " ".join(shown.told.values())  # as the forecast states
    if not leaves:
        found.same("whether an identification can be started", start and start.enabled, may_start(state, "identify"))
    return found


def banks(moment: Moment) -> Findings:
    found, shown, state = Findings(), moment.shown, moment.state
    told, own = moment.get("/api/banks")["banks"], state["own_tuning"] or state["tuning"]
    rows = shown.tables.get(BANKS["table"], [])
    names = [f"{one['name']} v{one['version']}" for one in told]
    found.same("banks", [row[0] for row in rows], names)
    found.same("entries of banks", [row[3] for row in rows], [str(len(one["entries"])) for one in told])
    found.same("active banks", [row[5] == BANKS["activeBank"] for row in rows], [one["active"] for one in told])
    said = shown.told.get(BANKS["activeTuning"], "")
    is_after_run = said.startswith(BANKS["activeAfterRun"].split("{")[0].strip())
    found.same("of when the tuning is", is_after_run, state["own_tuning"] is not None)
    bank = own["bank"]
    words = "geometric gains" if bank is None else f"bank {bank['name']} v{bank['version']}"
    found.holds("bank in force", said, words)
    template = f"λ_q {own['lam_q']:.4g} s, λ_S {own['lam_S']:.4g} s"
    found.holds("λ in force", said, template)
    free = may_retune(state)
    activate = [BANKS["activateBank"].replace("{bank}", name) for name in names]
    offered = {(BANKS["versions"], name): free for name, one in zip(activate, told, strict=True) if not one["active"]}
    offered |= {
        (BANKS["versions"], BANKS["useGeometric"]): bank is not None and free,
        (BANKS["versions"], "Undo change"): may_step(state, state["earlier"]),
        (BANKS["versions"], "Redo change"): may_step(state, state["later"]),
    }
    compared(found, moment, offered)
    return found


def runs(moment: Moment) -> Findings:
    """Compare the list of all runs, or one run."""
    found, number = Findings(), moment.shown.all["hash"].rpartition("/")[2]
    if number.isdigit():
        one = moment.get(f"/api/runs/{number}")
        title = RUNS["runWithTitle"].replace("{run}", number).replace("{title}", one["title"])
        found.same("title of a run", moment.shown.all["heading"], f"{RUNS['runs']} / {title}")
        found.holds(f"end of run {number}", "; ".join(moment.shown.all["ends"]), _end(one["end_state"]))
        return found
    if moment.shown.all["hash"] != "#/runs":
        return found
    told = moment.get("/api/runs?limit=50&offset=0")["runs"]
    rows, heads = moment.shown.tables.get(RUNS["table"], []), moment.shown.all["heads"].get(RUNS["table"], [])
    kind, who, end = (
        heads.index(name) if name in heads else 0 for name in (RUNS["kind"], RUNS["person"], RUNS["status"])
    )
    found.same("runs", [row[1] for row in rows], [f"Run {one['id']}" for one in told])
    for row, one in zip(rows, told, strict=False):
        found.same(f"kind of run {one['id']}", row[kind], one["title"])
        found.same(f"who made run {one['id']}", row[who], one["who"])
        found.holds(f"end of run {one['id']}", row[end], _end(one["end_state"]))
        missing = one["missing_samples"]
        words = RUNS["missingUnknown"] if missing is None else ""
        words = RUNS["samplesMissing"].replace("{samples}", str(missing)) if missing else words
        found.holds(f"samples missing in run {one['id']}", row[end], words)
    return found


def log(moment: Moment) -> Findings:
    """Compare the log; entries with angles only by time, person and link, as the page converts them."""
    found = Findings()
    told = moment.get("/api/log?limit=100")
    rows = moment.shown.tables.get("Log", [])
    found.same("number of lines of the log", len(rows), len(told["entries"]))
    for row, entry in zip(rows, told["entries"], strict=False):
        moment_ms = datetime.fromisoformat(entry["at"]).microsecond // 1000
        found.same(f"time of {entry['text']!r}", row[0].rpartition(".")[2], f"{moment_ms:03d}")
        if " rad" not in entry["text"]:
            found.same("text of a line", row[2], " ".join(entry["text"].split()))
        found.same(f"who did {entry['text']!r}", row[3], entry["who"] or LOG["bySystem"])
        if entry["event"] is not None:
            found.holds(f"note of {entry['text']!r}", row[5], entry["note"])
    older = moment.shown.button("Older")
    found.same("whether there is more of the log", older and older.enabled, bool(told["more_before"]))
    return found


def system(moment: Moment) -> Findings:
    """Compare the safety chain with the watchdog, and the timing of the loop."""
    if moment.shown.all["hash"] != "#/system":
        return Findings()
    found, facts, state = Findings(), moment.shown.all["facts"], moment.state
    names = {
        "page": "Page in control",
        "service": "Service",
        "loop": "Control loop",
        "watchdog": "Watchdog, drive-enable",
        "safety_module": "Safety module",
    }
    for link in state["chain"]:
        said = facts.get(names[link["name"]])
        if link["silent_s"] is None:
            found.same(f"{link['name']} in the safety chain", said, link["says"])
        else:
            found.sentence(f"{link['name']} in the safety chain", said, f"{link['says']} {{n}} s ago", (0.0, 2.5))
    found.same(
        "process of the loop",
        facts.get(_SYSTEM["process"]),
        _SYSTEM["alive" if state["link"]["alive"] else "notRunning"],
    )
    starts = state["link"]["starts"]
    started = _SYSTEM["startedOnce"] if starts == 1 else _SYSTEM["startedTimes"].replace("{count}", str(starts))
    found.same("starts of the loop", facts.get(_SYSTEM["started"]), started)
    holder = (state["holder"] or {"name": _SYSTEM["nobody"]})["name"]
    found.same("holder of control", facts.get(_SYSTEM["operator"]), holder)
    found.figure("deadlines missed", facts.get(_SYSTEM["overruns"]), moment.timing("overruns"))
    return found


def _end(state: str) -> str:
    words = state.replace("_", " ")
    return words[0].upper() + words[1:]


def nothing(_moment: Moment) -> Findings:
    """Compare nothing: the page does not depend on the state."""
    return Findings()
