/** Stores the data of the live connection: newest state, samples of the window, and the sample clock. */

import { replaceEqualDeep } from "@tanstack/react-query";
import type { DerivedSignal } from "../samples/formula";
import { SampleWindow } from "../samples/window";
import type { Frame } from "../wire/liveMessages";
import type { Layout, Mark, State } from "../wire/types";
import { firstLink, type Link } from "./link";

/**
 * Estimates the current sample time between frames, so that charts scroll evenly although frames arrive in bursts.
 * Pure.
 */

const FOLLOW = 0.05;
const JUMP_S = 0.25;
/** Time by which the right edge may be ahead of the newest sample when no frames arrive. */
const AHEAD_S = 0.05;
/** Rate at which the shortest delay may grow: the connection is slower for good, or the loop paused [s/s]. */
const RELAX = 0.25;
/** Time constant with which the shortest delay follows a large change [s]. */
const RELAX_S = 2;
/** Longest interval between frames that counts as time passed; a pause alone does not change the shortest delay. */
const LONGEST_S = 0.1;

export class SampleClock {
  private offset_s: number | null = null;
  private newest_s = 0;
  /**
   * Largest recent difference of sample time and page time, from the fastest frame; and the page time of its last
   * update.
   */
  private largestOffset_s: number | null = null;
  private updated_s = 0;

  /** Records that a frame with end time `end_s` (sample time) arrived at page time `arrival_s`. */
  observe(end_s: number, arrival_s: number): void {
    const offset_s = end_s - arrival_s;
    const known = this.offset_s;
    this.offset_s =
      known === null || Math.abs(offset_s - known) > JUMP_S ? offset_s : known + FOLLOW * (offset_s - known);
    this.newest_s = end_s;
    const largestOffset_s = this.largestOffset_s ?? offset_s;
    const relaxed_s =
      Math.min(arrival_s - this.updated_s, LONGEST_S) * (RELAX + (largestOffset_s - offset_s) / RELAX_S);
    this.largestOffset_s = Math.max(offset_s, largestOffset_s - relaxed_s);
    this.updated_s = arrival_s;
  }

  /** Age of the newest sample at page time `page_s`, beyond the shortest delay; null before the first sample [s]. */
  age(page_s: number): number | null {
    return this.largestOffset_s === null ? null : Math.max(0, page_s + this.largestOffset_s - this.newest_s);
  }

  /** Sample time at page time `page_s`; stops shortly after the newest sample. */
  at(page_s: number): number {
    if (this.offset_s === null) return 0;
    return Math.min(page_s + this.offset_s, this.newest_s + AHEAD_S);
  }

  /** Clears the estimate, for a new connection. */
  reset(): void {
    this.offset_s = null;
    this.newest_s = 0;
    this.largestOffset_s = null;
  }
}

const MAX_MARKS = 500;
/** Longest wait for the end of the history; after it, the received part is shown. */
const HISTORY_WITHIN_S = 1;

/** The slow part, replaced as a whole on each change; React components read it. */
export interface Live {
  readonly link: Link;
  readonly layout: Layout | null;
  readonly state: State | null;
  /** Whether the state comes from the current connection. */
  readonly isStateCurrent: boolean;
  readonly marks: readonly Mark[];
  /** Samples that did not reach this page since it was opened. */
  readonly missed: number;
}

export class LiveStore {
  /** The fast part: frames change it in place, and the charts read it on their own animation frames. */
  window = new SampleWindow([]);
  readonly clock = new SampleClock();

  /** History received after the layout message: frames before `untilTick`, collected until they are complete. */
  private history: { untilTick: number | null; since_s: number | null; frames: Frame[] } | null = null;
  private live: Live;
  private formulas: readonly DerivedSignal[] = [];
  private readonly listeners = new Set<() => void>();

  constructor(now_ms: number) {
    this.live = {
      link: firstLink(now_ms),
      layout: null,
      state: null,
      isStateCurrent: false,
      marks: [],
      missed: 0,
    };
  }

  readonly subscribe = (listener: () => void): (() => void) => {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  };

  readonly snapshot = (): Live => this.live;

  setLink(link: Link): void {
    if (link === this.live.link) return;
    this.change(link.phase === "open" ? { link } : { link, isStateCurrent: false });
  }

  /** Starts a new connection: the service sends samples and marks again. */
  setLayout(layout: Layout): void {
    const names = layout.fields.map((field) => field.name);
    if (names.join() !== this.window.names.join()) {
      this.window = new SampleWindow(names);
      this.window.derive(this.formulas);
      this.clock.reset();
    }
    this.history = { untilTick: null, since_s: null, frames: [] };
    this.change({ layout, marks: [] });
  }

  setState(state: State): void {
    const restarted = this.live.state !== null && this.live.state.link.starts !== state.link.starts;
    if (restarted) {
      this.window = new SampleWindow(this.window.names);
      this.window.derive(this.formulas);
      this.clock.reset();
      this.change({ marks: [] });
    }
    if (this.history?.untilTick === null) this.history.untilTick = state.tick + 1;
    // Equal parts keep their identity, so that only components with changed data render again.
    this.change({ state: replaceEqualDeep(this.live.state, state), isStateCurrent: true });
  }

  /** Sets the derived signals of the window; computes them for the stored samples too. */
  setFormulas(formulas: readonly DerivedSignal[]): void {
    this.formulas = formulas;
    this.window.derive(formulas);
  }

  addMark(mark: Mark): void {
    this.change({ marks: [...this.live.marks, mark].slice(-MAX_MARKS) });
  }

  addFrame(frame: Frame, arrival_s: number): void {
    const frames = this.complete(frame, arrival_s);
    if (frames === null) return;
    const plant = this.live.state?.plant;
    if (plant !== undefined) this.window.measure(plant);
    for (const next of frames) this.window.append(next);
    const period_s = this.live.layout?.period_s ?? 0;
    this.clock.observe(this.window.endTick * period_s, arrival_s);
    const missed = frames.reduce((sum, next) => sum + next.missed, 0);
    if (missed > 0) this.change({ missed: this.live.missed + missed });
  }

  /** Age of the newest sample of the window at page time `now_s`; null before the first sample [s]. */
  age(now_s: number): number | null {
    return this.clock.age(now_s);
  }

  /** Frames to add now; null while the history is incomplete, so that old samples never appear as current. */
  private complete(frame: Frame, arrival_s: number): Frame[] | null {
    const history = this.history;
    if (history === null) return [frame];
    history.since_s ??= arrival_s;
    history.frames.push(frame);
    const isComplete = frame.firstTick + frame.count >= (history.untilTick ?? 0);
    if (!isComplete && arrival_s - history.since_s < HISTORY_WITHIN_S) return null;
    this.history = null;
    // The known delay belongs to the previous connection; until now it determined the age of the samples shown.
    this.clock.reset();
    return history.frames;
  }

  private change(part: Partial<Live>): void {
    this.live = { ...this.live, ...part };
    for (const listener of this.listeners) listener();
  }
}
