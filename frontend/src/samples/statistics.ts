/** Figures of a signal over the stretch in sight. Pure. */

import type { Column } from "./table";

export interface Statistics {
  readonly minimum: number;
  readonly maximum: number;
  readonly mean: number;
  /** Standard deviation about the mean. */
  readonly deviation: number;
}

/**
 * Statistics of a column; NaN without any number. Of an envelope the extremes are exact, mean and deviation those of the
 * buckets' middles.
 */
export function statistics({ minimum, maximum }: Column): Statistics {
  let low = Number.POSITIVE_INFINITY;
  let high = Number.NEGATIVE_INFINITY;
  let count = 0;
  let mean = 0;
  let squares = 0;
  for (let row = 0; row < minimum.length; row++) {
    const a = minimum[row] as number;
    const b = maximum[row] as number;
    if (Number.isNaN(a) || Number.isNaN(b)) continue;
    if (a < low) low = a;
    if (b > high) high = b;
    count += 1;
    const value = (a + b) / 2;
    const shift = value - mean;
    mean += shift / count;
    squares += shift * (value - mean);
  }
  if (count === 0)
    return { minimum: Number.NaN, maximum: Number.NaN, mean: Number.NaN, deviation: Number.NaN };
  return { minimum: low, maximum: high, mean, deviation: Math.sqrt(squares / count) };
}
