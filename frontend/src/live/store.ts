/** What the page knows of the running system, in one place, changed by the socket and read by everything. */

import { replaceEqualDeep } from "@tanstack/react-query";
import type { DerivedSignal } from "../samples/formula";
import { SampleWindow } from "../samples/window";
import type { Frame } from "../wire/frame";
import type { Layout, Mark, State } from "../wire/types";
import { SampleClock } from "./clock";
import { firstLink, type Link } from "./link";

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
