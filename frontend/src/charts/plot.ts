/** Draws charts with uPlot: paths of curves, one chart, and the stack of charts on one time axis. */

import uPlot from "uplot";
import { paintsInSoftware, withMemoryCanvases } from "../drawing/canvas";
import { FramePacer } from "../drawing/pacer";
import type { TimeRange } from "../samples/timeSeries";
import { dashOf, type Panel } from "../theme/signals";
import { splitsOf, steadyRange, TIME_STEPS_S, tickLabels, timeText, type ValueRange } from "./axes";
import { type ChartColours, readColours } from "./canvas";
import {
  drawLimitLabels,
  drawLimits,
  drawMarks,
  type LimitLine,
  linesOf,
  MARK_LANE_PX,
  type PlacedMark,
} from "./decorations";
import type { Curves, PlotSource } from "./sources";
import { type Viewport, visibleRange } from "./viewport";

/** Path of a curve from typed arrays; NaN interrupts the line, so that missing samples are gaps. */

const NO_FLAGS = 0;

export function linePath(plot: uPlot, series: number, first: number, last: number): uPlot.Series.Paths {
  const stroke = new Path2D();
  const times = plot.data[0] as ArrayLike<number>;
  const values = plot.data[series] as ArrayLike<number>;
  const x = plot.scales.x as uPlot.Scale;
  const y = plot.scales.y as uPlot.Scale;
  const { left, top, width, height } = plot.bbox;
  const perSecond = width / ((x.max ?? 1) - (x.min ?? 0));
  const perUnit = height / ((y.max ?? 1) - (y.min ?? 0));
  const originX = left - (x.min ?? 0) * perSecond;
  const originY = top + height + (y.min ?? 0) * perUnit;
  const end = Math.min(last + 1, times.length - 1);
  let down = false;
  let level = Number.NaN;
  let skipped = Number.NaN;
  for (let index = Math.max(0, first - 1); index <= end; index++) {
    const value = values[index] as number;
    const px = originX + (times[index] as number) * perSecond;
    // For a horizontal section only its ends are drawn, because each point costs time.
    if (value === level) {
      skipped = px;
      continue;
    }
    if (!Number.isNaN(skipped)) stroke.lineTo(skipped, originY - level * perUnit);
    skipped = Number.NaN;
    level = value;
    if (Number.isNaN(value)) {
      down = false;
      continue;
    }
    const py = originY - value * perUnit;
    if (down) stroke.lineTo(px, py);
    else stroke.moveTo(px, py);
    down = true;
  }
  if (!Number.isNaN(skipped)) stroke.lineTo(skipped, originY - level * perUnit);
  return { stroke, fill: null, clip: null, flags: NO_FLAGS };
}

/** Shortens the paths of a drawing before it is sent: relative steps, with a resolution of a tenth of a unit. Pure. */

/** Curve of an exported drawing: points, each with its command letter. */
const CURVE = / d="(M[ML\d .-]*)"/g;
const POINT = /([ML])(-?[\d.]+) (-?[\d.]+)/g;
/** Steps per unit; a unit is a fifth of a millimetre in print. */
const FINE = 10;

export function withShortPaths(svg: string): string {
  return svg.replaceAll(CURVE, (_, points: string) => ` d="${shortened(points)}"`);
}

function shortened(points: string): string {
  const parts: string[] = [];
  let [x, y, level] = [0, 0, 0];
  /** Writes a horizontal section as one step. */
  function endLevel(): void {
    if (level !== 0) parts.push(`h${written(level)}`);
    level = 0;
  }
  for (const [, letter, ...place] of points.matchAll(POINT)) {
    // integer steps, so that rounding errors do not add up
    const [toX, toY] = place.map((part) => Math.round(Number(part) * FINE)) as [number, number];
    const [dx, dy] = [toX - x, toY - y];
    const continuesLevel = letter === "L" && dy === 0 && level * dx >= 0;
    if (!continuesLevel) endLevel();
    if (letter === "M") parts.push(`M${toX / FINE} ${toY / FINE}`);
    else if (continuesLevel) level += dx;
    else if (dy === 0) level = dx;
    else if (dx === 0) parts.push(`v${written(dy)}`);
    else parts.push(`l${written(dx)}${dy < 0 ? "" : " "}${written(dy)}`);
    [x, y] = [toX, toY];
  }
  endLevel();
  return parts.join("");
}

function written(steps: number): string {
  return String(steps / FINE).replace(/^(-?)0\./, "$1.");
}

/** One chart of the stack: curves of a panel over a time range, limit lines and event marks. */

export const AXIS_WIDTH = 52;
export const RIGHT_MARGIN = 10;
const TIME_AXIS_HEIGHT = 24;
const FONT = "11px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
const LINE_WIDTH = 1.6;
/** Line width at which both edges are visible under the line drawn above it. */
const BROAD = 3;
/** Software rendering paints lines of one pixel several times faster. */
const HAIRLINE = 1;
const LABEL_CLEARANCE_PX = 5;
/** Minimum height of a manually scaled value axis, as a share of `narrowest`; the labels still fit their margin. */
const FINEST = 1e-3;

interface PlotOptions {
  readonly panel: Panel;
  readonly timeAxis: boolean;
  readonly markLabels: boolean;
  /** Time of day at time 0 [s since 1970]; null for an axis with the time since the start. */
  epoch_s(): number | null;
}

class SignalPlot {
  limits: readonly LimitLine[] = [];
  marks: readonly PlacedMark[] = [];
  /** Range of a manually scaled value axis; null if it follows the curves. */
  manualRange: ValueRange | null = null;

  private readonly plot: uPlot;
  private readonly panel: Panel;
  private range: ValueRange;
  private readonly hidden = new Set<string>();

  constructor(host: HTMLElement, options: PlotOptions, colours: ChartColours) {
    this.panel = options.panel;
    this.range = { min: -options.panel.narrowest / 2, max: options.panel.narrowest / 2 };
    const software = paintsInSoftware();
    const build = () =>
      new uPlot(this.configuration(options, colours, software), [new Float64Array(0)], host);
    this.plot = software ? withMemoryCanvases(build) : build();
  }

  draw(curves: Curves, stretch: TimeRange): void {
    const range = this.manualRange ?? this.follow(curves);
    this.plot.batch(() => {
      this.plot.setData([curves.times, ...curves.values] as uPlot.AlignedData, false);
      this.plot.setScale("x", { min: stretch.from_s, max: stretch.to_s });
      this.plot.setScale("y", { ...range });
    });
  }

  resize(width: number, height: number): void {
    if (width > 0 && height > 0) this.plot.setSize({ width, height });
  }

  show(name: string, shown: boolean): void {
    if (shown !== this.hidden.has(name)) return;
    if (shown) this.hidden.delete(name);
    else this.hidden.add(name);
    const index = this.panel.traces.findIndex((trace) => trace.name === name);
    if (index >= 0) this.plot.setSeries(index + 1, { show: shown });
  }

  /** Highlights one curve by fading the others; null for none. */
  highlight(name: string | null): void {
    const index = this.panel.traces.findIndex((trace) => trace.name === name);
    this.plot.setSeries(index < 0 ? (null as unknown as number) : index + 1, { focus: true });
  }

  get canvas(): HTMLCanvasElement {
    return this.plot.ctx.canvas;
  }

  /** Scales the value axis by `factor` about the relative height `fraction` (0 bottom, 1 top). */
  scaleValues(factor: number, fraction: number): void {
    const { min, max } = this.manualRange ?? this.range;
    const fixedPoint = min + fraction * (max - min);
    const least = this.panel.narrowest * FINEST;
    const wanted = Math.max((max - min) * factor, least) / (max - min);
    this.manualRange = {
      min: fixedPoint - (fixedPoint - min) * wanted,
      max: fixedPoint + (max - fixedPoint) * wanted,
    };
  }

  destroy(): void {
    this.plot.destroy();
  }

  private follow(curves: Curves): ValueRange {
    let minimum = Number.POSITIVE_INFINITY;
    let maximum = Number.NEGATIVE_INFINITY;
    for (const [index, extent] of curves.extents.entries()) {
      if (this.hidden.has(this.panel.traces[index]?.name ?? "")) continue;
      minimum = Math.min(minimum, extent.minimum);
      maximum = Math.max(maximum, extent.maximum);
    }
    for (const line of this.limits) {
      if (!line.alwaysInSight) continue;
      minimum = Math.min(minimum, line.value);
      maximum = Math.max(maximum, line.value);
    }
    this.range = steadyRange(this.range, { minimum, maximum }, this.panel.narrowest);
    return this.range;
  }

  private configuration(options: PlotOptions, colours: ChartColours, software: boolean): uPlot.Options {
    const grid = { stroke: () => colours.grid, width: 1 };
    return {
      width: 320,
      height: 120,
      padding: [options.markLabels ? MARK_LANE_PX : 4, RIGHT_MARGIN, options.timeAxis ? 0 : 4, 0],
      legend: { show: false },
      cursor: { show: false, focus: { prox: -1 } },
      focus: { alpha: 0.2 },
      scales: {
        x: { time: false, auto: false, range: asSet },
        // When a curve is switched on or off, uPlot passes null, which would leave the axis empty.
        y: {
          auto: false,
          range: (_plot, min, max) => (min === null ? [this.range.min, this.range.max] : [min, max]),
        },
      },
      series: [
        {},
        ...options.panel.traces.map(
          (trace): uPlot.Series => ({
            scale: "y",
            auto: false,
            stroke: colours.drawn(trace.hue),
            width: (software ? HAIRLINE : LINE_WIDTH) * (trace.broad ? BROAD : 1),
            dash: dashOf(trace),
            paths: linePath,
            pxAlign: 0,
            points: {
              show: (plot, _series, first, last) => last - first < plot.bbox.width / 10,
              size: 4,
              fill: colours.drawn(trace.hue),
            },
          }),
        ),
      ],
      axes: [
        {
          stroke: () => colours.axis,
          font: FONT,
          grid,
          ticks: { show: false },
          incrs: TIME_STEPS_S,
          space: 70,
          gap: 6,
          size: options.timeAxis ? TIME_AXIS_HEIGHT : 0,
          splits: (_plot, _axis, min, max, step) => splitsOf(min, max, step, options.epoch_s()),
          values: (_plot, splits, _axis, _space, step) =>
            splits.map((split) => (options.timeAxis ? timeText(split, step, options.epoch_s()) : "")),
        },
        {
          scale: "y",
          stroke: () => colours.axis,
          font: FONT,
          grid,
          ticks: { show: false },
          space: 20,
          gap: 6,
          size: AXIS_WIDTH,
          values: (plot, splits, _axis, _space, step) => hideTopLabel(plot, splits, tickLabels(splits, step)),
        },
      ],
      hooks: {
        drawAxes: [(plot) => drawLimits(plot, this.limits, colours)],
        draw: [
          (plot) => drawLimitLabels(plot, this.limits, colours),
          (plot) => drawMarks(plot, this.marks, colours, options.markLabels),
        ],
      },
    };
  }
}

/** uPlot chooses ranges itself while it has no data; here they are always as set. */
function asSet(_plot: uPlot, min: number | null, max: number | null): uPlot.Range.MinMax {
  return [min, max];
}

/** Removes a label at the very top, where it would overlap the head of the chart. */
function hideTopLabel(plot: uPlot, splits: readonly number[], labels: readonly string[]): string[] {
  return labels.map((label, index) =>
    plot.valToPos(splits[index] as number, "y") < LABEL_CLEARANCE_PX ? "" : label,
  );
}

/** Charts on one time axis, redrawn on animation frames and only after visible changes. */

/** Shift after which a following view is redrawn [device px]; smaller shifts are invisible. */
const LEAST_SHIFT_PX = 1;

export class ChartStack {
  private readonly plots: readonly SignalPlot[];
  private width = 0;
  private drawn: (TimeRange & { version: number }) | null = null;
  private dirty = true;
  private request = 0;
  private readonly pacer = new FramePacer(1);

  constructor(
    private readonly hosts: readonly HTMLElement[],
    private readonly panels: readonly Panel[],
    private readonly source: PlotSource,
    private readonly view: () => Viewport,
    epoch_s: () => number | null,
    private readonly afterFrame: (seen: TimeRange) => void,
  ) {
    const colours = readColours(hosts[0] as HTMLElement);
    this.plots = panels.map(
      (panel, index) =>
        new SignalPlot(
          hosts[index] as HTMLElement,
          { panel, timeAxis: index === panels.length - 1, markLabels: index === 0, epoch_s },
          colours,
        ),
    );
    this.resize();
    this.request = requestAnimationFrame(this.frame);
  }

  /** Width of the plotting area [CSS px]. */
  get plotWidth(): number {
    return Math.max(1, this.width - AXIS_WIDTH - RIGHT_MARGIN);
  }

  /** The visible time range. */
  seen(): TimeRange {
    return visibleRange(this.view(), this.source.now_s());
  }

  resize(): void {
    for (const [index, host] of this.hosts.entries()) {
      this.plots[index]?.resize(host.clientWidth, host.clientHeight);
      this.width = host.clientWidth;
    }
    this.dirty = true;
  }

  show(name: string, shown: boolean): void {
    for (const plot of this.plots) plot.show(name, shown);
    this.dirty = true;
  }

  highlight(name: string | null): void {
    for (const [index, plot] of this.plots.entries()) {
      const mine = this.panels[index]?.traces.some((trace) => trace.name === name);
      plot.highlight(mine ? name : null);
    }
    this.dirty = true;
  }

  get canvases(): readonly HTMLCanvasElement[] {
    return this.plots.map((plot) => plot.canvas);
  }

  setLimits(limits: readonly LimitLine[]): void {
    for (const [index, panel] of this.panels.entries()) {
      const plot = this.plots[index];
      if (plot !== undefined) plot.limits = linesOf(panel, limits);
    }
    this.dirty = true;
  }

  setMarks(marks: readonly PlacedMark[]): void {
    for (const plot of this.plots) plot.marks = marks;
    this.dirty = true;
  }

  scaleValues(index: number, factor: number, fraction: number): void {
    this.plots[index]?.scaleValues(factor, fraction);
    this.dirty = true;
  }

  resetValues(): void {
    for (const plot of this.plots) plot.manualRange = null;
    this.dirty = true;
  }

  destroy(): void {
    cancelAnimationFrame(this.request);
    for (const plot of this.plots) plot.destroy();
  }

  private readonly frame = (): void => {
    this.request = requestAnimationFrame(this.frame);
    const seen = this.seen();
    const now_ms = performance.now();
    if (this.pacer.due(now_ms) && this.hasVisibleChange(seen)) {
      this.pacer.drew(now_ms);
      for (const [index, plot] of this.plots.entries()) {
        plot.draw(this.source.curves(this.panels[index] as Panel, seen, this.plotWidth), seen);
      }
      this.drawn = { ...seen, version: this.source.version() };
      this.dirty = false;
    }
    this.afterFrame(seen);
  };

  private hasVisibleChange(seen: TimeRange): boolean {
    if (this.dirty || this.drawn === null) return true;
    const perPixel_s = (seen.to_s - seen.from_s) / (this.plotWidth * devicePixelRatio);
    const shift_s = Math.max(
      Math.abs(seen.to_s - this.drawn.to_s),
      Math.abs(seen.from_s - this.drawn.from_s),
    );
    if (shift_s >= LEAST_SHIFT_PX * perPixel_s) return true;
    // A following view is redrawn after a sufficient shift; a held one after changes of its samples.
    return this.view().end_s !== null && this.source.changedWithin(seen, this.drawn.version);
  }
}
