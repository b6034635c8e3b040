/** Value axes that hold still: they widen at once, and narrow only when most of them is unused. Pure. */

import type { Extent } from "../samples/decimate";

export interface ValueRange {
  readonly min: number;
  readonly max: number;
}

const NARROW_BELOW = 0.4;
const MARGIN = 0.08;

/**
 * The range to draw for `extent`, given the range drawn before. Ends fall on round numbers; the range is never
 * narrower than `narrowest`, so that quantisation noise at rest does not fill the chart.
 */
export function steadyRange(before: ValueRange, extent: Extent, narrowest: number): ValueRange {
  if (extent.maximum < extent.minimum) return before;
  const fits = extent.minimum >= before.min && extent.maximum <= before.max;
  const used = Math.max(extent.maximum - extent.minimum, narrowest) / (before.max - before.min);
  if (fits && used > NARROW_BELOW) return before;
  return roundRange(extent, narrowest);
}

function roundRange(extent: Extent, narrowest: number): ValueRange {
  const span = Math.max(extent.maximum - extent.minimum, narrowest);
  const middle = (extent.maximum + extent.minimum) / 2;
  const half = span * (0.5 + MARGIN);
  const step = roundStep(span / 20);
  return { min: Math.floor((middle - half) / step) * step, max: Math.ceil((middle + half) / step) * step };
}

/** The smallest of 1, 2, 5 times a power of ten that is at least `raw`. */
export function roundStep(raw: number): number {
  const power = 10 ** Math.floor(Math.log10(raw));
  const digit = [1, 2, 5, 10].find((candidate) => candidate * power >= raw * (1 - 1e-9)) ?? 10;
  return digit * power;
}
