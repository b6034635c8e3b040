/** Reduces samples to the points that are drawn: min/max of buckets, and curves of stored envelopes. Pure. */

import type { Excerpt } from "../wire/curves";
import { BLOCK_TICKS, type Column, type SampleWindow } from "./window";

/**
 * Reduces samples to the two to four points per pixel that a chart needs, and preserves every extreme.
 *
 * Buckets are powers of two of ticks and start at multiples of their length, so that a scrolling curve has the same
 * points in each frame.
 */

/** Reduced time range. Ticks are fractional only at the middle of a bucket. */
interface Grid {
  readonly fromTick: number;
  readonly bucket: number;
  readonly buckets: number;
}

export interface Extent {
  minimum: number;
  maximum: number;
}

/** Length of a bucket in ticks so that `span` ticks on `pixels` give one to two buckets per pixel. */
export function bucketTicks(span: number, pixels: number): number {
  const wanted = span / (2 * Math.max(pixels, 1));
  return wanted <= 1 ? 1 : 2 ** Math.ceil(Math.log2(wanted));
}

/** Buckets that cover the ticks from `from` to `to`, clipped to the ticks of the window. */
export function gridOver(window: SampleWindow, from: number, to: number, pixels: number): Grid {
  const bucket = bucketTicks(to - from, pixels);
  const first = Math.floor(Math.max(from, window.startTick) / bucket);
  const last = Math.ceil(Math.min(to + 1, window.endTick) / bucket);
  return { fromTick: first * bucket, bucket, buckets: Math.max(0, last - first) };
}

/** Number of points of a grid for each signal. */
export function pointCount(grid: Grid): number {
  return grid.bucket === 1 ? grid.buckets : 2 * grid.buckets;
}

/** Writes the times [s] of a grid's points. */
export function writeTimes(grid: Grid, period_s: number, out: Float64Array): void {
  const points = pointCount(grid);
  const step = grid.bucket === 1 ? 1 : grid.bucket / 2;
  for (let point = 0; point < points; point++) out[point] = (grid.fromTick + point * step) * period_s;
}

/**
 * Writes the values of one signal over a grid, times `factor`: raw samples, or the two extremes of each bucket in the
 * order of a rising or falling curve. Returns the extent of the values (empty: minimum > maximum).
 */
export function writeValues(
  window: SampleWindow,
  name: string,
  grid: Grid,
  factor: number,
  out: Float64Array,
): Extent {
  const extent: Extent = { minimum: Number.POSITIVE_INFINITY, maximum: Number.NEGATIVE_INFINITY };
  const column = window.columns.get(name);
  if (column === undefined) {
    out.fill(Number.NaN, 0, pointCount(grid));
  } else if (grid.bucket === 1) {
    writeRaw(window, column, grid, factor, out, extent);
  } else {
    writeExtremes(window, column, grid, factor, out, extent);
  }
  return extent;
}

function writeRaw(
  window: SampleWindow,
  column: Column,
  grid: Grid,
  factor: number,
  out: Float64Array,
  extent: Extent,
): void {
  for (let point = 0; point < grid.buckets; point++) {
    const value = factor * (column.samples[(grid.fromTick + point) & (window.capacity - 1)] as number);
    out[point] = value;
    widen(extent, value, value);
  }
}

function writeExtremes(
  window: SampleWindow,
  column: Column,
  grid: Grid,
  factor: number,
  out: Float64Array,
  extent: Extent,
): void {
  const found: Extent = { minimum: 0, maximum: 0 };
  for (let index = 0; index < grid.buckets; index++) {
    const from = Math.max(grid.fromTick + index * grid.bucket, window.startTick);
    const to = Math.min(grid.fromTick + (index + 1) * grid.bucket, window.endTick);
    scan(window, column, from, to, found);
    const minimum = factor * found.minimum;
    const maximum = factor * found.maximum;
    const mask = window.capacity - 1;
    const rising = (column.samples[from & mask] as number) <= (column.samples[(to - 1) & mask] as number);
    out[2 * index] = rising ? minimum : maximum;
    out[2 * index + 1] = rising ? maximum : minimum;
    widen(extent, minimum, maximum);
  }
}

/** Extremes of the ticks from `from` to `to`, from the extremes of whole blocks where possible; NaN if empty. */
function scan(window: SampleWindow, column: Column, from: number, to: number, found: Extent): void {
  const mask = window.capacity - 1;
  const blockMask = window.capacity / BLOCK_TICKS - 1;
  let minimum = Number.POSITIVE_INFINITY;
  let maximum = Number.NEGATIVE_INFINITY;
  let tick = from;
  while (tick < to) {
    let low: number;
    let high: number;
    if (tick % BLOCK_TICKS === 0 && tick + BLOCK_TICKS <= to) {
      const block = (tick / BLOCK_TICKS) & blockMask;
      low = column.minima[block] as number;
      high = column.maxima[block] as number;
      tick += BLOCK_TICKS;
    } else {
      low = column.samples[tick & mask] as number;
      high = low;
      tick += 1;
    }
    if (low < minimum) minimum = low;
    if (high > maximum) maximum = high;
  }
  const empty = maximum < minimum;
  found.minimum = empty ? Number.NaN : minimum;
  found.maximum = empty ? Number.NaN : maximum;
}

function widen(extent: Extent, minimum: number, maximum: number): void {
  if (minimum < extent.minimum) extent.minimum = minimum;
  if (maximum > extent.maximum) extent.maximum = maximum;
}

/** Stored samples or their min/max envelope as points of a curve. Pure. */

/** Times of the points of all signals: one per raw sample, two per bucket of an envelope. */
export function pointTimes(samples: Excerpt): Float64Array {
  if (samples.raw) return samples.t;
  const times = new Float64Array(2 * samples.t.length);
  for (const [index, t] of samples.t.entries()) {
    times[2 * index] = t;
    times[2 * index + 1] = t + samples.width_s / 2;
  }
  return times;
}

/** Values of one signal times `factor`; in each bucket, the extreme nearer to the previous point comes first. */
export function pointValues(
  samples: Excerpt,
  name: string,
  factor: number,
): { values: Float64Array; extent: Extent } {
  const signal = samples.signals[name];
  const perBucket = samples.raw ? 1 : 2;
  const values = new Float64Array(perBucket * samples.t.length).fill(Number.NaN);
  const extent: Extent = { minimum: Number.POSITIVE_INFINITY, maximum: Number.NEGATIVE_INFINITY };
  if (signal === undefined) return { values, extent };
  let before = 0;
  for (let index = 0; index < samples.t.length; index++) {
    const minimum = factor * (signal.minimum[index] ?? Number.NaN);
    const maximum = factor * (signal.maximum[index] ?? Number.NaN);
    if (minimum < extent.minimum) extent.minimum = minimum;
    if (maximum > extent.maximum) extent.maximum = maximum;
    if (samples.raw) {
      values[index] = minimum;
      continue;
    }
    const lowFirst = Math.abs(minimum - before) <= Math.abs(maximum - before);
    values[2 * index] = lowFirst ? minimum : maximum;
    values[2 * index + 1] = lowFirst ? maximum : minimum;
    before = lowFirst ? maximum : minimum;
  }
  return { values, extent };
}

/** Tolerance of a time as a share of the interval, for rounding: 0.3 is not 300 times 0.001. */
const EXACT = 1e-3;

/** Index of the last time at or before `wanted` in ascending `times`; -1 if all of them are later. */
export function atOrBefore(times: ArrayLike<number>, wanted: number): number {
  const slack = times.length > 1 ? EXACT * ((times[1] as number) - (times[0] as number)) : 0;
  let low = -1;
  let high = times.length;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if ((times[middle] as number) <= wanted + slack) low = middle;
    else high = middle;
  }
  return low;
}
