/** Value axes that hold still: they widen at once, and narrow only when most of them is unused. Pure. */

import type { Extent } from "../samples/decimate";

export interface ValueRange {
  readonly min: number;
  readonly max: number;
}

const NARROW_BELOW = 0.4;
const MARGIN = 0.08;
const EDGE = 0.04;
const LOPSIDED = 0.4;

/**
 * The range to draw for `extent`, given the range drawn before. Ends fall on round numbers; the range is never
 * narrower than `narrowest`, so that quantisation noise at rest does not fill the chart.
 */
export function steadyRange(before: ValueRange, extent: Extent, narrowest: number): ValueRange {
  if (extent.maximum < extent.minimum) return before;
  const fits = extent.minimum >= before.min && extent.maximum <= before.max;
  const used = Math.max(extent.maximum - extent.minimum, narrowest) / (before.max - before.min);
  if (fits && used > NARROW_BELOW && !hugsAnEdge(before, extent)) return before;
  return roundRange(extent, narrowest);
}

/** Whether the curves lie at one end of the axis while most of the rest is empty. */
function hugsAnEdge(range: ValueRange, extent: Extent): boolean {
  const span = range.max - range.min;
  const [below, above] = [extent.minimum - range.min, range.max - extent.maximum];
  return Math.min(below, above) < EDGE * span && Math.abs(above - below) > LOPSIDED * span;
}

/** A range for what was never drawn before: all of `extent`, or around zero where there is nothing. */
export function roundedRange(extent: Extent, narrowest: number): ValueRange {
  const nothing = extent.maximum < extent.minimum;
  return roundRange(nothing ? { minimum: 0, maximum: 0 } : extent, narrowest);
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

/** Powers of ten below the greatest value that are worth an axis; what lies lower is rounding. */
const DECADES = 12;

/** Whole decades around positive values for a logarithmic axis; one decade when there is nothing to show. */
export function decadeRange(min: number | null, max: number | null): [number, number] {
  if (max === null || !(max > 0) || !Number.isFinite(max)) return [0.1, 1];
  const top = Math.ceil(Math.log10(max));
  const lowest = min === null || !(min > 0) ? max : min;
  const bottom = Math.min(Math.max(Math.floor(Math.log10(lowest)), top - DECADES), top - 1);
  return [10 ** bottom, 10 ** top];
}
