/** Stored samples or their min/max envelope as points of a curve. Pure. */

import type { Excerpt } from "../wire/curves";
import type { Extent } from "./decimate";

export interface Points {
  readonly times: Float64Array;
  readonly values: Float64Array;
  readonly extent: Extent;
}

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

/** Values of one signal times `factor`; of each bucket, the extreme nearer to the point before comes first. */
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

/** Share of the distance of two times by which a time may miss its own: 0.3 is not 300 times 0.001. */
const EXACT = 1e-3;

/** Index of the last time at or before `wanted` in ascending `times`; -1 where it is before all of them. */
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
