/** Computes axes: steady value ranges, tick labels, and times. Pure. */

import type { Extent } from "../samples/decimate";
import { clockTime, dayTime, decimalsOf, fixed, MINUS } from "../samples/format";
import { TEXTS } from "./texts";

/** Labels of grid lines with the exact value of each line. Pure. */

/** Number of decimals, or of digits before the point, above which a label has an exponent. */
const LONGEST = 6;

/** Labels of grid lines at distance `step`, with as many digits as the distance needs. */
export function tickLabels(splits: readonly (number | null)[], step: number): string[] {
  const decimals = decimalsOf(step);
  const greatest = Math.max(...splits.map((split) => Math.abs(split ?? 0)));
  if (decimals <= LONGEST && greatest < 10 ** LONGEST)
    return splits.map((split) => (split === null ? "" : fixed(split, Math.max(0, decimals))));
  return splits.map((split) => {
    if (split === null) return "";
    // A value nearer to zero than to the next line is zero with a rounding error.
    if (Math.abs(split) < step / 2) return "0";
    const power = Math.floor(Math.log10(Math.abs(split)) + 1e-9);
    return exponential(split, Math.max(0, decimals + power));
  });
}

/** Labels of a logarithmic axis; null for lines that the chart omits. */
export function logLabels(splits: readonly (number | null)[]): string[] {
  return splits.map((split) => {
    if (split === null) return "";
    const power = Math.floor(Math.log10(Math.abs(split)) + 1e-9);
    const exact = Number(split.toPrecision(4));
    if (power < -3 || power > 3) return exponential(exact, decimalsOf(Math.abs(exact)) + power);
    return String(exact).replace("-", MINUS);
  });
}

function exponential(value: number, digits: number): string {
  return value.toExponential(digits).replace("e+", "e").replaceAll("-", MINUS);
}

/** Lines and labels of a time axis: time since the start, or time of day. Pure. */

/** Possible distances between the lines [s]. */
export const TIME_STEPS_S = [
  0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800,
  3600,
];

/** Lines at round times; `epoch_s` is the time of day at time 0, null for time since the start. */
export function splitsOf(from_s: number, to_s: number, step_s: number, epoch_s: number | null): number[] {
  const zone_s = epoch_s === null ? 0 : 60 * new Date(1000 * epoch_s).getTimezoneOffset();
  const shift_s = ((epoch_s ?? 0) - zone_s) % step_s;
  const first = Math.ceil((from_s + shift_s) / step_s - 1e-6);
  const last = Math.floor((to_s + shift_s) / step_s + 1e-6);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, n) => (first + n) * step_s - shift_s);
}

/** A time as a label of the axis. */
export function timeText(time_s: number, step_s: number, epoch_s: number | null): string {
  return epoch_s === null ? clockTime(time_s, step_s) : dayTime(epoch_s + time_s, step_s);
}

/** A time as a label of a printed axis: in seconds, or the time of day. */
export function printedTime(time_s: number, step_s: number, epoch_s: number | null): string {
  if (epoch_s !== null) return dayTime(epoch_s + time_s, step_s);
  return fixed(time_s, Math.max(0, decimalsOf(step_s)));
}

/** Title of a printed time axis. */
export function timeTitle(epoch_s: number | null): string {
  return epoch_s === null ? TEXTS.timeSinceStart : TEXTS.timeOfDay;
}

/** The smallest distance of lines with at least `space_px` for each. */
export function stepFor(span_s: number, width_px: number, space_px: number): number {
  const least_s = (span_s * space_px) / width_px;
  return TIME_STEPS_S.find((step_s) => step_s >= least_s) ?? 3600 * Math.ceil(least_s / 3600);
}

/** Steady value axes: they widen at once, and narrow only when most of the range is unused. */

export interface ValueRange {
  readonly min: number;
  readonly max: number;
}

const NARROW_BELOW = 0.4;
const MARGIN = 0.08;
const EDGE = 0.04;
const LOPSIDED = 0.4;

/**
 * Returns the range to draw for `extent`, given the previous range. The ends are round numbers; the range is at least
 * `narrowest`, so that quantization noise at rest does not fill the chart.
 */
export function steadyRange(before: ValueRange, extent: Extent, narrowest: number): ValueRange {
  if (extent.maximum < extent.minimum) return before;
  const fits = extent.minimum >= before.min && extent.maximum <= before.max;
  const used = Math.max(extent.maximum - extent.minimum, narrowest) / (before.max - before.min);
  if (fits && used > NARROW_BELOW && !hugsAnEdge(before, extent)) return before;
  return roundRange(extent, narrowest);
}

/** Whether the curves are at one end of the axis while most of the rest is empty. */
function hugsAnEdge(range: ValueRange, extent: Extent): boolean {
  const span = range.max - range.min;
  const [below, above] = [extent.minimum - range.min, range.max - extent.maximum];
  return Math.min(below, above) < EDGE * span && Math.abs(above - below) > LOPSIDED * span;
}

/** Range without a previous one: all of `extent`, or around zero if it is empty. */
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

/** Decades shown below the greatest value; smaller values are rounding errors. */
const DECADES = 12;

/** Whole decades around positive values for a logarithmic axis; one decade without values. */
export function decadeRange(min: number | null, max: number | null): [number, number] {
  if (max === null || !(max > 0) || !Number.isFinite(max)) return [0.1, 1];
  const top = Math.ceil(Math.log10(max));
  const lowest = min === null || !(min > 0) ? max : min;
  const bottom = Math.min(Math.max(Math.floor(Math.log10(lowest)), top - DECADES), top - 1);
  return [10 ** bottom, 10 ** top];
}
