/** Figures of a signal over the stretch in sight. Pure. */

import type { Column } from "./table";

export interface Statistics {
  readonly minimum: number;
  /** Where it is first: of an envelope, where its bucket begins [s]. */
  readonly minimum_s: number;
  readonly maximum: number;
  readonly maximum_s: number;
  readonly mean: number;
  /** Standard deviation about the mean, divided by the number of values. */
  readonly deviation: number;
  /** Samples, or buckets, that have a value and that have none. */
  readonly values: number;
  readonly withoutValue: number;
}

const NOTHING: Statistics = {
  minimum: Number.NaN,
  minimum_s: Number.NaN,
  maximum: Number.NaN,
  maximum_s: Number.NaN,
  mean: Number.NaN,
  deviation: Number.NaN,
  values: 0,
  withoutValue: 0,
};

/**
 * Statistics of a column over the times of its rows; NaN without any number. Of an envelope (not `raw`) the extremes
 * are exact, and there is no mean or deviation: they need every sample.
 */
export function statistics({ minimum, maximum }: Column, t: ArrayLike<number>, raw: boolean): Statistics {
  let low = Number.POSITIVE_INFINITY;
  let high = Number.NEGATIVE_INFINITY;
  let [lowRow, highRow] = [0, 0];
  let count = 0;
  let mean = 0;
  let squares = 0;
  for (let row = 0; row < minimum.length; row++) {
    const a = minimum[row] as number;
    const b = maximum[row] as number;
    if (Number.isNaN(a) || Number.isNaN(b)) continue;
    if (a < low) [low, lowRow] = [a, row];
    if (b > high) [high, highRow] = [b, row];
    count += 1;
    const shift = a - mean;
    mean += shift / count;
    squares += shift * (a - mean);
  }
  const withoutValue = minimum.length - count;
  if (count === 0) return { ...NOTHING, withoutValue };
  return {
    minimum: low,
    minimum_s: t[lowRow] as number,
    maximum: high,
    maximum_s: t[highRow] as number,
    mean: raw ? mean : Number.NaN,
    deviation: raw ? Math.sqrt(squares / count) : Number.NaN,
    values: count,
    withoutValue,
  };
}
