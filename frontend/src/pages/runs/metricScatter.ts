/** Points over dates, laid out in pixels, with their axes. Pure. */

import { tickLabels } from "../../charts/ticks";
import { dateTime } from "../../samples/format";

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
  /** `label` is the value, told ten times as finely as the lines are apart. */
  readonly points: readonly (Point & { readonly x: number; readonly y: number; readonly label: string })[];
  /** Through all points, as a path of SVG. */
  readonly line: string;
  readonly values: readonly Tick[];
  readonly dates: readonly Tick[];
  readonly left: number;
}

const LEFT = 64;
const [RIGHT, TOP, BOTTOM] = [12, 12, 28];
const VALUES = 5;
/** Values that differ by less of themselves are the same. */
const EVEN = 1e-9;
const DATE_WIDTH = 130;
const MOST_DATES = 6;
const MINUTE_MS = 60_000;
/** So that dates to the minute differ. */
const SHORTEST_MS = (MOST_DATES - 1) * MINUTE_MS;
const LONGEST_DAY_MS = 25 * 60 * MINUTE_MS;

export function scatter(points: readonly Point[], width: number, height: number): Scatter {
  if (points.length === 0 || width <= LEFT + RIGHT) {
    return { points: [], line: "", values: [], dates: [], left: LEFT };
  }
  const [first, last] = widened(extent(points.map(({ at }) => at)), SHORTEST_MS);
  const values = extent(points.map(({ value }) => value));
  const size = Math.max(...values.map(Math.abs));
  const ticks = steps(...widened(values, values[1] - values[0] > EVEN * size ? 0 : size / 10 || 2), VALUES);
  const [low, high] = [ticks[0] as number, ticks.at(-1) as number];
  const step = (high - low) / (ticks.length - 1);
  const labels = tickLabels(ticks, step);
  const x = (at: number) => LEFT + ((at - first) / (last - first)) * (width - LEFT - RIGHT);
  const y = (value: number) => height - BOTTOM - ((value - low) / (high - low)) * (height - TOP - BOTTOM);
  const placed = points.map((point) => ({
    ...point,
    x: x(point.at),
    y: y(point.value),
    label: tickLabels([point.value], step / 10)[0] as string,
  }));
  const count = Math.max(2, Math.min(MOST_DATES, Math.floor((width - LEFT) / DATE_WIDTH)));
  const dates = Array.from({ length: count }, (_, index) => first + ((last - first) * index) / (count - 1));
  return {
    points: placed,
    line: placed.map((point, index) => `${index === 0 ? "M" : "L"}${point.x},${point.y}`).join(""),
    values: ticks.map((value, place) => ({ at: y(value), label: labels[place] as string })),
    dates: dates.map((at) => ({ at: x(at), label: dated(at, (last - first) / (count - 1)) })),
    left: LEFT,
  };
}

/** Smallest and largest. */
function extent(values: readonly number[]): [number, number] {
  const low = values.reduce((least, value) => Math.min(least, value), Number.POSITIVE_INFINITY);
  const high = values.reduce((most, value) => Math.max(most, value), Number.NEGATIVE_INFINITY);
  return [low, high];
}

/** A stretch about the same middle, at least so long. */
function widened([low, high]: readonly [number, number], least: number): [number, number] {
  const margin = Math.max(0, least - (high - low)) / 2;
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

/** In the person's own zone: the day where the instants are further apart than any day is long, else the minute too. */
function dated(at: number, step: number): string {
  const text = dateTime(new Date(at).toISOString());
  return step > LONGEST_DAY_MS ? text.slice(0, 10) : text.slice(5, 16);
}
