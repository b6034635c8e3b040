/** A step response as an SVG path. Pure. */

export interface StepDrawing {
  readonly path: string;
  /** Height of the final value 1 in the drawing. */
  readonly target: number;
  /** Value at the upper edge. */
  readonly top: number;
  /** First time at 90 % [s], null if it is not reached. */
  readonly t_90: number | null;
}

const TOP = 1.15;

/** The response `y(t)` from 0 to 1, with 15 % of room above; or up to `upper`, and
 * to `end_s`, so that two can be laid over each other; beyond its end the response stays where it came to. */
export function stepPath(
  t: readonly number[],
  y: readonly number[],
  width: number,
  height: number,
  upper?: number,
  end_s?: number,
): StepDrawing {
  const last = end_s ?? t.at(-1) ?? 1;
  const top = upper ?? Math.max(TOP, ...y);
  const level = (value: number) => height - (value / top) * height;
  const points = t.map(
    (time, index) => `${((time / last) * width).toFixed(1)} ${level(y[index] ?? 0).toFixed(1)}`,
  );
  if ((t.at(-1) ?? last) < last) points.push(`${width.toFixed(1)} ${level(y.at(-1) ?? 0).toFixed(1)}`);
  return {
    path: points.length === 0 ? "" : `M${points.join("L")}`,
    target: level(1),
    top,
    t_90: firstAt(0.9, t, y),
  };
}

/** First time at which `y` rises to `level`, on the straight line between two points. */
function firstAt(level: number, t: readonly number[], y: readonly number[]): number | null {
  const above = y.findIndex((value) => value >= level);
  const [t0, t1, y0, y1] = [t[above - 1], t[above], y[above - 1], y[above]];
  if (t1 === undefined || y1 === undefined) {
    return null;
  }
  return t0 === undefined || y0 === undefined ? t1 : t0 + ((level - y0) / (y1 - y0)) * (t1 - t0);
}
