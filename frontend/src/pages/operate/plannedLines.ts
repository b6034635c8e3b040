/** The planned profile as a picture: lines within a box, in parts of its width and height. Pure. */

import type { Planned } from "../../wire/types";

export interface Line {
  /** Of an SVG polyline, over a box of WIDTH × HEIGHT. */
  readonly points: string;
  readonly lowest: number;
  readonly highest: number;
}

export const WIDTH = 1000;
export const HEIGHT = 40;
const MARGIN = 3;

/** Values over the times of a profile; a level line where all are alike. */
export function lineOf(t: readonly number[], values: readonly number[]): Line {
  const lowest = Math.min(...values);
  const highest = Math.max(...values);
  const whole_s = t[t.length - 1] ?? 0;
  const span = highest - lowest;
  const points = values.map((value, at) => {
    const up = span === 0 ? 0.5 : (value - lowest) / span;
    const x = whole_s === 0 ? 0 : (WIDTH * (t[at] ?? 0)) / whole_s;
    return `${x.toFixed(1)},${(MARGIN + (HEIGHT - 2 * MARGIN) * (1 - up)).toFixed(1)}`;
  });
  return { points: points.join(" "), lowest, highest };
}

/** Where an instant stands, and what is asked for then: the last value at or before it. */
export function momentOf({ t, q_ref, S_ref }: Planned, at_s: number) {
  const whole_s = t[t.length - 1] ?? 0;
  const after = t.findIndex((one) => one > at_s + 1e-9);
  const place = after === -1 ? t.length - 1 : Math.max(0, after - 1);
  return {
    x: whole_s === 0 ? 0 : WIDTH * Math.min(1, Math.max(0, at_s / whole_s)),
    q_ref: q_ref[place] ?? Number.NaN,
    S_ref: S_ref[place] ?? Number.NaN,
  };
}
