/** Holds what the live connection has brought: newest state, samples of the window, and the sample clock. */

import { replaceEqualDeep } from "@tanstack/react-query";
import type { DerivedSignal } from "../samples/formula";
import { SampleWindow } from "../samples/window";
import type { Frame } from "../wire/liveMessages";
import type { Layout, Mark, State } from "../wire/types";
import { firstLink, type Link } from "./link";

/** Sample time between frames: lets the charts scroll evenly although samples arrive in bunches. Pure. */

const FOLLOW = 0.05;
const JUMP_S = 0.25;
/** How far the edge may run ahead of the newest sample when none arrive. */
const AHEAD_S = 0.05;
/** The way of the samples to this page may have grown longer for good, or the loop stood still: believed by and by [s/s]. */
const RELAX = 0.25;
/** A great step is believed within some of these [s]. */
const RELAX_S = 2;
/** Only while samples arrive: a silence by itself says nothing about their way. */
const LONGEST_S = 0.1;

export class SampleClock {
  private offset_s: number | null = null;
  private newest_s = 0;
  /** The shortest way that samples took of late, as what to add to the page's time; and when that was found. */
  private shortest_s: number | null = null;
  private found_s = 0;

  /** A frame that ends at sample time `end_s` has arrived at page time `arrival_s`. */
  observe(end_s: number, arrival_s: number): void {
    const offset_s = end_s - arrival_s;
    const known = this.offset_s;
    this.offset_s =
      known === null || Math.abs(offset_s - known) > JUMP_S ? offset_s : known + FOLLOW * (offset_s - known);
    this.newest_s = end_s;
    const shortest_s = this.shortest_s ?? offset_s;
    const relaxed_s =
      Math.min(arrival_s - this.found_s, LONGEST_S) * (RELAX + (shortest_s - offset_s) / RELAX_S);
    this.shortest_s = Math.max(offset_s, shortest_s - relaxed_s);
    this.found_s = arrival_s;
  }

  /** How old the newest sample is at page time `page_s`, beyond the shortest way; null before the first one [s]. */
  age(page_s: number): number | null {
    return this.shortest_s === null ? null : Math.max(0, page_s + this.shortest_s - this.newest_s);
  }

  /** Sample time at page time `page_s`; stands still shortly after the newest sample. */
  at(page_s: number): number {
    if (this.offset_s === null) return 0;
    return Math.min(page_s + this.offset_s, this.newest_s + AHEAD_S);
  }

  /** Forget everything (a new connection). */
  reset(): void {
    this.offset_s = null;
    this.newest_s = 0;
    this.shortest_s = null;
  }
}

const MARKS_KEPT = 500;
/** History that does not come to its end within so long [s] is shown as far as it came. */
const HISTORY_WITHIN_S = 1;

/** The slow part, replaced as a whole on each change; React reads this. */
export interface Live {
  readonly link: Link;
  readonly layout: Layout | null;
  readonly state: State | null;
  /** Whether the state is of this connection, and not of the one before. */
  readonly isStateCurrent: boolean;
  readonly marks: readonly Mark[];
  /** Samples that did not reach this page since it was opened. */
  readonly missed: number;
}

export class LiveStore {
  /** The fast part: changed in place at the rate of the frames, read by the charts on their own frames. */
  window = new SampleWindow([]);
  readonly clock = new SampleClock();

  /** After a greeting: what came before this tick is history, kept aside until it is whole. */
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

  /** A new connection was greeted: samples and marks come again from the service. */
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
    // equal parts keep their identity, so that only what shows a change is rendered again
    this.change({ state: replaceEqualDeep(this.live.state, state), isStateCurrent: true });
  }

  /** Hold these derived signals in the window, also of the samples that are there. */
  setFormulas(formulas: readonly DerivedSignal[]): void {
    this.formulas = formulas;
    this.window.derive(formulas);
  }

  addMark(mark: Mark): void {
    this.change({ marks: [...this.live.marks, mark].slice(-MARKS_KEPT) });
  }

  addFrame(frame: Frame, arrival_s: number): void {
    const frames = this.complete(frame, arrival_s);
    if (frames === null) return;
    const plant = this.live.state?.plant;
    if (plant !== undefined) this.window.measure(plant);
    for (const one of frames) this.window.append(one);
    const period_s = this.live.layout?.period_s ?? 0;
    this.clock.observe(this.window.endTick * period_s, arrival_s);
    const missed = frames.reduce((sum, one) => sum + one.missed, 0);
    if (missed > 0) this.change({ missed: this.live.missed + missed });
  }

  /** How old the newest sample in the window is at page time `now_s`; null while nothing is known of it [s]. */
  age(now_s: number): number | null {
    return this.clock.age(now_s);
  }

  /** The frames to take in now: none while history is on its way, so that old samples never pass as present ones. */
  private complete(frame: Frame, arrival_s: number): Frame[] | null {
    const history = this.history;
    if (history === null) return [frame];
    history.since_s ??= arrival_s;
    history.frames.push(frame);
    const whole = frame.firstTick + frame.count >= (history.untilTick ?? 0);
    if (!whole && arrival_s - history.since_s < HISTORY_WITHIN_S) return null;
    this.history = null;
    // what was known of the way here belongs to the connection before; until now the samples shown grew old by it
    this.clock.reset();
    return history.frames;
  }

  private change(part: Partial<Live>): void {
    this.live = { ...this.live, ...part };
    for (const listener of this.listeners) listener();
  }
}
