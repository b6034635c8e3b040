/** Where the lines of a time axis stand and what they say: since the start, or the time of day. Pure. */

import { clockTime, dayTime, decimalsOf, fixed } from "../samples/format";

/** Distances between the lines, of which those are taken that leave room for their labels [s]. */
export const TIME_STEPS_S = [
  0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800,
  3600,
];

/** Lines at round times; `epoch_s` is the time of day at time 0, null where that is not what is told. */
export function splitsOf(from_s: number, to_s: number, step_s: number, epoch_s: number | null): number[] {
  const zone_s = epoch_s === null ? 0 : 60 * new Date(1000 * epoch_s).getTimezoneOffset();
  const shift_s = ((epoch_s ?? 0) - zone_s) % step_s;
  const first = Math.ceil((from_s + shift_s) / step_s - 1e-6);
  const last = Math.floor((to_s + shift_s) / step_s + 1e-6);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, n) => (first + n) * step_s - shift_s);
}

/** A moment as the axis tells it. */
export function timeText(time_s: number, step_s: number, epoch_s: number | null): string {
  return epoch_s === null ? clockTime(time_s, step_s) : dayTime(epoch_s + time_s, step_s);
}

/** A moment as the axis of a printed drawing tells it: in seconds, or the time of day. */
export function printedTime(time_s: number, step_s: number, epoch_s: number | null): string {
  if (epoch_s !== null) return dayTime(epoch_s + time_s, step_s);
  return fixed(time_s, Math.max(0, decimalsOf(step_s)));
}

/** What such an axis is of. */
export function timeTitle(epoch_s: number | null): string {
  return epoch_s === null ? "time since the start [s]" : "time of day";
}

/** The finest distance of lines that leaves `room_px` for each. */
export function stepFor(span_s: number, width_px: number, room_px: number): number {
  const least_s = (span_s * room_px) / width_px;
  return TIME_STEPS_S.find((step_s) => step_s >= least_s) ?? 3600 * Math.ceil(least_s / 3600);
}
