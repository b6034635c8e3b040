"""Makes an experiment of a run: references, pushes, walls and changes of the tuning as they were recorded."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backend.archive.history import marks_of
from backend.banks.tuning_settings import changes_told
from backend.experiments.library import LEAST, Change, Column, Followed, commanded, followed, stored_plan
from backend.experiments.plans import LAWS, ComposedPlan
from backend.experiments.schema import FORMAT
from backend.models.document import UnreadableDocumentError
from backend.models.run import LAMBDA, KeptLoop, KeptWall
from backend.realtime.program import MAX_TUNINGS, MAX_WALLS, Law, Mode
from backend.recording.reader import read_samples
from backend.schemas.experiment import RecordedExperiment
from backend.schemas.run import RunMark
from backend.storage import banks, runs
from backend.storage.database import Database, Session
from backend.storage.events import EventKind
from backend.storage.orm import UnknownRecordError
from backend.storage.runs import Run
from plant.interface import T_s

_COLUMNS = ("q_ref", "S_ref", "F_push", "lam_q", "lam_S")
_LAM = ("lam_q", "lam_S")
_DECIMALS = 6
_TOLD_AS_PARTS = ("push", "wall ", "no wall", "by the program: wall", "by the program: no wall")
"""How the events begin that come back as parts of the samples and of the kept walls."""


def recorded_experiment(database: Database, run_id: int) -> RecordedExperiment:
    """Return a run as an experiment of its own, and what of the run it does not repeat.

    Raises UnknownRecordError, ExperimentError where there are no references to follow.
    """
    with database.reading() as session:
        samples = read_samples(session, run_id, _COLUMNS)
        run = runs.get(session, run_id)
        marks = marks_of(session, run_id).marks
        bank = _bank(session, run)
    columns = {name: column.astype(float) for name, column in samples.columns.items()}
    first, end = commanded(columns["q_ref"], columns["S_ref"])
    cut = {name: column[first:end] for name, column in columns.items()}
    t = samples.t[first:end]
    made = _Made(t, cut, run, marks, bank)
    found = followed(cut["q_ref"], cut["S_ref"], np.nan_to_num(cut["F_push"]), made.changes())
    made.leave_out_pushes(found, cut["F_push"])
    document = {
        "format": FORMAT,
        "name": f"as_run_{run_id}",
        "title": f"As run {run_id}",
        "description": _described(run_id, found),
        **({} if made.law is Law.CASCADE else {"law": str(made.law)}),
        "phases": [{"name": "recorded", "title": "Recorded", "parts": found.parts}],
    }
    text = json.dumps(document, ensure_ascii=False, indent=1)
    return RecordedExperiment(text=text, document=document, left_out=made.left_out)


def _described(run_id: int, found: Followed) -> str:
    off = f"{found.off_q_rad:.2g} rad and {found.off_S:.2g} N·m/rad"
    pushed = f", pushes within {found.off_F_N:.2g} N" if any(part["do"] == "push" for part in found.parts) else ""
    late = f" Pushes, walls and the tuning come up to {found.late_ticks} ms late." if found.late_ticks else ""
    return (
        f"The references of run {run_id} as they were commanded, followed within {off} at every sample{pushed}. "
        f"It begins with the tuning of the run.{late}"
    )


def _bank(session: Session, run: Run) -> int | None:
    """Return the number of the bank that a run began with, 0 for geometry; None where this station has none of it."""
    if run.set_to.loop.bank in (None, 0):
        return run.set_to.loop.bank
    try:
        return None if run.bank_id is None else banks.own(session, run.bank_id).id
    except UnknownRecordError:
        return None


class _Made:
    """What becomes of a run besides its references; ``left_out`` collects what cannot be repeated."""

    def __init__(
        self,
        t: np.ndarray[Any, np.dtype[np.float64]],
        columns: Mapping[str, Column],
        run: Run,
        marks: Sequence[RunMark],
        bank: int | None,
    ) -> None:
        self._t, self._columns, self._run, self._marks, self._bank = t, columns, run, marks, bank
        self.left_out: list[str] = []
        self.law = _law(run)
        missing = round((t[-1] - t[0]) / T_s) + 1 - len(t)
        if missing > 0:
            self.left_out.append(f"{missing} samples are missing: their time is left out")

    def changes(self) -> list[Change]:
        """Return tunings and walls in order of their ticks."""
        tunings = self._within(self._tunings(), MAX_TUNINGS, "changes of the tuning")
        walls = self._within(self._walls(), MAX_WALLS, "changes of the wall")
        self._leave_out_marks()
        self._leave_out_program()
        return sorted([*tunings, *walls], key=lambda change: change.tick)

    def leave_out_pushes(self, found: Followed, F_push: Column) -> None:
        """Tell which pushes the experiment lacks."""
        for begin, end in found.unpushed:
            force, begins, ends = F_push[begin], self._t[begin], self._t[min(end, len(self._t) - 1)]
            why = "the references move meanwhile, and a push holds them"
            self.left_out.append(f"push of {force:.3g} N from {begins:.3f} s to {ends:.3f} s: {why}")

    def _within(self, changes: list[Change], most: int, what: str) -> list[Change]:
        if len(changes) > most:
            self.left_out.append(f"the last {len(changes) - most} of {len(changes)} {what}: {most} are the most")
        return changes[:most]

    def _tunings(self) -> list[Change]:
        """Return the tuning of the beginning, and every change: λ by the samples, the rest by what was noted."""
        parts: dict[int, dict[str, Any]] = {0: self._first_tuning()}
        for name in _LAM:
            column = np.round(self._columns[name], _DECIMALS)
            for change in np.flatnonzero(np.diff(column)) + 1:
                parts.setdefault(int(change), {})[name] = float(column[change])
        for mark in self._marks:
            changed = changes_told(mark.text) if mark.kind == EventKind.TUNING else None
            tick = self._tick(mark.t)
            if changed is None or tick is None:
                continue
            others = {name: value for name, value in changed.items() if name not in _LAM}
            for name in ("k_ext", "bank"):
                if name in others and others.pop(name):
                    self.left_out.append(f"at {mark.t:.3f} s: {mark.text}")
            if others:
                parts.setdefault(tick, {}).update(others)
        return [Change(tick, {"do": "tuning", **parts[tick]}) for tick in sorted(parts) if parts[tick]]

    def _first_tuning(self) -> dict[str, Any]:
        loop: KeptLoop = self._run.set_to.loop
        known = {name: value for name, value in loop.known().items() if name != "seed"}
        if loop.motion == LAMBDA:
            known.pop("u_plan", None)
        if known.pop("k_ext", 0.0):
            self.left_out.append("pushes were rejected by k_ext: what was learned before the run is not recorded")
        if known.pop("bank", 0) and self._bank is None:
            self.left_out.append(f"bank {loop.bank} is not of this station: the bank in force is used")
        if self._bank is not None:
            known["bank"] = self._bank
        first = {name: round(float(self._columns[name][0]), _DECIMALS) for name in _LAM}
        return {**known, **{name: value for name, value in first.items() if np.isfinite(value)}}

    def _walls(self) -> list[Change]:
        """Return the changes of the wall; one that would stand where the joint is asked to be is left out."""
        due: dict[int, KeptWall] = {}
        for kept in self._run.set_to.walls or ():
            tick = int(np.searchsorted(self._t, kept.t - 0.5 * T_s))
            if tick < len(self._t):
                due[max(tick, LEAST)] = kept  # the first part brings the joint to where it begins
        found: list[Change] = []
        stands = False
        for tick, kept in sorted(due.items()):
            wall = kept.obstacle
            q_ref = float(self._columns["q_ref"][min(tick, len(self._t)) - 1])
            if wall is not None and kept.side * (q_ref - kept.q_wall) >= 0.0:
                self.left_out.append(
                    f"wall at {kept.q_wall:.4g} rad from {self._t[tick]:.3f} s: q_ref is beyond it, at {q_ref:.4g} rad"
                )
                wall = None
            if wall is not None:
                side = "above" if wall.side > 0.0 else "below"
                part = {"do": "wall", "q_wall": wall.q_wall, "side": side, "k_wall": wall.k_wall, "c_wall": wall.c_wall}
                found.append(Change(tick, part))
            elif stands:
                found.append(Change(tick, {"do": "no_wall"}))
            stands = wall is not None
        return found

    def _leave_out_marks(self) -> None:
        """Tell what was noted and comes back by no part."""
        for mark in self._marks:
            if mark.kind in (EventKind.MODE, EventKind.REFERENCES) or self._tick(mark.t) is None:
                continue
            told = mark.kind == EventKind.NOTE and mark.text.startswith(_TOLD_AS_PARTS)
            told |= mark.kind == EventKind.TUNING and (
                changes_told(mark.text) is not None or mark.text.startswith("by the program")
            )
            if not told:
                self.left_out.append(f"at {mark.t:.3f} s: {mark.text}")

    def _leave_out_program(self) -> None:
        """Tell what the program of the run did and nothing records."""
        kept = self._run.set_to.plan
        if kept is None or self._run.set_to.experiment is None:
            return
        try:
            plan = stored_plan(self._run.kind, kept)
        except (ValueError, UnreadableDocumentError):
            self.left_out.append("what its program did besides: this version does not read it")
            return
        if not isinstance(plan, ComposedPlan):
            return
        laid = plan.laid
        if any(segment.load_A or segment.load_B for segment in laid.segments):
            self.left_out.append("loads of the motors' shafts: they are not recorded")
        if laid.touches:
            self.left_out.append("what the run learned of the outside force, and giving way to a contact")
        others = {name for change in laid.changes for name in change if name not in _LAM}
        if others:
            self.left_out.append(f"changes of {', '.join(sorted(others))} by the program: only λ is recorded")

    def _tick(self, t: float) -> int | None:
        """Return the place of a time among the references, None for one outside of them."""
        if not self._t[0] - 0.5 * T_s <= t <= self._t[-1] + 0.5 * T_s:
            return None
        return min(int(np.searchsorted(self._t, t - 0.5 * T_s)), len(self._t) - 1)


def _law(run: Run) -> Law:
    """Return the law under which an experiment plays what a run did."""
    if run.set_to.mode == Mode.COMPLIANCE:
        return Law.COMPLIANCE
    law = run.set_to.law
    return Law(law) if law in LAWS else Law.CASCADE
