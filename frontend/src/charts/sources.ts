import type { LiveStore } from "../live/store";
import {
  atOrBefore,
  type Extent,
  gridOver,
  pointCount,
  pointTimes,
  pointValues,
  writeTimes,
  writeValues,
} from "../samples/decimate";
import type { SampleTable, TimeRange } from "../samples/timeSeries";
import { HUES, type Panel, type Trace } from "../theme/signals";
import type { Excerpt } from "../wire/curves";
import { PERIOD_S } from "../wire/sample.gen";

/** Sources of samples for a stack of charts: the live window or a recording. */

/** Curves of one chart over a time range, in the unit shown. The next call reuses the arrays. */
export interface Curves {
  readonly times: Float64Array;
  /** One array per trace of the panel. */
  readonly values: readonly Float64Array[];
  readonly extents: readonly Extent[];
}

/** Points of one signal over another in SI, in the order of time. */
export interface Pairs {
  readonly x: Float64Array;
  readonly y: Float64Array;
}

export interface PlotSource {
  /** Time of the right edge while following [s]. */
  now_s(): number;
  /** Time of the newest sample; `now_s` may be slightly ahead of it [s]. */
  newest_s(): number;
  /** Time of the oldest sample [s]. */
  first_s(): number;
  /** Number that changes whenever samples are added or replaced. */
  version(): number;
  /** Whether samples within `seen` were added or replaced since `version`. */
  changedWithin(seen: TimeRange, version: number): boolean;
  curves(panel: Panel, stretch: TimeRange, pixels: number): Curves;
  /**
   * About `points` pairs at most, each of one time, or of the middles of one bucket if single samples are not loaded.
   */
  pairs?(x: string, y: string, seen: TimeRange, points: number): Pairs;
  /** Sample at or before a time, in SI; the middle of a bucket if samples are not loaded; NaN without one. */
  at(name: string, time_s: number): number;
  /** Whether `at` returns a sample at this time, not the middle of a bucket; omitted if it always does. */
  exactAt?(time_s: number): boolean;
  /** Copy of the loaded data of a time range, with every sample if available. */
  table(names: readonly string[], stretch: TimeRange): SampleTable;
}

/** Live window as a source of curves. */

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

/** Tolerance of a time as a share of the period, for rounding: 0.3 / 0.001 is slightly less than 300. */
const EXACT = 1e-3;

/** Deviation of the time of day, from changes of the delay, after which it is set again. */
const MAX_DRIFT_S = 0.25;

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

  changedWithin(seen: TimeRange, version: number): boolean {
    const endTick = this.store.window.endTick;
    return endTick < version || (endTick > version && seen.to_s >= version * PERIOD_S);
  }

  curves(panel: Panel, stretch: TimeRange, pixels: number): Curves {
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

  pairs(x: string, y: string, { from_s, to_s }: TimeRange, points: number): Pairs {
    const window = this.store.window;
    const from = Math.max(window.startTick, Math.ceil(from_s / PERIOD_S));
    const to = Math.min(window.endTick - 1, Math.floor(to_s / PERIOD_S));
    // every n-th tick, counted from tick 0, so that the points are the same while the view scrolls
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

  /**
   * Time of day at sample time 0, by this machine's clock [s since 1970]; constant unless it is off by more than
   * jitter.
   */
  epoch_s(): number {
    const epoch_s = Date.now() / 1000 - this.store.clock.at(performance.now() / 1000);
    if (!(Math.abs(epoch_s - this.epoch) < MAX_DRIFT_S)) this.epoch = epoch_s;
    return this.epoch;
  }

  table(names: readonly string[], { from_s, to_s }: TimeRange): SampleTable {
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

/** Stored run as a source of curves: an overview of the whole run, and detail of the view once it is stable. */

interface Sheet {
  readonly stretch: TimeRange;
  readonly samples: Excerpt;
  readonly times: Float64Array;
}

export class RecordedSource implements PlotSource {
  private overview: Sheet | null = null;
  private detail: Sheet | null = null;
  private sheets = 0;

  constructor(private readonly duration_s: number) {}

  setOverview(samples: Excerpt): void {
    this.overview = sheet({ from_s: 0, to_s: this.duration_s }, samples);
    this.sheets += 1;
  }

  setDetail(stretch: TimeRange, samples: Excerpt): void {
    this.detail = sheet(stretch, samples);
    this.sheets += 1;
  }

  now_s(): number {
    return this.duration_s;
  }

  newest_s(): number {
    return this.duration_s;
  }

  first_s(): number {
    return 0;
  }

  version(): number {
    return this.sheets;
  }

  changedWithin(_seen: TimeRange, version: number): boolean {
    return version !== this.sheets;
  }

  curves(panel: Panel, stretch: TimeRange): Curves {
    const chosen = this.covering(stretch);
    if (chosen === null) {
      const nothing = new Float64Array(0);
      const empty = { minimum: Number.POSITIVE_INFINITY, maximum: Number.NEGATIVE_INFINITY };
      return {
        times: nothing,
        values: panel.traces.map(() => nothing),
        extents: panel.traces.map(() => empty),
      };
    }
    const points = panel.traces.map((trace) => pointValues(chosen.samples, trace.name, panel.factor));
    return {
      times: chosen.times,
      values: points.map((point) => point.values),
      extents: points.map((point) => point.extent),
    };
  }

  at(name: string, time_s: number): number {
    const chosen = this.covering({ from_s: time_s, to_s: time_s });
    if (chosen === null || chosen.samples.t.length === 0) return Number.NaN;
    const index = atOrBefore(chosen.samples.t, time_s);
    if (index < 0) return Number.NaN;
    const signal = chosen.samples.signals[name];
    const minimum = signal?.minimum[index] ?? Number.NaN;
    const maximum = signal?.maximum[index] ?? Number.NaN;
    return (minimum + maximum) / 2;
  }

  exactAt(time_s: number): boolean {
    return this.covering({ from_s: time_s, to_s: time_s })?.samples.raw ?? true;
  }

  pairs(x: string, y: string, seen: TimeRange): Pairs {
    const { columns } = this.table([x, y], seen);
    const middles = (index: number) => {
      const column = columns[index];
      if (column === undefined) return new Float64Array(0);
      return column.minimum.map((low, row) => (low + (column.maximum[row] as number)) / 2);
    };
    return { x: middles(0), y: middles(1) };
  }

  table(names: readonly string[], seen: TimeRange): SampleTable {
    const chosen = this.covering(seen);
    if (chosen === null) return { raw: false, width_s: Number.NaN, t: new Float64Array(0), columns: [] };
    const { t, raw, width_s, signals } = chosen.samples;
    const inside = t.map((_, row) => row).filter((row) => within(t[row] as number, seen));
    const values = (series: Float32Array | undefined) =>
      Float64Array.from(inside, (row) => series?.[row] ?? Number.NaN);
    return {
      raw,
      width_s,
      t: Float64Array.from(inside, (row) => t[row] as number),
      columns: names.map((name) => ({
        name,
        minimum: values(signals[name]?.minimum),
        maximum: values(signals[name]?.maximum),
      })),
    };
  }

  private covering(stretch: TimeRange): Sheet | null {
    const detail = this.detail;
    const fits =
      detail !== null && detail.stretch.from_s <= stretch.from_s && detail.stretch.to_s >= stretch.to_s;
    return fits ? detail : this.overview;
  }
}

function within(t: number, { from_s, to_s }: TimeRange): boolean {
  return t >= from_s && t <= to_s;
}

function sheet(stretch: TimeRange, samples: Excerpt): Sheet {
  return { stretch, samples, times: pointTimes(samples) };
}

/** Recordings on the same axes: signals of each after the first have its mark. Pure except for the sources. */

const PRIME = "′";
const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const PRIMES = 3;

/** Mark of the signals of the n-th further recording: ′, ″ as ′′, and from the fourth on its number. */
export function markOf(n: number): string {
  if (n <= PRIMES) return PRIME.repeat(n);
  return PRIME + [...String(n)].map((digit) => RAISED[Number(digit)]).join("");
}

/** Dash patterns that distinguish recordings without hues; [6, 4] is that of references [px]. */
const DASHES = [[], [2, 3], [10, 4], [8, 3, 2, 3], [2, 7], [8, 2, 2, 2, 2, 2], [4, 6], [1, 2]] as const;
const DOTTED = DASHES[1];
const LIGHTNESSES = [0.52, 0.7, 0.61] as const;
const CHROMA = 0.13;
const FIRST_HUE_DEG = 250;

/** Hue of the n-th recording: from the Okabe-Ito palette, or evenly spaced with several lightnesses. */
function hueOf(n: number, count: number): string {
  const known = Object.values(HUES);
  if (count <= known.length) return known[n] as string;
  const levels = LIGHTNESSES.length;
  const angle = FIRST_HUE_DEG + (360 * n) / (levels * Math.ceil(count / levels));
  return `oklch(${LIGHTNESSES[n % levels]} ${CHROMA} ${Number((angle % 360).toFixed(1))})`;
}

/**
 * Trace of a signal in the n-th of `count` recordings, 0 for the first. Of two recordings the second is dotted, and
 * the signals have their own hues; of more, each recording has a hue, and the two sides of a recording have different
 * dashes.
 */
export function traceOf(trace: Trace, n: number, count: number): Trace {
  const named = { ...trace, name: `${trace.name}${markOf(n)}` };
  if (count <= 2) return n === 0 ? named : { ...named, dash: DOTTED };
  const coloured = { ...named, hue: hueOf(n, count), ofRecording: true };
  const place = trace.broad ? n + DASHES.length / 2 : n;
  return trace.dashed ? coloured : { ...coloured, dash: DASHES[place % DASHES.length] ?? DOTTED };
}

/** Panels with the traces of `further` recordings added to those of the first; narrow traces are above broad ones. */
export function comparedPanels(panels: readonly Panel[], further = 1): Panel[] {
  return panels.map((panel) => {
    const traces = Array.from({ length: further + 1 }, (_, n) =>
      panel.traces.filter((trace) => n === 0 || !trace.dashed).map((trace) => traceOf(trace, n, further + 1)),
    ).flat();
    return {
      ...panel,
      traces: [...traces.filter(({ broad }) => broad), ...traces.filter(({ broad }) => !broad)],
    };
  });
}

/** Signal and recording of a name; 0 is the first recording. */
export function splitName(name: string): { signal: string; of: number } {
  const at = name.indexOf(PRIME);
  if (at < 0) return { signal: name, of: 0 };
  const mark = name.slice(at);
  const digits = [...mark].map((letter) => RAISED.indexOf(letter)).filter((digit) => digit >= 0);
  return { signal: name.slice(0, at), of: digits.length > 0 ? Number(digits.join("")) : mark.length };
}

export class ComparedSource implements PlotSource {
  private readonly sources: readonly PlotSource[];

  constructor(...sources: readonly PlotSource[]) {
    this.sources = sources;
  }

  now_s(): number {
    return Math.max(...this.sources.map((source) => source.now_s()));
  }

  newest_s(): number {
    return this.now_s();
  }

  first_s(): number {
    return Math.min(...this.sources.map((source) => source.first_s()));
  }

  version(): number {
    return this.sources.reduce((sum, source) => sum + source.version(), 0);
  }

  changedWithin(_seen: TimeRange, version: number): boolean {
    return version !== this.version();
  }

  curves(panel: Panel, stretch: TimeRange, pixels: number): Curves {
    const parts = this.sources.map((source, index) => {
      const traces = panel.traces
        .filter((trace) => splitName(trace.name).of === index)
        .map((trace) => ({ ...trace, name: splitName(trace.name).signal }));
      return source.curves({ ...panel, traces }, stretch, pixels);
    });
    const times = parts.map((part) => part.times).reduce(merged);
    const taken = parts.map(() => 0);
    const drawn = panel.traces.map((trace) => {
      const { of } = splitName(trace.name);
      const [part, place] = [parts[of] as Curves, taken[of] as number];
      taken[of] = place + 1;
      return {
        values: resampled(part.times, part.values[place] as Float64Array, times),
        extent: part.extents[place] as Extent,
      };
    });
    return {
      times,
      values: drawn.map(({ values }) => values),
      extents: drawn.map(({ extent }) => extent),
    };
  }

  at(name: string, time_s: number): number {
    const { signal, of } = splitName(name);
    return this.sources[of]?.at(signal, time_s) ?? Number.NaN;
  }

  exactAt(time_s: number): boolean {
    return this.sources.every((source) => source.exactAt?.(time_s) ?? true);
  }

  /** Table of the first recording only: data and statistics of several are requested one by one. */
  table(names: readonly string[], stretch: TimeRange): SampleTable {
    const own = names.filter((name) => splitName(name).of === 0);
    return (this.sources[0] as PlotSource).table(own, stretch);
  }
}

/** Merges two ascending arrays of times. */
export function merged(a: Float64Array, b: Float64Array): Float64Array {
  const both = new Float64Array(a.length + b.length);
  let [i, j, count] = [0, 0, 0];
  while (i < a.length || j < b.length) {
    const next = Math.min(a[i] ?? Number.POSITIVE_INFINITY, b[j] ?? Number.POSITIVE_INFINITY);
    if (a[i] === next) i += 1;
    if (b[j] === next) j += 1;
    both[count] = next;
    count += 1;
  }
  return both.subarray(0, count);
}

/** Values at other times, each the last one before; NaN outside the range of its own times. */
export function resampled(from: Float64Array, values: Float64Array, to: Float64Array): Float64Array {
  let index = -1;
  const last = from.at(-1) ?? Number.NEGATIVE_INFINITY;
  return to.map((time) => {
    while (index + 1 < from.length && (from[index + 1] as number) <= time) index += 1;
    return index < 0 || time > last ? Number.NaN : (values[index] as number);
  });
}

/** Recording shifted onto the time axis of the run that it is compared with. */

export class ShiftedSource implements PlotSource {
  constructor(
    private readonly own: PlotSource,
    private readonly offset_s: number,
  ) {}

  now_s(): number {
    return this.own.now_s() + this.offset_s;
  }

  newest_s(): number {
    return this.own.newest_s() + this.offset_s;
  }

  first_s(): number {
    return this.own.first_s() + this.offset_s;
  }

  version(): number {
    return this.own.version();
  }

  changedWithin(seen: TimeRange, version: number): boolean {
    return this.own.changedWithin(this.back(seen), version);
  }

  curves(panel: Panel, stretch: TimeRange, pixels: number): Curves {
    const curves = this.own.curves(panel, this.back(stretch), pixels);
    return { ...curves, times: curves.times.map((time) => time + this.offset_s) };
  }

  /** Value within the recording; NaN before its start and after its end. */
  at(name: string, time_s: number): number {
    return time_s < this.first_s() || time_s > this.now_s()
      ? Number.NaN
      : this.own.at(name, time_s - this.offset_s);
  }

  exactAt(time_s: number): boolean {
    return this.own.exactAt?.(time_s - this.offset_s) ?? true;
  }

  table(names: readonly string[], stretch: TimeRange): SampleTable {
    const found = this.own.table(names, this.back(stretch));
    return { ...found, t: found.t.map((time) => time + this.offset_s) };
  }

  private back({ from_s, to_s }: TimeRange): TimeRange {
    return { from_s: from_s - this.offset_s, to_s: to_s - this.offset_s };
  }
}
