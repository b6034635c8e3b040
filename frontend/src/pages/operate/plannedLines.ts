/** The planned profile as a picture: lines within a box, in parts of its width and height. Pure. */

export interface Line {
  /** Of SVG polylines, over a box of WIDTH × HEIGHT. */
  readonly pieces: readonly string[];
  readonly lowest: number;
  readonly highest: number;
}

export const WIDTH = 1000;
export const HEIGHT = 40;
const MARGIN = 3;

/** Values over the times of a profile; a level line where all are alike, and none where the plan leaves them open. */
export function lineOf(t: readonly number[], values: readonly (number | null)[]): Line {
  const given = values.filter((value) => value !== null);
  const lowest = Math.min(...given);
  const highest = Math.max(...given);
  const whole_s = t[t.length - 1] ?? 0;
  const span = highest - lowest;
  const pieces: string[][] = [[]];
  values.forEach((value, at) => {
    if (value === null) {
      if (pieces[pieces.length - 1]?.length !== 0) pieces.push([]);
      return;
    }
    const up = span === 0 ? 0.5 : (value - lowest) / span;
    const x = whole_s === 0 ? 0 : (WIDTH * (t[at] ?? 0)) / whole_s;
    const point = `${x.toFixed(1)},${(MARGIN + (HEIGHT - 2 * MARGIN) * (1 - up)).toFixed(1)}`;
    pieces[pieces.length - 1]?.push(point);
  });
  return {
    pieces: pieces.filter((piece) => piece.length > 0).map((piece) => piece.join(" ")),
    lowest,
    highest,
  };
}

/** Where an instant stands in the picture. */
export function placeOf(t: readonly number[], at_s: number): number {
  const whole_s = t[t.length - 1] ?? 0;
  return whole_s === 0 ? 0 : WIDTH * Math.min(1, Math.max(0, at_s / whole_s));
}

/** What is asked for at an instant: the last value at or before it; null where the plan leaves it open. */
export function valueAt(t: readonly number[], values: readonly (number | null)[], at_s: number) {
  const after = t.findIndex((one) => one > at_s + 1e-9);
  return values[after === -1 ? t.length - 1 : Math.max(0, after - 1)] ?? null;
}
