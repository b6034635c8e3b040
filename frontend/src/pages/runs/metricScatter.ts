/** Points over dates, laid out in pixels, with their axes. Pure. */

import { short } from "../../samples/format";

export interface Point {
  readonly run: number;
  /** Milliseconds since 1970. */
  readonly at: number;
  readonly value: number;
}

interface Tick {
  /** Place on its axis [px]. */
  readonly at: number;
  readonly label: string;
}

export interface Scatter {
  readonly points: readonly (Point & { readonly x: number; readonly y: number })[];
  /** Through all points, as a path of SVG. */
  readonly line: string;
  readonly values: readonly Tick[];
  readonly dates: readonly Tick[];
  readonly left: number;
}

const LEFT = 64;
const [RIGHT, TOP, BOTTOM] = [12, 12, 28];
const VALUES = 5;
const DATE_WIDTH = 130;

export function scatter(points: readonly Point[], width: number, height: number): Scatter {
  if (points.length === 0 || width <= LEFT + RIGHT) {
    return { points: [], line: "", values: [], dates: [], left: LEFT };
  }
  const [first, last] = widened(points.map(({ at }) => at));
  const ticks = steps(...widened(points.map(({ value }) => value)), VALUES);
  const [low, high] = [ticks[0] as number, ticks.at(-1) as number];
  const x = (at: number) => LEFT + ((at - first) / (last - first)) * (width - LEFT - RIGHT);
  const y = (value: number) => height - BOTTOM - ((value - low) / (high - low)) * (height - TOP - BOTTOM);
  const placed = points.map((point) => ({ ...point, x: x(point.at), y: y(point.value) }));
  const count = Math.max(2, Math.min(6, Math.floor((width - LEFT) / DATE_WIDTH)));
  const dates = Array.from({ length: count }, (_, index) => first + ((last - first) * index) / (count - 1));
  return {
    points: placed,
    line: placed.map((point, index) => `${index === 0 ? "M" : "L"}${point.x},${point.y}`).join(""),
    values: ticks.map((value) => ({ at: y(value), label: short(value) })),
    dates: dates.map((at) => ({ at: x(at), label: dated(at, last - first) })),
    left: LEFT,
  };
}

/** Smallest and largest, apart from each other where they are the same. */
function widened(values: readonly number[]): [number, number] {
  const low = values.reduce((least, value) => Math.min(least, value), Number.POSITIVE_INFINITY);
  const high = values.reduce((most, value) => Math.max(most, value), Number.NEGATIVE_INFINITY);
  const margin = high > low ? 0 : Math.abs(low) * 0.05 || 1;
  return [low - margin, high + margin];
}

/** Round numbers from at most `low` to at least `high`, evenly apart. */
export function steps(low: number, high: number, count: number): number[] {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
  const from = Math.floor(low / step);
  const to = Math.ceil(high / step);
  return Array.from({ length: to - from + 1 }, (_, index) => Number(((from + index) * step).toPrecision(12)));
}

const DAY_MS = 86_400_000;

function dated(at: number, span: number): string {
  const text = new Date(at).toISOString();
  return span > 3 * DAY_MS ? text.slice(0, 10) : `${text.slice(5, 10)} ${text.slice(11, 16)}`;
}
