/** The live window as a source of curves. */

import type { LiveStore } from "../live/store";
import { type Extent, gridOver, pointCount, writeTimes, writeValues } from "../samples/decimate";
import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import type { Panel } from "../theme/signals";
import { PERIOD_S } from "../wire/sample.gen";
import type { Curves, Pairs, PlotSource } from "./source";

class Buffers {
  times = new Float64Array(0);
  values: Float64Array[] = [];

  reserve(points: number, traces: number): void {
    if (this.times.length >= points && this.values.length === traces) return;
    const length = Math.max(this.times.length, 2 ** Math.ceil(Math.log2(Math.max(points, 1))));
    this.times = new Float64Array(length);
    this.values = Array.from({ length: traces }, () => new Float64Array(length));
  }
}

/** Share of a period by which a time may miss its tick: 0.3 / 0.001 is a little less than 300. */
const EXACT = 1e-3;

/** How far the way of the samples to this page may carry the time of day astray before it is set anew. */
const ASTRAY_S = 0.25;

export class LiveSource implements PlotSource {
  private epoch = Number.NaN;
  private readonly buffers = new WeakMap<Panel, Buffers>();

  constructor(private readonly store: LiveStore) {}

  now_s(): number {
    return this.store.clock.at(performance.now() / 1000);
  }

  newest_s(): number {
    return (this.store.window.endTick - 1) * PERIOD_S;
  }

  first_s(): number {
    return this.store.window.startTick * PERIOD_S;
  }

  version(): number {
    return this.store.window.endTick;
  }

  changedWithin(seen: Stretch, version: number): boolean {
    const endTick = this.store.window.endTick;
    return endTick < version || (endTick > version && seen.to_s >= version * PERIOD_S);
  }

  curves(panel: Panel, stretch: Stretch, pixels: number): Curves {
    const window = this.store.window;
    const grid = gridOver(
      window,
      Math.floor(stretch.from_s / PERIOD_S),
      Math.ceil(stretch.to_s / PERIOD_S),
      pixels,
    );
    const points = pointCount(grid);
    let buffers = this.buffers.get(panel);
    if (buffers === undefined) {
      buffers = new Buffers();
      this.buffers.set(panel, buffers);
    }
    buffers.reserve(points, panel.traces.length);
    writeTimes(grid, PERIOD_S, buffers.times);
    const extents: Extent[] = [];
    const values: Float64Array[] = [];
    for (const [index, trace] of panel.traces.entries()) {
      const buffer = buffers.values[index] as Float64Array;
      extents.push(writeValues(window, trace.name, grid, panel.factor, buffer));
      values.push(buffer.subarray(0, points));
    }
    return { times: buffers.times.subarray(0, points), values, extents };
  }

  pairs(x: string, y: string, { from_s, to_s }: Stretch, points: number): Pairs {
    const window = this.store.window;
    const from = Math.max(window.startTick, Math.ceil(from_s / PERIOD_S));
    const to = Math.min(window.endTick - 1, Math.floor(to_s / PERIOD_S));
    // every so many ticks, counted from tick 0, so that the points stay while the view scrolls
    const every = 2 ** Math.max(0, Math.ceil(Math.log2((to - from + 1) / points)));
    const first = Math.ceil(from / every);
    const ticks = Array.from(
      { length: Math.max(0, Math.floor(to / every) - first + 1) },
      (_, n) => (first + n) * every,
    );
    if (to >= from && ticks.at(-1) !== to) ticks.push(to);
    const values = (name: string) => Float64Array.from(ticks, (tick) => window.at(name, tick));
    return { x: values(x), y: values(y) };
  }

  /** Time of day at sample time 0, by this machine's clock [s since 1970]; held until it is off by more than a jitter. */
  epoch_s(): number {
    const epoch_s = Date.now() / 1000 - this.store.clock.at(performance.now() / 1000);
    if (!(Math.abs(epoch_s - this.epoch) < ASTRAY_S)) this.epoch = epoch_s;
    return this.epoch;
  }

  table(names: readonly string[], { from_s, to_s }: Stretch): SampleTable {
    const window = this.store.window;
    const from = Math.max(window.startTick, Math.ceil(from_s / PERIOD_S));
    const rows = Math.max(0, Math.min(window.endTick, Math.floor(to_s / PERIOD_S) + 1) - from);
    const t = Float64Array.from({ length: rows }, (_, row) => (from + row) * PERIOD_S);
    const columns = names.map((name) => {
      const values = new Float64Array(rows);
      window.copyTo(name, from, values);
      return { name, minimum: values, maximum: values };
    });
    return { raw: true, width_s: PERIOD_S, t, columns };
  }

  at(name: string, time_s: number): number {
    return this.store.window.at(name, Math.floor(time_s / PERIOD_S + EXACT));
  }
}
