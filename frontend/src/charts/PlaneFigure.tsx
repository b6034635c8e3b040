import { useMemo } from "react";
import type { Extent } from "../samples/decimate";
import { fixed } from "../samples/format";
import type { TimeRange } from "../samples/timeSeries";
import { dashOf, type Panel, type Trace } from "../theme/signals";
import { roundStep, steadyRange, tickLabels, type ValueRange } from "./axes";
import styles from "./Charts.module.css";
import { type Drawing, type Surface, useCanvas } from "./canvas";
import { Legend } from "./Legend";
import { AXIS_WIDTH, RIGHT_MARGIN } from "./plot";
import type { Pairs, PlotSource } from "./sources";

/** One signal over another: points of a time range, their axes, and the drawing. */

export type Plane = Panel & { readonly over: NonNullable<Panel["over"]> };

/** Maximum number of points of a curve, sufficient for a few hundred pixels. */
const POINTS = 3000;
const TOP = 8;
const FOOT = 22;
const TICK_SPACE_PX = { x: 70, y: 26 } as const;
const LINE_WIDTH = 1.4;
const DOT_PX = 3.5;
const FONT = "11px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";

export function isPlane(panel: Panel): panel is Plane {
  return panel.over !== undefined;
}

/** Points of one trace, in the units shown. */
export function pointsOf(source: PlotSource, plane: Plane, trace: Trace, seen: TimeRange): Pairs {
  const mark = /[′⁰¹²³⁴-⁹]*$/.exec(trace.name)?.[0] ?? "";
  const over = plane.over.name + mark;
  const { x, y } =
    source.pairs?.(over, trace.name, seen, POINTS) ?? fromCurves(source, over, trace.name, seen);
  return { x: x.map((value) => value * plane.over.factor), y: y.map((value) => value * plane.factor) };
}

/** Pairs from the curves of a source without `pairs`, at their common times. */
function fromCurves(source: PlotSource, x: string, y: string, seen: TimeRange): Pairs {
  const traces = [x, y].map((name): Trace => ({ name, hue: "", dashed: false }));
  const plain = { title: "", unit: "1", factor: 1, decimals: 0, narrowest: 1, traces };
  const { times, values } = source.curves(plain, seen, POINTS / 4);
  const inside = (_: number, row: number) =>
    (times[row] as number) >= seen.from_s && (times[row] as number) <= seen.to_s;
  const [ofX, ofY] = values as [Float64Array, Float64Array];
  return { x: ofX.filter(inside), y: ofY.filter(inside) };
}

/** Extent of all points that are drawn. */
export function extentOf(values: readonly ArrayLike<number>[]): Extent {
  const extent: Extent = { minimum: Number.POSITIVE_INFINITY, maximum: Number.NEGATIVE_INFINITY };
  for (const column of values) {
    for (let row = 0; row < column.length; row++) {
      const value = column[row] as number;
      if (value < extent.minimum) extent.minimum = value;
      if (value > extent.maximum) extent.maximum = value;
    }
  }
  return extent;
}

interface PlaneRanges {
  readonly x: ValueRange;
  readonly y: ValueRange;
}

/** Steady axis ranges, like those of charts over time. */
export function rangesFor(before: PlaneRanges | null, plane: Plane, curves: readonly Pairs[]): PlaneRanges {
  const empty = (narrowest: number) => ({ min: -narrowest / 2, max: narrowest / 2 });
  const { x, y } = before ?? { x: empty(plane.over.narrowest), y: empty(plane.narrowest) };
  return {
    x: steadyRange(x, extentOf(curves.map((curve) => curve.x)), plane.over.narrowest),
    y: steadyRange(y, extentOf(curves.map((curve) => curve.y)), plane.narrowest),
  };
}

/** Lines of an axis with their labels. */
export function gridOf({ min, max }: ValueRange, length_px: number, space_px: number): [number, string][] {
  const step = roundStep(((max - min) * space_px) / Math.max(length_px, 1));
  const first = Math.ceil(min / step - 1e-9);
  const count = Math.floor(max / step + 1e-9) - first + 1;
  const splits = Array.from({ length: Math.max(0, count) }, (_, n) => (first + n) * step);
  return tickLabels(splits, step).map((label, n) => [splits[n] as number, label]);
}

interface Frame {
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
}

/** Plotting area of a drawing. */
function frameOf(width: number, height: number): Frame {
  return {
    left: AXIS_WIDTH,
    top: TOP,
    width: Math.max(1, width - AXIS_WIDTH - RIGHT_MARGIN),
    height: Math.max(1, height - TOP - FOOT),
  };
}

export interface DrawnPlane {
  readonly traces: readonly Trace[];
  readonly curves: readonly Pairs[];
  /** Current point of each trace. */
  readonly dots: readonly { readonly x: number; readonly y: number }[];
  readonly ranges: PlaneRanges;
}

function paintPlane({ context: pen, width, height, colours }: Surface, drawn: DrawnPlane): void {
  const frame = frameOf(width, height);
  const { x, y } = drawn.ranges;
  const px = (value: number) => frame.left + ((value - x.min) / (x.max - x.min)) * frame.width;
  const py = (value: number) => frame.top + ((y.max - value) / (y.max - y.min)) * frame.height;
  pen.font = FONT;
  pen.fillStyle = colours.axis;
  pen.strokeStyle = colours.grid;
  pen.lineWidth = 1;
  pen.setLineDash([]);
  pen.beginPath();
  pen.textAlign = "center";
  pen.textBaseline = "top";
  for (const [value, label] of gridOf(x, frame.width, TICK_SPACE_PX.x)) {
    const at = Math.round(px(value)) + 0.5;
    pen.moveTo(at, frame.top);
    pen.lineTo(at, frame.top + frame.height);
    pen.fillText(label, at, frame.top + frame.height + 6);
  }
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (const [value, label] of gridOf(y, frame.height, TICK_SPACE_PX.y)) {
    const at = Math.round(py(value)) + 0.5;
    pen.moveTo(frame.left, at);
    pen.lineTo(frame.left + frame.width, at);
    pen.fillText(label, frame.left - 6, at);
  }
  pen.stroke();
  pen.lineJoin = "round";
  for (const [index, trace] of drawn.traces.entries()) {
    const { x: xs, y: ys } = drawn.curves[index] as Pairs;
    pen.strokeStyle = colours.drawn(trace.hue);
    pen.lineWidth = LINE_WIDTH * (trace.broad ? 2 : 1);
    pen.setLineDash(dashOf(trace));
    pen.beginPath();
    let down = false;
    for (let row = 0; row < xs.length; row++) {
      const there = !Number.isNaN(xs[row]) && !Number.isNaN(ys[row]);
      if (there && down) pen.lineTo(px(xs[row] as number), py(ys[row] as number));
      else if (there) pen.moveTo(px(xs[row] as number), py(ys[row] as number));
      down = there;
    }
    pen.stroke();
  }
  pen.setLineDash([]);
  for (const [index, dot] of drawn.dots.entries()) {
    if (Number.isNaN(dot.x) || Number.isNaN(dot.y)) continue;
    pen.beginPath();
    pen.arc(px(dot.x), py(dot.y), DOT_PX, 0, 2 * Math.PI);
    const hue = drawn.traces[index]?.hue;
    pen.fillStyle = hue === undefined ? colours.text : colours.drawn(hue);
    pen.fill();
    pen.strokeStyle = colours.panel;
    pen.lineWidth = 1;
    pen.stroke();
  }
}

/** Chart of signals over a signal, for the time range of the charts above. */

interface PlaneProps {
  readonly plane: Plane;
  /** Index among all panels. */
  readonly place: number;
  readonly source: PlotSource;
  readonly hidden: ReadonlySet<string>;
  seen(): TimeRange;
  /** Time of the legends' values. */
  readoutTime(): number;
  onToggle(name: string): void;
}

export function PlaneFigure({ plane, place, source, hidden, seen, readoutTime, onToggle }: PlaneProps) {
  const drawing = useMemo(
    () => drawingOf(plane, source, hidden, seen, readoutTime),
    [plane, source, hidden, seen, readoutTime],
  );
  const canvas = useCanvas(drawing);
  return (
    <figure className={styles.plane} aria-label={plane.title} data-panel={place}>
      <Legend panel={plane} hidden={hidden} onToggle={onToggle} onHighlight={() => undefined} />
      <div className={styles.planeHost} aria-hidden="true">
        <canvas ref={canvas} className={styles.planeCanvas} />
      </div>
    </figure>
  );
}

function drawingOf(
  plane: Plane,
  source: PlotSource,
  hidden: ReadonlySet<string>,
  seen: () => TimeRange,
  readoutTime: () => number,
): Drawing {
  let ranges: PlaneRanges | null = null;
  return {
    signature: () => {
      const { from_s, to_s } = seen();
      return [source.version(), from_s, to_s, readoutTime()].map((part) => fixed(part, 3)).join(" ");
    },
    paint: (surface) => {
      const drawn = drawnNow(plane, source, hidden, seen(), readoutTime(), ranges);
      ranges = drawn.ranges;
      paintPlane(surface, drawn);
    },
  };
}

/** Contents of the chart for a time range. */
export function drawnNow(
  plane: Plane,
  source: PlotSource,
  hidden: ReadonlySet<string>,
  seen: TimeRange,
  readout_s: number,
  before: PlaneRanges | null,
): DrawnPlane {
  const traces = plane.traces.filter(({ name }) => !hidden.has(name));
  const curves = traces.map((trace) => pointsOf(source, plane, trace, seen));
  const dots = traces.map(({ name }) => ({
    x: source.at(plane.over.name, readout_s) * plane.over.factor,
    y: source.at(name, readout_s) * plane.factor,
  }));
  return { traces, curves, dots, ranges: rangesFor(before, plane, curves) };
}
